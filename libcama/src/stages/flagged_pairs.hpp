// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <algorithm>

#include "device/ceil_divide.hpp"
#include "model/access.hpp"

namespace cama {

/// Compacts the flagged pairs of both candidate lists, ordered by their features, vertex-face pairs first. All stages
/// of a step share one, since lists of candidates are the largest streams.
class FlaggedPairs {
public:
  explicit FlaggedPairs(Backend &backend) : flag(backend), index(backend), place_(backend), key_(backend) {}
  /// Allocates a flag for every candidate.
  void resize(const Access<const ContactState> &state)
  {
    flag.resize(static_cast<long long>(state.contact.vertex_face.pairs.size()) + state.contact.edge_edge.pairs.size());
  }
  /// Of kernels whose teams take several runs of RUN_PAIRS candidates each: few where there are few candidates, so that
  /// teams are many.
  int runs() const { return std::clamp(flag.size() / (many_teams * RUN_PAIRS), 1, 16); }
  int teams() const { return ceil_divide(flag.size(), runs() * RUN_PAIRS); }
  /// Keeps the flags as `before()` until the next `compact`; `resize` allocates others.
  void keep() { flag.swap(place_); }
  const Stream<int> &before() const { return place_; }
  /// Called after the flags are written: fills `index` and returns the number of flagged pairs. `flagged`: that number,
  /// if known; otherwise it waits for the device.
  int compact(const Access<const ContactState> &state, int flagged = -1);
  /// [flagged] of the last `compact`: kind and features of the pairs, ascending.
  const Stream<key64> &key() const { return key_; }

  Stream<int> flag;  // [candidates] of vertex_face, then of edge_edge; free for other uses in between
  Stream<int> index;  // [flagged] places in `flag`, by (kind, a, b)

private:
  static constexpr int many_teams = 1024;
  Stream<int> place_;
  Stream<key64> key_;
};

}  // namespace cama
