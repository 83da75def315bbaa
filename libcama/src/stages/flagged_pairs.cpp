// SPDX-License-Identifier: Apache-2.0
#include "stages/flagged_pairs.hpp"

#include "device/launch.hpp"

namespace cama {

int FlaggedPairs::compact(State &state, int flagged)
{
  Backend &b = *state.backend;
  const int n = flag.size();
  if (flagged != 0) {
    place_.resize(n + 1);
    b.scan(flag.buffer(), place_.buffer(), n);
    if (flagged < 0) flagged = place_.at(n);
  }
  index.resize(flagged);
  key_.resize(flagged);
  if (flagged == 0) return 0;
  CAMA_LAUNCH(b, flagged_pairs, n, state.vertex_face.pairs.size(), state.vertex_face.pairs, state.edge_edge.pairs,
              place_, key_, index);
  b.sort(key_.buffer(), index.buffer(), flagged, 63);
  return flagged;
}

}  // namespace cama
