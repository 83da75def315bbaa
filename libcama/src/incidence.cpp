// SPDX-License-Identifier: Apache-2.0
#include "launch.hpp"
#include "state.hpp"

namespace cama {

void Incidence::reset(Backend &backend, int vertex_count)
{
  if (row.backend()) return;
  row = Stream<int>(backend, vertex_count + 1);
  entry = Stream<int>(backend);
  vertices = vertex_count;
}

void Incidence::build(Backend &b, const Stream<kernels::element_nodes> &nodes, int elements, Stream<int> &count)
{
  CAMA_LAUNCH(b, set_int, vertices, 0, 0, count);
  CAMA_LAUNCH(b, count_incidence, elements, nodes, vertices, count);
  b.scan(count.buffer(), row.buffer(), vertices);
  entry.resize(row.at(vertices));
  CAMA_LAUNCH(b, set_int, vertices, 0, 0, count);
  CAMA_LAUNCH(b, fill_incidence, elements, nodes, vertices, row, count, entry);
  CAMA_LAUNCH(b, sort_rows, vertices, row, entry);
}

}  // namespace cama
