// SPDX-License-Identifier: Apache-2.0
// Pairs that a search may leave out: a coordinate separates them throughout the motion.
#pragma once
#include <algorithm>
#include <array>
#include <iterator>
#include <utility>
#include <vector>

#include "cama/types.hpp"
#include "device/kernels.hpp"

namespace separated {

/// Whether one coordinate separates vertices a from vertices b at both ends of from -> to, with the same ones below.
inline bool throughout(const std::vector<cama::dvec3> &from, const std::vector<cama::dvec3> &to,
                       const std::vector<int> &a, const std::vector<int> &b)
{
  for (int k = 0; k < 3; ++k) {
    bool below = true, above = true;
    for (int v : a)
      for (int w : b)
        for (const std::vector<cama::dvec3> *x : {&from, &to}) {
          const double difference = cama::kernels::dcomponent((*x)[static_cast<std::size_t>(v)], k) -
                                    cama::kernels::dcomponent((*x)[static_cast<std::size_t>(w)], k);
          below &= difference < 0;
          above &= difference > 0;
        }
    if (below || above) return true;
  }
  return false;
}

/// The pairs of `overlapping`, sorted and each once, that are neither in `found` nor separated, and those of `found`
/// that are not in `overlapping`, or there twice. A pair is a vertex and a face, or with `edges` two of these.
template <class Pair>
std::vector<Pair> wrong(const std::vector<Pair> &overlapping, std::vector<Pair> found,
                        const std::vector<cama::dvec3> &from, const std::vector<cama::dvec3> &to,
                        const std::vector<cama::kernels::face_nodes> &faces,
                        const std::vector<cama::kernels::edge_nodes> *edges = nullptr)
{
  std::sort(found.begin(), found.end());
  std::vector<Pair> missing, wrong;
  std::set_difference(found.begin(), found.end(), overlapping.begin(), overlapping.end(), std::back_inserter(wrong));
  std::set_difference(overlapping.begin(), overlapping.end(), found.begin(), found.end(), std::back_inserter(missing));
  for (const Pair &p : missing) {
    const auto first = static_cast<std::size_t>(std::get<0>(p)), second = static_cast<std::size_t>(std::get<1>(p));
    std::vector<int> a{std::get<0>(p)}, b;
    if (edges) {
      a.assign((*edges)[first].node, (*edges)[first].node + 2);
      b.assign((*edges)[second].node, (*edges)[second].node + 2);
    } else {
      b.assign(faces[second].node, faces[second].node + 3);
    }
    if (!throughout(from, to, a, b)) wrong.push_back(p);
  }
  return wrong;
}

}  // namespace separated
