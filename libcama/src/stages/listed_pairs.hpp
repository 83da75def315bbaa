// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <algorithm>

#include "device/ceil_divide.hpp"
#include "model/access.hpp"

namespace cama {

/// Lists of the few candidates that have work, and their order by features, vertex-face pairs first. All stages of a
/// step share one, since what has an entry for every candidate is among the largest streams.
class ListedPairs {
public:
  using Rooms = Access<const MeshState, const ContactState>;
  explicit ListedPairs(Backend &backend) : flag(backend), list(backend), spare(backend), index(backend), key_(backend)
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
  /// Whether there are so many that lists of those with work are long: then work that few of these need is put off.
  bool many() const { return flag.size() > many_pairs; }
  /// Keeps the flags in `spare`; `resize` allocates others.
  void keep() { flag.swap(spare); }
  /// Fills `index` with the first n of the codes of pairs (pair.h), by kind and features.
  void order(const Rooms &state, const Stream<int> &code, int n);
  /// Fills key, [n] of the last `order`: kind and features of the pairs, ascending.
  void copy_keys(Backend &backend, Stream<key64> &key) const;

  Stream<int> flag;   // [candidates] of vertex_face, then of edge_edge; free for other uses in between
  Stream<int> list;   // [candidates] places in `flag`, or codes, of the few with work, in any order
  Stream<int> spare;  // of either kind, allocated by who uses it
  Stream<int> index;  // [n] codes in order

private:
  static constexpr int many_pairs = 100'000'000;
  void find_bits(const Rooms &state);

  Stream<key64> key_;  // [n] as they were sorted, with so many bits for their features: few take fewer passes
  int bits_a_ = 31, bits_b_ = 31;
};

}  // namespace cama
