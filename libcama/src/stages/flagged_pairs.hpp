// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "state.hpp"

namespace cama {

/// Compacts the flagged pairs of one candidate list, ordered by their features.
class FlaggedPairs {
public:
  explicit FlaggedPairs(Backend &backend) : flag(backend), index(backend), place_(backend), key_(backend) {}
  /// Makes room for the flags of `pairs` candidates.
  void resize(int pairs) { flag.resize(pairs); }
  /// After the flags are written: fills `index` and returns how many there are.
  int compact(Backend &backend, const PairList &list);

  Stream<int> flag;    // [pairs]
  Stream<int> index;   // [flagged] candidates, by (a, b)

private:
  Stream<int> place_;
  Stream<key64> key_;
};

}  // namespace cama
