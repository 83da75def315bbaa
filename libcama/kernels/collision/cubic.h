/* SPDX-License-Identifier: Apache-2.0 */
/* The paper's test: roots of the coplanarity cubic, then an inside test (Section 5; Provot 1997), with a forward error
   bound in place of tolerances and the customary early-outs (after Wang 2014). Minimum distance 0. */
#ifndef CAMA_KERNELS_COLLISION_CUBIC_H
#define CAMA_KERNELS_COLLISION_CUBIC_H
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"
#include "ccd.h"

/* 261 u, with u = 2^-53: bound on the rounding error of the coplanarity cubic, relative to the product of three
   extents. */
#define CUBIC_ROUNDING 2.9e-14
#define CUBIC_TOUCH 1e-13       /* plays the part of CCD_TOLERANCE where the additive method decides for the cubic */

/* Value of the cubic with coefficients c. */
DEVICE double cubic_value(const double *c, double t) { return c[0] + t * (c[1] + t * (c[2] + t * c[3])); }

/* The root of a cubic that changes sign over [lo, hi] and is monotone there: bisection, sped up by Newton's method
   while its iterate stays inside. */
DEVICE double cubic_root(const double *c, double lo, double hi)
{
  int rising = cubic_value(c, lo) < 0.0;
  double t = 0.5 * (lo + hi);
  for (int k = 0; k < 80 && hi - lo > 1e-16; ++k) {
    double f = cubic_value(c, t), slope = c[1] + t * (2.0 * c[2] + 3.0 * t * c[3]), next;
    if (f == 0.0) return t;
    if ((f < 0.0) == rising)
      lo = t;
    else
      hi = t;
    next = slope != 0.0 ? t - f / slope : lo;
    if (!(next > lo && next < hi))
      next = 0.5 * (lo + hi);
    else if (fabs(next - t) < 1e-16)
      return next;
    t = next;
  }
  return t;
}

/* end: 0, the turning points inside (0, 1) in ascending order, 1; returns their number. Between them the cubic is
   monotone. */
DEVICE int cubic_pieces(const double *c, double *end)
{
  /* derivative a t^2 + 2 b t + e, roots without cancellation */
  double a = 3.0 * c[3], b = c[2], e = c[1], disc = b * b - a * e;
  int count = 1;
  end[0] = 0.0;
  if (disc >= 0.0) {
    double q = -(b + (b < 0.0 ? -sqrt(disc) : sqrt(disc))), r0 = a != 0.0 ? q / a : -1.0, r1 = q != 0.0 ? e / q : -1.0;
    double first = min_double(r0, r1), second = max_double(r0, r1);
    if (first > 0.0 && first < 1.0) end[count++] = first;
    if (second > first && second > 0.0 && second < 1.0) end[count++] = second;
  }
  end[count++] = 1.0;
  return count;
}

/* A time with |f| > bound on the way from `in`, with |f| <= bound, to `out`, with |f| > bound: from the tangent where
   that holds, else by bisection. */
DEVICE double cubic_leave(const double *c, double in, double out, double bound)
{
  double slope = fabs(c[1] + in * (2.0 * c[2] + 3.0 * in * c[3])), lo = in, hi = out;
  if (slope > 0.0) {
    double t = in + (out > in ? 1.0 : -1.0) * (4.0 * bound / slope + 4e-16);
    if ((t < out) == (out > in) && fabs(cubic_value(c, t)) > bound) return t;
  }
  for (int k = 0; k < 60; ++k) {
    double t = 0.5 * (lo + hi);
    if (fabs(cubic_value(c, t)) > bound)
      hi = t;
    else
      lo = t;
  }
  return hi;
}

DEVICE double triple_product(dvec3 a, dvec3 b, dvec3 c) { return ddot(a, dcross(b, c)); }

/* There are no false negatives: contact needs |f| <= bound for f as computed. That holds in at most one interval of
   each monotone piece. Where the interval is short, the pair hardly moves in it: a pair that a direction separates by
   more at one moment does not touch. Where it is long (coplanar, grazing motion), the additive method decides. The time
   is that of the root where there is one. docs/theory/continuous-collision.md derives the bound. */
DEVICE impact_time linear_impact_cubic(int split, dvec3 a0, dvec3 b0, dvec3 c0, dvec3 d0, dvec3 a1, dvec3 b1, dvec3 c1,
                                       dvec3 d1)
{
  dvec3 from[4], to[4], x[4], d[4], y[4];
  double c[4], end[4], extent, speed = 0.0, bound = CUBIC_ROUNDING;
  impact_time result;
  int count;
  four_points(from, a0, b0, c0, d0);
  four_points(to, a1, b1, c1, d1);
  extent = relative_motion(from, to, x, d);
  result.hit = 0;
  result.time = 1.0;
  if (axis_separated(x, d, split, CCD_ROUNDING * extent)) return result;
  c[0] = triple_product(x[1], x[2], x[3]);
  c[1] = triple_product(d[1], x[2], x[3]) + triple_product(x[1], d[2], x[3]) + triple_product(x[1], x[2], d[3]);
  c[2] = triple_product(x[1], d[2], d[3]) + triple_product(d[1], x[2], d[3]) + triple_product(d[1], d[2], x[3]);
  c[3] = triple_product(d[1], d[2], d[3]);
  for (int k = 1; k < 4; ++k) {
    bound *= largest_component(x[k]) + largest_component(d[k]);
    /* the relative motion of any two vertices is at most twice this in each component */
    speed = max_double(speed, largest_component(d[k]));
  }
  count = cubic_pieces(c, end);
  for (int k = 0; k + 1 < count; ++k) {
    double lo = end[k], hi = end[k + 1], f0 = cubic_value(c, lo), f1 = cubic_value(c, hi), at, reach;
    if (min_double(f0, f1) > bound || max_double(f0, f1) < -bound) continue;
    if ((f0 < 0.0 && f1 > 0.0) || (f0 > 0.0 && f1 < 0.0))
      at = cubic_root(c, lo, hi);
    else
      at = fabs(f0) <= fabs(f1) ? lo : hi;
    if (fabs(f0) > bound) lo = cubic_leave(c, at, lo, bound);
    if (fabs(f1) > bound) hi = cubic_leave(c, at, hi, bound);
    for (int i = 0; i < 4; ++i) y[i] = daxpy(x[i], at, d[i]);
    reach = 4.0 * speed * (hi - lo);
    if (reach <= CCD_TOLERANCE * extent) {
      if (hull_separation(y, d, split, hull_proximity(y, split).normal, 0.0) > reach + CCD_ROUNDING * extent) continue;
    } else {
      dvec3 e[4];
      for (int i = 0; i < 4; ++i) {
        y[i] = daxpy(x[i], lo, d[i]);
        e[i] = dscale(hi - lo, d[i]);
      }
      result = hull_impact_time(y, e, split, 0.0, extent, CUBIC_TOUCH);
      if (!result.hit) continue;
      at = lo + result.time * (hi - lo);
    }
    result.hit = 1;
    result.time = at;
    return result;
  }
  result.time = 1.0;
  return result;
}

DEVICE impact_time vertex_face_impact_cubic(dvec3 v0, dvec3 a0, dvec3 b0, dvec3 c0, dvec3 v1, dvec3 a1, dvec3 b1,
                                            dvec3 c1)
{
  return linear_impact_cubic(1, v0, a0, b0, c0, v1, a1, b1, c1);
}
DEVICE impact_time edge_edge_impact_cubic(dvec3 a0, dvec3 b0, dvec3 c0, dvec3 d0, dvec3 a1, dvec3 b1, dvec3 c1,
                                          dvec3 d1)
{
  return linear_impact_cubic(2, a0, b0, c0, d0, a1, b1, c1, d1);
}

#endif
