/* SPDX-License-Identifier: Apache-2.0 */
/* Touch, decided in double-double: where the iteration of ccd.h cannot distinguish a pair from a contact (nearer than
   its rounding, 4e-14 of the extent), the pair advances in numbers with twice the digits, then the iteration continues.
   Minimum distance 0. */
#ifndef CAMA_KERNELS_COLLISION_TOUCH_H
#define CAMA_KERNELS_COLLISION_TOUCH_H
#include "../dialect/double_double.h"
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"
#include "ccd.h"
#include "distance.h"

/* Bound on the rounding error of a separation in double-double, relative to the extent and |n|. */
#define TOUCH_ROUNDING 1e-29
#define TOUCH_CLEAR 1e-12 /* of the extent: from this separation on, double continues */
#define TOUCH_INSIDE 1e-6 /* closest points so far inside the face or edges: a contact, not tested again */

/* Advances along n, which need not be a unit vector, from y as hull_advance does; sets *separation, divided by |n|.
   Returns 0 if n does not separate. */
DEVICE double touch_advance(const double_double3 *y, const double_double3 *d, int split, double_double3 n,
                            double extent, double *separation)
{
  double_double h[4], r[4], least, most;
  double size = largest_component(dd3_rounded(n)), first = 2.0, margin = TOUCH_ROUNDING * extent * size;
  int flip = 0;
  *separation = 0.0;
  if (!(size > 0.0)) return 0.0;
  for (int k = 0; k < 4; ++k) h[k] = dd3_dot(n, y[k]);
  if (dd_less(h[0], h[split])) {
    flip = 1;
    for (int k = 0; k < 4; ++k) h[k] = dd_negate(h[k]);
  }
  least = split == 2 && dd_less(h[1], h[0]) ? h[1] : h[0];
  most = h[split];
  for (int k = split + 1; k < 4; ++k)
    if (dd_less(most, h[k])) most = h[k];
  *separation = dd_subtract(least, most).hi - margin;
  if (!(*separation > 0.0)) return 0.0;
  for (int k = 0; k < 4; ++k) {
    r[k] = dd3_dot(n, d[k]);
    if (flip) r[k] = dd_negate(r[k]);
  }
  for (int i = 0; i < split; ++i)
    for (int j = split; j < 4; ++j) {
      double slack = dd_subtract(h[i], h[j]).hi - margin, closing = dd_subtract(r[j], r[i]).hi;
      if (closing > 0.0 && slack < first * closing) first = (1.0 - 1e-9) * slack / closing;
    }
  *separation /= 2.0 * size;
  return first;
}

/* Direction number k of the pair: common normal; then vertex to side; then vertex to vertex. 7 for vertex-face, 9 for
   edge-edge. */
DEVICE double_double3 touch_direction(const double_double3 *y, int split, int k)
{
  double_double3 p, u;
  int from, a, b;
  if (k == 0)
    return split == 1 ? dd3_cross(dd3_subtract(y[2], y[1]), dd3_subtract(y[3], y[1]))
                      : dd3_cross(dd3_subtract(y[1], y[0]), dd3_subtract(y[3], y[2]));
  --k;
  if (split == 1) {
    if (k >= 3) return dd3_subtract(y[0], y[k - 2]);
    from = 0;
    a = 1 + k;
    b = 1 + (k + 1) % 3;
  } else {
    if (k >= 4) return dd3_subtract(y[(k - 4) / 2], y[2 + (k & 1)]);
    from = k;
    a = k < 2 ? 2 : 0;
    b = a + 1;
  }
  p = dd3_subtract(y[from], y[a]);
  u = dd3_subtract(y[b], y[a]);
  return dd3_cross(dd3_cross(u, p), u); /* the part of p perpendicular to u, times u.u */
}

/* From `time`, up to which the pair does not touch, to a time from which double can continue; 2 if it never touches, -1
   if it may. */
DEVICE double touch_pass(const dvec3 *from, const dvec3 *to, int split, double extent, double time)
{
  double_double3 x[4], d[4], y[4];
  double_double t = dd_make(time);
  int directions = split == 1 ? 7 : 9, last = 0;
  for (int k = 0; k < 4; ++k) {
    x[k] = dd3_difference(from[k], from[0]);
    d[k] = dd3_subtract(dd3_difference(to[k], to[0]), x[k]);
  }
  for (int iteration = 0; iteration < CCD_ITERATIONS; ++iteration) {
    double best = 0.0, apart = 0.0;
    for (int k = 0; k < 4; ++k) y[k] = dd3_axpy(x[k], t, d[k]);
    for (int k = 0; k < directions; ++k) {
      double separation,
          step = touch_advance(y, d, split, touch_direction(y, split, (k + last) % directions), extent, &separation);
      apart = max_double(apart, separation);
      if (step > best) best = step;
      if (t.hi + step > 1.0) return 2.0;
    }
    if (apart > TOUCH_CLEAR * extent && t.hi - 1e-15 > time) return t.hi - (t.lo < 0.0 ? 3e-16 : 0.0);
    if (!(best > 0.0)) return -1.0;
    t = dd_add(t, dd_make(best));
    if (!(t.hi <= 1.0)) return 2.0;
  }
  return -1.0;
}

/* As linear_impact_time with minimum distance 0; pairs that pass each other nearer than double can distinguish are
   tested again in double-double. */
DEVICE impact_time linear_touch_time(int split, dvec3 a0, dvec3 b0, dvec3 c0, dvec3 d0, dvec3 a1, dvec3 b1, dvec3 c1,
                                     dvec3 d1)
{
  dvec3 from[4], to[4], x[4], d[4], y[4];
  impact_time result;
  double extent, time;
  four_points(from, a0, b0, c0, d0);
  four_points(to, a1, b1, c1, d1);
  extent = relative_motion(from, to, x, d);
  result = hull_impact_time(x, d, split, 0.0, extent, CCD_TOLERANCE);
  for (int pass = 0; pass < 8 && result.hit; ++pass) {
    proximity p;
    for (int k = 0; k < 4; ++k) y[k] = daxpy(x[k], result.time, d[k]);
    p = hull_proximity(y, split);
    time = 1.0;
    for (int k = 0; k < 4; ++k) time = min_double(time, fabs(p.weight[k]));
    if (p.interior && time > TOUCH_INSIDE) return result;
    time = touch_pass(from, to, split, extent, result.time);
    if (time < 0.0) return result;
    if (time > 1.0) {
      result.hit = 0;
      result.time = 1.0;
      return result;
    }
    result = hull_impact_after(x, d, split, 0.0, extent, CCD_TOLERANCE, time, CCD_ITERATIONS);
  }
  return result;
}

#endif
