// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "cama/stream.hpp"
#include "device/kernels.hpp"

namespace cama {

/// Vertex-to-element lists in CSR form.
struct Incidence {
  Stream<int> row, entry;   // [vertices + 1], [at least row[vertices]] 4 * element + local index
  int vertices = 0;
  void reset(Backend &backend, int vertex_count);
  /// Makes the lists on the device. `count` is scratch of at least vertex_count ints.
  void build(Backend &backend, const Stream<kernels::element_nodes> &nodes, int elements, Stream<int> &count);
  /// Makes the same lists without waiting for the device, in room for the vertices of all elements; keeps its scratch
  /// memory.
  void rebuild(Backend &backend, const Stream<kernels::element_nodes> &nodes, int elements, Stream<int> &count);

private:
  void find_rows(Backend &backend, const Stream<kernels::element_nodes> &nodes, int elements, Stream<int> &count);
  void fill(Backend &backend, const Stream<kernels::element_nodes> &nodes, int elements, Stream<int> &count,
            Stream<int> &unsorted);

  Stream<int> unsorted_;  // of rebuild, as the keys are
  Stream<key64> key_;
};

}  // namespace cama
