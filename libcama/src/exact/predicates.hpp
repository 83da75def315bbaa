// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cmath>

#include "cama/types.hpp"

/// Exact signs of orientation determinants: a filtered double evaluation, then expansions (Shewchuk 1997) over the
/// coordinates themselves. They are exact as long as products of three coordinates neither overflow nor fall below
/// 1e-290. They need strict floating-point arithmetic.
namespace cama::exact {

/// A sum of doubles without rounding: components do not overlap and grow in size, so the last nonzero one has the sum's
/// sign.
class Expansion {
public:
  void add(double x)
  {
    int kept = 0;
    for (int k = 0; k < size_; ++k) {
      const double sum = x + part_[k], y = sum - x, error = (x - (sum - y)) + (part_[k] - y);  // two-sum
      if (error != 0) part_[kept++] = error;
      x = sum;
    }
    if (x != 0) part_[kept++] = x;
    size_ = kept;
  }
  void add_product(double x, double y)
  {
    const double p = x * y;
    add(std::fma(x, y, -p));
    add(p);
  }
  void add_product(double x, double y, double z)
  {
    const double p = x * y;
    add_product(std::fma(x, y, -p), z);
    add_product(p, z);
  }
  int sign() const { return size_ == 0 ? 0 : (part_[size_ - 1] > 0 ? 1 : -1); }

private:
  std::array<double, 100> part_;  // 24 products of three coordinates have at most 96 parts
  int size_ = 0;
};

inline void add_triple(Expansion &sum, double sign, dvec3 a, dvec3 b, dvec3 c)
{
  sum.add_product(sign * a.x, b.y, c.z);
  sum.add_product(-sign * a.x, b.z, c.y);
  sum.add_product(sign * a.y, b.z, c.x);
  sum.add_product(-sign * a.y, b.x, c.z);
  sum.add_product(sign * a.z, b.x, c.y);
  sum.add_product(-sign * a.z, b.y, c.x);
}

/// Sign of det(a - d, b - d, c - d): the side of the plane through a, b, c on which d lies; 0 if coplanar.
inline int orientation(dvec3 a, dvec3 b, dvec3 c, dvec3 d)
{
  const double ax = a.x - d.x, ay = a.y - d.y, az = a.z - d.z, bx = b.x - d.x, by = b.y - d.y, bz = b.z - d.z;
  const double cx = c.x - d.x, cy = c.y - d.y, cz = c.z - d.z;
  // In a plane across an axis, as sheets often start.
  const auto zero = [](double u, double v, double w) { return u == 0 && v == 0 && w == 0; };
  if (zero(az, bz, cz) || zero(ax, bx, cx) || zero(ay, by, cy)) return 0;
  const double value = az * (bx * cy - cx * by) + bz * (cx * ay - ax * cy) + cz * (ax * by - bx * ay);
  const double size = std::fabs(az) * (std::fabs(bx * cy) + std::fabs(cx * by)) +
                      std::fabs(bz) * (std::fabs(cx * ay) + std::fabs(ax * cy)) +
                      std::fabs(cz) * (std::fabs(ax * by) + std::fabs(bx * ay));
  const double bound = 7.8e-16 * size;  // Shewchuk's (7 + 56 u) u
  if (value > bound) return 1;
  if (-value > bound) return -1;
  Expansion sum;
  add_triple(sum, 1, a, b, c);
  add_triple(sum, -1, d, b, c);
  add_triple(sum, -1, a, d, c);
  add_triple(sum, -1, a, b, d);
  return sum.sign();
}

/// Sign of the turn a, b, c projected along `axis`.
inline int orientation(dvec3 a, dvec3 b, dvec3 c, int axis)
{
  const int i = (axis + 1) % 3, j = (axis + 2) % 3;
  const double ai = dcomponent(a, i), aj = dcomponent(a, j), bi = dcomponent(b, i), bj = dcomponent(b, j);
  const double ci = dcomponent(c, i), cj = dcomponent(c, j);
  if ((ai == ci && bi == ci) || (aj == cj && bj == cj)) return 0;  // on a line along an axis
  const double left = (ai - ci) * (bj - cj), right = (aj - cj) * (bi - ci), value = left - right;
  const double bound = 3.4e-16 * (std::fabs(left) + std::fabs(right));  // (3 + 16 u) u
  if (value > bound) return 1;
  if (-value > bound) return -1;
  Expansion sum;
  sum.add_product(ai, bj);
  sum.add_product(-aj, bi);
  sum.add_product(bi, cj);
  sum.add_product(-bj, ci);
  sum.add_product(ci, aj);
  sum.add_product(-cj, ai);
  return sum.sign();
}

/// Whether the closed segments pq and ab meet, projected along `axis`.
inline bool segments_meet(dvec3 p, dvec3 q, dvec3 a, dvec3 b, int axis)
{
  const int pa = orientation(p, q, a, axis), pb = orientation(p, q, b, axis), ap = orientation(a, b, p, axis),
            aq = orientation(a, b, q, axis);
  if (pa * pb > 0 || ap * aq > 0) return false;
  if (pa != 0 || pb != 0 || ap != 0 || aq != 0) return true;
  for (int k = 1; k <= 2; ++k) {  // on one line: their extents decide
    const int c = (axis + k) % 3;
    const double p_c = dcomponent(p, c), q_c = dcomponent(q, c), a_c = dcomponent(a, c), b_c = dcomponent(b, c);
    if (std::fmin(p_c, q_c) > std::fmax(a_c, b_c) || std::fmin(a_c, b_c) > std::fmax(p_c, q_c)) return false;
  }
  return true;
}

/// Whether closed segments in one plane meet. Coplanar segments meet if and only if all three projections do.
inline bool coplanar_segments_meet(dvec3 p, dvec3 q, dvec3 a, dvec3 b)
{
  return orientation(p, q, a, b) == 0 && segments_meet(p, q, a, b, 0) && segments_meet(p, q, a, b, 1) &&
         segments_meet(p, q, a, b, 2);
}

/// Whether the closed segment pq and the closed triangle abc have a point in common.
inline bool segment_meets_triangle(dvec3 p, dvec3 q, dvec3 a, dvec3 b, dvec3 c)
{
  const int side_p = orientation(a, b, c, p), side_q = orientation(a, b, c, q);
  if (side_p * side_q > 0) return false;
  if (side_p != 0 || side_q != 0) {  // the line crosses the plane in one point
    const int ab = orientation(p, q, a, b), bc = orientation(p, q, b, c), ca = orientation(p, q, c, a);
    return (ab >= 0 && bc >= 0 && ca >= 0) || (ab <= 0 && bc <= 0 && ca <= 0);
  }
  if (coplanar_segments_meet(p, q, a, b) || coplanar_segments_meet(p, q, b, c) || coplanar_segments_meet(p, q, c, a))
    return true;
  for (int axis = 0; axis < 3; ++axis) {  // p inside, seen along an axis in which the triangle has area
    const int turn = orientation(a, b, c, axis);
    if (turn != 0)
      return orientation(a, b, p, axis) == turn && orientation(b, c, p, axis) == turn &&
             orientation(c, a, p, axis) == turn;
  }
  return false;
}

}  // namespace cama::exact
