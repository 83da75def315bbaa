// SPDX-License-Identifier: Apache-2.0
#include "model/incidence.hpp"

#include "device/launch.hpp"

namespace cama {
namespace {
// From this number on, a radix sort is faster than filling rows by atomics and ordering each row; ranks take the square
// of a row's length, which may be all elements.
constexpr int many_elements = 1 << 16;

bool sorted_by_keys(const Backend &b, int elements) { return !b.wide_workers() && elements >= many_elements; }
}  // namespace

void Incidence::rebuild(Backend &b, const Stream<kernels::element_nodes> &nodes, int elements, Stream<int> &count)
{
  entry.resize(4ll * elements);
  if (!sorted_by_keys(b, elements)) {
    find_rows(b, nodes, elements, count);
    return fill(b, nodes, elements, count, unsorted_);
  }
  int bits = 0;
  for (int v = vertices; v > 0; v >>= 1) ++bits;
  key_.resize(entry.size());
  CAMA_LAUNCH(b, incidence_keys, elements, nodes, vertices, key_, entry);
  b.sort(key_.buffer(), entry.buffer(), entry.size(), bits);
  CAMA_LAUNCH(b, incidence_rows, vertices + 1, entry.size(), key_, row);
}

void Incidence::reset(Backend &backend, int vertex_count)
{
  if (row.backend()) return;
  row = Stream<int>(backend, vertex_count + 1);
  entry = Stream<int>(backend);
  unsorted_ = Stream<int>(backend);
  key_ = Stream<key64>(backend);
  vertices = vertex_count;
}

void Incidence::build(Backend &b, const Stream<kernels::element_nodes> &nodes, int elements, Stream<int> &count)
{
  if (sorted_by_keys(b, elements)) {
    rebuild(b, nodes, elements, count);
    entry.resize(row.at(vertices));
    key_ = Stream<key64>(b);
    return;
  }
  find_rows(b, nodes, elements, count);
  entry.resize(row.at(vertices));
  Stream<int> unsorted(b);
  fill(b, nodes, elements, count, unsorted);
}

void Incidence::find_rows(Backend &b, const Stream<kernels::element_nodes> &nodes, int elements, Stream<int> &count)
{
  CAMA_LAUNCH(b, set_int, vertices, 0, 0, count);
  CAMA_LAUNCH(b, count_incidence, elements, nodes, vertices, count);
  b.scan(count.buffer(), row.buffer(), vertices);
}

void Incidence::fill(Backend &b, const Stream<kernels::element_nodes> &nodes, int elements, Stream<int> &count,
                     Stream<int> &unsorted)
{
  if (b.wide_workers()) {
    CAMA_LAUNCH(b, fill_incidence, elements, nodes, vertices, row, count, entry);
    CAMA_LAUNCH(b, sort_rows, vertices, row, entry);
    return;
  }
  unsorted.resize(entry.size());
  CAMA_LAUNCH(b, fill_incidence, elements, nodes, vertices, row, count, unsorted);
  CAMA_LAUNCH(b, rank_incidence, 4 * elements, nodes, vertices, row, unsorted, entry);
}

}  // namespace cama
