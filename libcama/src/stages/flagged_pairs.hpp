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
  using Rooms = Access<const MeshState, const ContactState>;
  explicit FlaggedPairs(Backend &backend) : flag(backend), list(backend), index(backend), place_(backend), key_(backend)
  {}
  /// Allocates a flag for every candidate, and room in `list`.
  void resize(const Access<const ContactState> &state)
  {
    flag.resize(static_cast<long long>(state.contact.vertex_face.pairs.size()) + state.contact.edge_edge.pairs.size());
    list.resize(flag.size());
  }
  /// Teams of kernels that take all candidates, and of those that take what these have listed.
  int teams() const { return ceil_divide(flag.size(), RUN_PAIRS); }
  int list_teams() const { return std::min(ceil_divide(flag.size(), PAIR_TEAM), LIST_TEAMS); }
  /// Keeps the flags as `before()` until the next `compact`; `resize` allocates others.
  void keep() { flag.swap(place_); }
  const Stream<int> &before() const { return place_; }
  /// Called after the flags are written: fills `index` and returns the number of flagged pairs. Waits.
  int compact(const Rooms &state);
  /// Fills `index` with the codes of pairs (pair.h) in the order of `compact`.
  void order(const Rooms &state, const Stream<int> &code);
  /// Fills key, [flagged] of the last `compact` or `order`: kind and features of the pairs, ascending.
  void copy_keys(Backend &backend, Stream<key64> &key) const;

  Stream<int> flag;  // [candidates] of vertex_face, then of edge_edge; free for other uses in between
  Stream<int> list;  // [candidates] places in `flag`, or codes, of the few with work, in any order
  Stream<int> index;  // [flagged] places in `flag`, or codes, by (kind, a, b)

private:
  void find_bits(const Rooms &state);

  Stream<int> place_;
  Stream<key64> key_;  // [flagged] as they were sorted, with so many bits for their features: few take fewer passes
  int bits_a_ = 31, bits_b_ = 31;
};

}  // namespace cama
