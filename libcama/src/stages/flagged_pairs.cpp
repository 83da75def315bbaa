// SPDX-License-Identifier: Apache-2.0
#include "stages/flagged_pairs.hpp"

#include "launch.hpp"

namespace cama {

int FlaggedPairs::compact(Backend &b, const PairList &list)
{
  const int n = list.pairs.size();
  place_.resize(n + 1);
  b.scan(flag.buffer(), place_.buffer(), n);
  const int flagged = place_.at(n);
  index.resize(flagged);
  key_.resize(flagged);
  if (flagged == 0) return 0;
  CAMA_LAUNCH(b, flagged_pairs, n, list.pairs, place_, key_, index);
  b.sort(key_.buffer(), index.buffer(), flagged, 62);
  return flagged;
}

}  // namespace cama
