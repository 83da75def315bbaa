// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "model/state.hpp"

namespace cama {

/// Compacts the flagged pairs of both candidate lists, ordered by their features, vertex-face pairs first. One for all
/// stages of a step: lists of candidates are the largest streams there are.
class FlaggedPairs {
public:
  explicit FlaggedPairs(Backend &backend) : flag(backend), index(backend), place_(backend), key_(backend) {}
  /// Makes room for a flag of every candidate.
  void resize(const State &state)
  {
    flag.resize(static_cast<long long>(state.vertex_face.pairs.size()) + state.edge_edge.pairs.size());
  }
  /// Teams of kernels that take TEAM_PAIRS candidates each.
  int pair_teams() const { return (flag.size() + TEAM_PAIRS - 1) / TEAM_PAIRS; }
  /// After the flags are written: fills `index` and returns how many there are. `flagged`: how many, where that is
  /// known; else it waits.
  int compact(State &state, int flagged = -1);

  Stream<int> flag;    // [candidates] of vertex_face, then of edge_edge; between its uses, anyone's
  Stream<int> index;   // [flagged] places in `flag`, by (kind, a, b)

private:
  Stream<int> place_;
  Stream<key64> key_;
};

}  // namespace cama
