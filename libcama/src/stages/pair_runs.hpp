// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "model/access.hpp"

namespace cama {

/// Boxes around runs of candidates, which tell where in the lists the pairs of a few vertices are (runs.h).
class PairRuns {
public:
  using Rooms = Access<const MeshState, const ContactState, const BoundsState>;
  explicit PairRuns(Backend &backend)
      : list(backend), box_{Stream<kernels::box>(backend), Stream<kernels::box>(backend)}
  {}
  /// Forgets all boxes: the lists or the positions are others.
  void forget() { bounded_[0] = bounded_[1] = 0; }
  /// Lists the runs that meet a cell with the mark `mark`, for pairs of vertices at `position`, which are the same
  /// until `forget`; the lists of pairs may grow meanwhile. cell_size: m; cell_marked: [2^k]. found[counter]: how many,
  /// 0 before.
  void list_marked(const Rooms &state, const Stream<dvec3> &position, double cell_size, const Stream<int> &cell_marked,
                   int mark, int counter, Stream<int> &found);

  Stream<int> list;  // runs, by pair_code (pair.h)

private:
  void bound(const Rooms &state, const Stream<dvec3> &position);

  Stream<kernels::box> box_[2];  // of vertex_face and edge_edge
  int bounded_[2] = {0, 0};  // pairs whose runs have their boxes
};

}  // namespace cama
