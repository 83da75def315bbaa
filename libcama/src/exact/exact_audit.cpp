// SPDX-License-Identifier: Apache-2.0
#include "exact/exact_audit.hpp"

#include <algorithm>

#include "device/kernels.hpp"
#include "exact/predicates.hpp"

namespace cama {
namespace {

using namespace kernels;

/// Distance of the segment a b, or of the point a = b, from a triangle.
double segment_triangle(const dvec3 &a, const dvec3 &b, const dvec3 *t, bool point)
{
  double least = vertex_face_proximity(a, t[0], t[1], t[2]).distance;
  if (point) return least;
  if (exact::segment_meets_triangle(a, b, t[0], t[1], t[2])) return 0;
  least = std::min(least, vertex_face_proximity(b, t[0], t[1], t[2]).distance);
  for (int k = 0; k < 3; ++k) least = std::min(least, edge_edge_proximity(a, b, t[k], t[(k + 1) % 3]).distance);
  return least;
}

}  // namespace

std::vector<Intrusion> intrusions(const std::vector<dvec3> &position, const Topology &t)
{
  std::vector<Intrusion> found;
  for (const Triangle &e : t.exact_face) {
    const dvec3 &a = position[e[0]], &b = position[e[1]], &c = position[e[2]];
    if (t.shape[e[0]] == ObstacleShape::plane) {
      const dvec3 n = dnormalize(dcross(dsub(b, a), dsub(c, a)));
      for (int v = 0; v < t.cloth_vertices; ++v)
        if (!(ddot(n, dsub(position[v], a)) > 0)) found.push_back({v, e[0]});
      continue;
    }
    const double r = t.radius[e[0]];
    const dvec3 lo{std::min(a.x, b.x) - r, std::min(a.y, b.y) - r, std::min(a.z, b.z) - r};
    const dvec3 hi{std::max(a.x, b.x) + r, std::max(a.y, b.y) + r, std::max(a.z, b.z) + r};
    for (std::size_t f = 0; f < t.face.size() && t.face[f][0] < t.cloth_vertices; ++f) {
      const dvec3 x[3] = {position[t.face[f][0]], position[t.face[f][1]], position[t.face[f][2]]};
      bool separated = false;
      for (int axis = 0; axis < 3; ++axis) {
        const double p = dcomponent(x[0], axis), q = dcomponent(x[1], axis), s = dcomponent(x[2], axis);
        separated =
            separated || std::max({p, q, s}) < dcomponent(lo, axis) || std::min({p, q, s}) > dcomponent(hi, axis);
      }
      if (!separated && segment_triangle(a, b, x, e[0] == e[1]) < r) found.push_back({static_cast<int>(f), e[0]});
    }
  }
  return found;
}

}  // namespace cama
