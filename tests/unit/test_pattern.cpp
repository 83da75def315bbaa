// SPDX-License-Identifier: Apache-2.0
// Sorting of a row's indices, by one member and by teams, against std::sort.
#include "../backends.hpp"

#include <algorithm>
#include <random>

#include "device/launch.hpp"

using namespace cama;

TEST_CASE("sort_keys equals std::sort", "[pattern]")
{
  std::mt19937_64 random(7);
  for (int n : {0, 1, 2, 3, 4, 5, 12, 13, 14, 66, 1000, 4097}) {
    INFO(n << " keys");
    std::vector<key64> up(static_cast<std::size_t>(n)), equal(up.size(), 5), noise(up.size()), saw(up.size());
    for (std::size_t i = 0; i < up.size(); ++i) {
      up[i] = i;
      noise[i] = random();
      saw[i] = i % 13 * 1000 + (up.size() - i);
    }
    std::vector<key64> down(up.rbegin(), up.rend());
    for (std::vector<key64> keys : {up, down, equal, noise, saw}) {
      std::vector<key64> expected = keys;
      std::sort(expected.begin(), expected.end());
      kernels::sort_keys(keys.data(), n);
      REQUIRE(keys == expected);
    }
  }
}

TEST_CASE("rows of indices are sorted by a member or by a team as by std::sort, on every backend", "[pattern]")
{
  std::mt19937 random(8);
  std::vector<int> space{0};
  std::vector<key64> unsorted;
  for (int n : {0, 1, 2, 63, 64, 65, 0, SORT_ROOM - 1, SORT_ROOM, SORT_ROOM + 1, 5 * SORT_ROOM, 7}) {
    // Columns recur, sources do not.
    for (int i = 0; i < n; ++i) unsorted.push_back(kernels::index_of(static_cast<int>(random() % 20) * 100000000, i));
    std::shuffle(unsorted.end() - n, unsorted.end(), random);
    space.push_back(static_cast<int>(unsorted.size()));
  }
  std::vector<key64> expected = unsorted;
  const int rows = static_cast<int>(space.size()) - 1;
  for (int i = 0; i < rows; ++i)
    std::sort(expected.begin() + space[static_cast<std::size_t>(i)],
              expected.begin() + space[static_cast<std::size_t>(i) + 1]);
  for (const std::string &name : backends_here()) {
    INFO(name);
    const auto backend = make_backend(name, 0, 2);
    Stream<int> row(*backend, space);
    Stream<key64> by_member(*backend, unsorted), by_team(*backend, unsorted);
    CAMA_LAUNCH(*backend, sort_indices, rows, row, by_member);
    REQUIRE(by_member.download() == expected);
    CAMA_LAUNCH_TEAMS(void, *backend, sort_indices_by_teams, SORT_TEAM, rows, row, by_team);
    REQUIRE(by_team.download() == expected);
  }
}

TEST_CASE("an index gives back its column and its source", "[pattern]")
{
  for (int column : {0, 1, 7, 2147483647})
    for (int source : {0, 1, 15, 16, 2147483645}) {
      const key64 index = kernels::index_of(column, source);
      CHECK(kernels::index_column(index) == column);
      CHECK(kernels::index_source(index) == source);
      CHECK(kernels::index_of_mass(column) < index);   // the mass comes first in its block
    }
  CHECK(kernels::index_source(kernels::index_of_mass(7)) == -1 - 7);
}
