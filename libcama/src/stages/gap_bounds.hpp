// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "model/access.hpp"
#include "stages/listed_pairs.hpp"

namespace cama {

/// What single precision tells of candidate pairs: for most of them a direction that separates both sides over a
/// motion, and a lower bound of the gap along it, by which detection passes them.
class GapBounds {
public:
  using Rooms = Access<const MeshState, const BoundsState, ContactState>;
  GapBounds(Backend &backend, ListedPairs &listed)
      : swept_vertices(backend), rounding_margin(backend, 1), found(backend, NEAR_COUNTS), listed_(listed)
  {}
  /// Fills `direction` and `gap_bound` of all pairs for the motion from -> to of their search, and lists those without
  /// a bound, with `contacts` all that may be one, in ListedPairs::list.
  void find(const Rooms &state, const Stream<dvec3> &from, const Stream<dvec3> &to, bool contacts);
  /// Besides, for those without a bound: the direction between the closest points, and the bound along it.
  void find_all(const Rooms &state, const Stream<dvec3> &from, const Stream<dvec3> &to);

  Stream<kernels::swept_vertex> swept_vertices;
  Stream<float> rounding_margin;
  Stream<int> found;  ///< [NEAR_COUNTS] of swept_vertex.h; found[NEAR_PAIRS]: number of pairs that are listed

private:
  ListedPairs &listed_;
};

}  // namespace cama
