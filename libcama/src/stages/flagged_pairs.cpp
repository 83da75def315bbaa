// SPDX-License-Identifier: Apache-2.0
#include "stages/flagged_pairs.hpp"

#include <algorithm>

#include "device/launch.hpp"

namespace cama {

void FlaggedPairs::find_bits(const Rooms &state)
{
  const auto bits = [](int n) {
    int found = 1;
    while (n >> found) ++found;
    return found;
  };
  bits_a_ = bits(std::max(state.mesh.vertices, state.mesh.edges));
  bits_b_ = bits(std::max(state.mesh.faces, state.mesh.edges));
}

int FlaggedPairs::compact(const Rooms &state)
{
  Backend &b = *state.backend;
  const int n = flag.size();
  place_.resize(n + 1);
  b.scan(flag.buffer(), place_.buffer(), n);
  const int flagged = place_.at(n);
  index.resize(flagged);
  key_.resize(flagged);
  if (flagged == 0) return 0;
  find_bits(state);
  CAMA_LAUNCH(b, flagged_pairs, n, state.contact.vertex_face.pairs.size(), bits_a_, bits_b_,
              state.contact.vertex_face.pairs, state.contact.edge_edge.pairs, place_, key_, index);
  b.sort(key_.buffer(), index.buffer(), flagged, bits_a_ + bits_b_ + 1);
  return flagged;
}

void FlaggedPairs::order(const Rooms &state, const Stream<int> &code)
{
  const int n = code.size();
  index.resize(n);
  key_.resize(n);
  find_bits(state);
  CAMA_LAUNCH(*state.backend, coded_pairs, n, bits_a_, bits_b_, state.contact.vertex_face.pairs,
              state.contact.edge_edge.pairs, code, key_, index);
  state.backend->sort(key_.buffer(), index.buffer(), n, bits_a_ + bits_b_ + 1);
}

void FlaggedPairs::copy_keys(Backend &b, Stream<key64> &key) const
{
  key.resize(key_.size());
  CAMA_LAUNCH(b, widen_keys, key_.size(), bits_a_, bits_b_, key_, key);
}

}  // namespace cama
