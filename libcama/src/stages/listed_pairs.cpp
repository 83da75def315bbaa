// SPDX-License-Identifier: Apache-2.0
#include "stages/listed_pairs.hpp"

#include <algorithm>

#include "device/launch.hpp"

namespace cama {

void ListedPairs::find_bits(const Rooms &state)
{
  const auto bits = [](int n) {
    int found = 1;
    while (n >> found) ++found;
    return found;
  };
  bits_a_ = bits(std::max(state.mesh.vertices, state.mesh.edges));
  bits_b_ = bits(std::max(state.mesh.faces, state.mesh.edges));
}

void ListedPairs::order(const Rooms &state, const Stream<int> &code, int n)
{
  index.resize(n);
  key_.resize(n);
  if (n == 0) return;
  find_bits(state);
  CAMA_LAUNCH(*state.backend, coded_pairs, n, bits_a_, bits_b_, state.contact.vertex_face.pairs,
              state.contact.edge_edge.pairs, code, key_, index);
  state.backend->sort(key_.buffer(), index.buffer(), n, bits_a_ + bits_b_ + 1);
}

void ListedPairs::copy_keys(Backend &b, Stream<key64> &key) const
{
  key.resize(key_.size());
  CAMA_LAUNCH(b, widen_keys, key_.size(), bits_a_, bits_b_, key_, key);
}

}  // namespace cama
