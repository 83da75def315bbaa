// SPDX-License-Identifier: Apache-2.0
// Incidence lists against a map built by brute force; row sorting against std::sort.
#include "../backends.hpp"

#include <algorithm>
#include <map>
#include <random>

#include "device/launch.hpp"
#include "model/state.hpp"

using namespace cama;
using kernels::element_nodes;

namespace {

std::vector<element_nodes> random_elements(int count, int vertices, std::mt19937 &random)
{
  std::vector<element_nodes> elements;
  for (int e = 0; e < count; ++e) {
    element_nodes n;
    for (int &v : n.node)
      v = static_cast<int>(random() % static_cast<unsigned>(vertices + 3)) - 1;   // -1 and past the end occur
    elements.push_back(n);
  }
  return elements;
}

void check(Backend &backend, const std::vector<element_nodes> &elements, int vertices)
{
  std::map<int, std::vector<int>> expected;
  for (std::size_t e = 0; e < elements.size(); ++e)
    for (int a = 0; a < 4; ++a)
      if (elements[e].node[a] >= 0 && elements[e].node[a] < vertices)
        expected[elements[e].node[a]].push_back(4 * static_cast<int>(e) + a);
  Stream<element_nodes> nodes(backend, elements);
  Stream<int> count(backend, vertices);
  Incidence lists;
  lists.reset(backend, vertices);
  lists.rebuild(backend, nodes, nodes.size(), count);
  const std::vector<int> row = lists.row.download();
  std::vector<int> entry = lists.entry.download();
  REQUIRE(static_cast<int>(entry.size()) >= row.back());
  entry.resize(static_cast<std::size_t>(row.back()));   // a rebuilt list has room for more
  lists.build(backend, nodes, nodes.size(), count);
  REQUIRE(lists.row.download() == row);
  REQUIRE(lists.entry.download() == entry);
  REQUIRE(static_cast<int>(row.size()) == vertices + 1);
  REQUIRE(row.front() == 0);
  REQUIRE(row.back() == static_cast<int>(entry.size()));
  for (int v = 0; v < vertices; ++v) {
    INFO("vertex " << v);
    REQUIRE(std::vector<int>(entry.begin() + row[v], entry.begin() + row[v + 1]) == expected[v]);
  }
}

std::vector<std::vector<int>> adversarial_rows()
{
  std::mt19937 random(7);
  std::vector<std::vector<int>> rows;
  for (int n : {0, 1, 2, 3, 23, 24, 25, 26, 63, 64, 65, 1000, 4097}) {
    std::vector<int> up(static_cast<std::size_t>(n)), equal(up.size(), 5), two(up.size()), noise(up.size()),
        saw(up.size()), extreme(up.size());
    for (int i = 0; i < n; ++i) {
      const auto k = static_cast<std::size_t>(i);
      up[k] = i;
      two[k] = i % 2;
      noise[k] = static_cast<int>(random());
      saw[k] = i % 7 * 1000 - i;
      extreme[k] = i % 3 == 0 ? 2147483647 : i % 3 == 1 ? -2147483647 - 1 : 0;
    }
    std::vector<int> down(up.rbegin(), up.rend()), organ(up);
    std::reverse(organ.begin() + n / 2, organ.end());
    for (auto &r : {up, down, equal, two, noise, saw, extreme, organ}) rows.push_back(r);
  }
  return rows;
}

}  // namespace

TEST_CASE("long incidence lists are what brute force finds on every backend, those that sort them too", "[incidence]")
{
  std::mt19937 random(3);
  const std::vector<element_nodes> elements = random_elements(70000, 9000, random);
  for (const std::string &name : backends_here()) {
    INFO(name);
    check(*make_backend(name, 0, 2), elements, 9000);
  }
}

TEST_CASE("incidence lists are what brute force finds", "[incidence]")
{
  std::mt19937 random(1);
  for (int threads : {1, 3}) {
    const auto backend = make_backend("auto", 0, threads);
    check(*backend, {}, 5);
    check(*backend, {{{0, 1, 2, -1}}}, 3);
    check(*backend, {{{0, 0, 0, 0}}}, 1);   // one vertex four times
    check(*backend, random_elements(50, 2000, random), 2000);   // most rows empty
    check(*backend, random_elements(5000, 400, random), 400);
    check(*backend, random_elements(3000, 2, random), 2);       // rows of thousands of entries
  }
}

TEST_CASE("incidence lists are rebuilt for other elements on the same streams", "[incidence]")
{
  const auto backend = make_backend("auto", 0, 1);
  std::mt19937 random(2);
  Stream<int> count(*backend, 100);
  Incidence lists;
  lists.reset(*backend, 100);
  for (int elements : {1, 300, 0, 900}) {
    Stream<element_nodes> nodes(*backend, random_elements(elements, 100, random));
    lists.build(*backend, nodes, elements, count);
    const std::vector<int> row = lists.row.download(), entry = lists.entry.download();
    std::size_t in_range = 0;
    for (const element_nodes &e : nodes.download())
      for (int v : e.node) in_range += v >= 0 && v < 100;
    REQUIRE(entry.size() == in_range);
    for (int v = 0; v < 100; ++v) REQUIRE(std::is_sorted(entry.begin() + row[v], entry.begin() + row[v + 1]));
  }
}

TEST_CASE("entries that count the smaller ones of their row are in order, on CPUs too", "[incidence]")
{
  std::mt19937 random(4);
  for (const int vertices : {1, 3, 400}) {
    // Some elements have a vertex several times, others one that is not there.
    const std::vector<element_nodes> elements = random_elements(900, vertices, random);
    std::vector<std::vector<int>> expected(static_cast<std::size_t>(vertices));
    for (std::size_t e = 0; e < elements.size(); ++e)
      for (int k = 0; k < 4; ++k) {
        const int v = elements[e].node[k];
        if (v >= 0 && v < vertices) expected[static_cast<std::size_t>(v)].push_back(4 * static_cast<int>(e) + k);
      }
    std::vector<int> row{0}, sorted, unsorted;
    for (std::vector<int> entries : expected) {
      sorted.insert(sorted.end(), entries.begin(), entries.end());
      std::shuffle(entries.begin(), entries.end(), random);
      unsorted.insert(unsorted.end(), entries.begin(), entries.end());
      row.push_back(static_cast<int>(sorted.size()));
    }
    for (const std::string &name : backends_here()) {
      INFO(name << ", " << vertices << " vertices");
      const auto backend = make_backend(name, 0, 2);
      const Stream<element_nodes> nodes(*backend, elements);
      const Stream<int> rows(*backend, row), entries(*backend, unsorted);
      Stream<int> found(*backend, static_cast<int>(sorted.size()));
      CAMA_LAUNCH(*backend, rank_incidence, 4 * static_cast<int>(elements.size()), nodes, vertices, rows, entries,
                  found);
      CHECK(found.download() == sorted);
    }
  }
}

TEST_CASE("sort_ints and sort_rows equal std::sort", "[incidence]")
{
  const std::vector<std::vector<int>> rows = adversarial_rows();
  std::vector<int> row{0}, values;
  for (const auto &r : rows) {
    std::vector<int> sorted = r, expected = r;
    kernels::sort_ints(sorted.data(), static_cast<int>(sorted.size()));
    std::sort(expected.begin(), expected.end());
    REQUIRE(sorted == expected);
    values.insert(values.end(), r.begin(), r.end());
    row.push_back(static_cast<int>(values.size()));
  }
  for (int threads : {1, 4}) {
    const auto backend = make_backend("auto", 0, threads);
    Stream<int> row_stream(*backend, row), value_stream(*backend, values);
    CAMA_LAUNCH(*backend, sort_rows, static_cast<int>(rows.size()), row_stream, value_stream);
    std::vector<int> expected = values;
    for (std::size_t i = 0; i < rows.size(); ++i) std::sort(expected.begin() + row[i], expected.begin() + row[i + 1]);
    REQUIRE(value_stream.download() == expected);
  }
}
