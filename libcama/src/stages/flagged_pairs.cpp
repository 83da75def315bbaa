// SPDX-License-Identifier: Apache-2.0
#include "stages/flagged_pairs.hpp"

#include "device/launch.hpp"

namespace cama {

int FlaggedPairs::compact(const Access<const ContactState> &state)
{
  Backend &b = *state.backend;
  const int n = flag.size();
  place_.resize(n + 1);
  b.scan(flag.buffer(), place_.buffer(), n);
  const int flagged = place_.at(n);
  index.resize(flagged);
  key_.resize(flagged);
  if (flagged == 0) return 0;
  CAMA_LAUNCH(b, flagged_pairs, n, state.contact.vertex_face.pairs.size(), state.contact.vertex_face.pairs,
              state.contact.edge_edge.pairs, place_, key_, index);
  b.sort(key_.buffer(), index.buffer(), flagged, 63);
  return flagged;
}

void FlaggedPairs::order(const Access<const ContactState> &state, const Stream<int> &code)
{
  const int n = code.size();
  index.resize(n);
  key_.resize(n);
  CAMA_LAUNCH(*state.backend, coded_pairs, n, state.contact.vertex_face.pairs, state.contact.edge_edge.pairs, code,
              key_, index);
  state.backend->sort(key_.buffer(), index.buffer(), n, 63);
}

}  // namespace cama
