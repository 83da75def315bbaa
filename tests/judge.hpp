// SPDX-License-Identifier: Apache-2.0
// Distances in long double, independent of the library: the smallest over all pairs of sub-features.
#pragma once
#include <algorithm>
#include <cmath>

namespace judge {
using Real = long double;
struct Vec {
  Real x, y, z;
};
inline Vec operator-(Vec a, Vec b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Vec operator+(Vec a, Vec b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec operator*(Real s, Vec a) { return {s * a.x, s * a.y, s * a.z}; }
inline Real dot(Vec a, Vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vec cross(Vec a, Vec b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
inline Real length(Vec a) { return std::sqrt(dot(a, a)); }
inline Real point_segment(Vec p, Vec a, Vec b)
{
  const Vec u = b - a;
  const Real s = std::clamp<Real>(dot(p - a, u) / dot(u, u), 0, 1);
  return length(p - (a + s * u));
}
inline Real point_triangle(Vec p, Vec a, Vec b, Vec c)
{
  const Vec n = cross(b - a, c - a);
  Real d = std::min({point_segment(p, a, b), point_segment(p, b, c), point_segment(p, c, a)});
  if (dot(cross(b - a, p - a), n) > 0 && dot(cross(c - b, p - b), n) > 0 && dot(cross(a - c, p - c), n) > 0)
    d = std::min(d, std::fabs(dot(p - a, n)) / length(n));
  return d;
}
inline Real segment_segment(Vec a, Vec b, Vec c, Vec d)
{
  Real least =
      std::min({point_segment(a, c, d), point_segment(b, c, d), point_segment(c, a, b), point_segment(d, a, b)});
  const Vec u = b - a, v = d - c, n = cross(u, v);
  const Real nn = dot(n, n);
  if (nn > 0) {
    const Real s = dot(cross(c - a, v), n) / nn, t = dot(cross(c - a, u), n) / nn;
    if (s > 0 && s < 1 && t > 0 && t < 1) least = std::min(least, std::fabs(dot(c - a, n)) / std::sqrt(nn));
  }
  return least;
}
}  // namespace judge
