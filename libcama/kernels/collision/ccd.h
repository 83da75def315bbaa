/* SPDX-License-Identifier: Apache-2.0 */
/* Continuous collision of a vertex and a face, and of two edges, whose vertices move on straight lines over one step,
   times in [0, 1].

   Additive method with a directional certificate. A and B are the convex hulls of the first `split` and the remaining
   of four vertices x_i + s d_i. For ANY unit vector n, g(s) = min_{i in A, j in B} n.(x_i - x_j) + s n.(d_i - d_j)
   bounds the distance from below at every s, and is concave and piecewise linear, so the first s at which it falls to
   the required distance is known exactly: the pair cannot touch before. The method advances there, takes a new n from
   the closest points, and repeats. Where features turn about each other, a direction that turns too, (1 - s/h) n +
   (s/h) m with m the closest direction at s = h, goes much further: each cross pair is then a quadratic with an exact
   first root, and the direction is never longer than 1. n and m only decide how far a step goes, never whether it is
   right: the method relies on no computed distance. Only differences enter, so common motion costs nothing. */
#ifndef CAMA_KERNELS_COLLISION_CCD_H
#define CAMA_KERNELS_COLLISION_CCD_H
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"
#include "distance.h"

typedef struct {
  int hit;
  double time;
} impact_time;

#define CCD_ITERATIONS 64       /* beyond these the pair counts as hit, the safe answer */
#define CCD_ROUNDING 4e-14      /* bound on the rounding error of g, relative to the pair's extent */
/* Bound on the rounding error of a triple product, docs/theory/continuous-collision.md. */
#define CCD_DETERMINANT 7e-15
/* A pair nearer than this, relative to its extent, that is not certified to the end counts as hit. */
#define CCD_TOLERANCE 1e-9

DEVICE double largest_component(dvec3 a) { return max_double(fabs(a.x), max_double(fabs(a.y), fabs(a.z))); }

/* Closest points of the pair: split 1 is vertex-face, split 2 is edge-edge. */
DEVICE proximity hull_proximity(const dvec3 *x, int split)
{
  return split == 1 ? vertex_face_proximity(x[0], x[1], x[2], x[3]) : edge_edge_proximity(x[0], x[1], x[2], x[3]);
}

/* g(s) for s in {0, 1}: the least separation of the hulls of x + s d along n. */
DEVICE double hull_separation(const dvec3 *x, const dvec3 *d, int split, dvec3 n, double s)
{
  double least = 0.0, most = 0.0;
  for (int k = 0; k < 4; ++k) {
    double h = ddot(n, x[k]) + s * ddot(n, d[k]);
    if (k == 0 || (k < split && h < least)) least = h;
    if (k == split || (k > split && h > most)) most = h;
  }
  return least - most;
}

/* First s >= 0 at which g(s) = target along n, x taken at s = 0; 2 if never within [0, 1]. */
DEVICE double hull_advance(const dvec3 *x, const dvec3 *d, int split, dvec3 n, double target)
{
  double height[4], rate[4], first = 2.0;
  for (int k = 0; k < 4; ++k) {
    height[k] = ddot(n, x[k]);
    rate[k] = ddot(n, d[k]);
  }
  for (int i = 0; i < split; ++i)
    for (int j = split; j < 4; ++j) {
      double slack = height[i] - height[j] - target, closing = rate[j] - rate[i];
      if (closing > 0.0 && slack < first * closing) first = max_double(slack, 0.0) / closing;
    }
  return first;
}

/* First s in [0, 1] at which a s^2 + b s + c = 0, given c >= 0; 1 if there is none. */
DEVICE double first_quadratic_root(double a, double b, double c)
{
  double disc = b * b - 4.0 * a * c, q, root;
  if (!(a + b + c <= 0.0) && !(b < 0.0 && a > 0.0 && disc >= 0.0)) return 1.0;
  q = b < 0.0 ? 0.5 * (sqrt(max_double(disc, 0.0)) - b) : -0.5 * (sqrt(max_double(disc, 0.0)) + b);
  root = b < 0.0 ? c / q : q / a;
  return root >= 1.0 ? 1.0 : (root > 0.0 ? root : 0.0);
}

/* The same as hull_advance for the direction that turns from n at s = 0 to m at s = span; at most span. */
DEVICE double hull_advance_turning(const dvec3 *x, const dvec3 *d, int split, dvec3 n, dvec3 m, double span,
                                   double target)
{
  double first = 1.0;
  dvec3 turn = dsub(m, n);
  for (int i = 0; i < split; ++i)
    for (int j = split; j < 4; ++j) {
      dvec3 c = dsub(x[i], x[j]), e = dscale(span, dsub(d[i], d[j]));
      first = min_double(
          first, first_quadratic_root(ddot(turn, e), ddot(n, e) + ddot(turn, c), max_double(ddot(n, c) - target, 0.0)));
    }
  return first * span;
}

/* The same for the common normal N(s) = (u + s u') x (w + s w') of the edges u, w, or of the face with sides u, w:
   along it every cross pair has the distance of the planes, so contact needs a zero of the coplanarity cubic f(s) =
   N(s) . p(s). First s in [0, left] up to which f > target |N| is certain, reached from the left by quadratics that
   bound the remaining cubic from below; 2 if it is certain up to `left`. */
DEVICE double hull_advance_coplanar(const dvec3 *x, const dvec3 *d, int split, double target, double extent,
                                    double left)
{
  dvec3 u, e, w, f, p, q, n[3];
  double a[4], pm, um, wm, error, s = 0.0;
  int k, o = split == 1 ? 1 : 2;
  u = split == 1 ? dsub(x[2], x[1]) : dsub(x[1], x[0]);
  e = split == 1 ? dsub(d[2], d[1]) : dsub(d[1], d[0]);
  w = dsub(x[3], x[o]);
  f = dsub(d[3], d[o]);
  p = dsub(x[0], x[o]);
  q = dsub(d[0], d[o]);
  n[0] = dcross(u, w);
  n[1] = dadd(dcross(e, w), dcross(u, f));
  n[2] = dcross(e, f);
  a[0] = ddot(p, n[0]);
  a[1] = ddot(q, n[0]) + ddot(p, n[1]);
  a[2] = ddot(q, n[1]) + ddot(p, n[2]);
  a[3] = ddot(q, n[2]);
  if (a[0] < 0.0)
    for (k = 0; k < 4; ++k) a[k] = -a[k];
  pm = largest_component(p) + left * largest_component(q);
  um = largest_component(u) + left * largest_component(e);
  wm = largest_component(w) + left * largest_component(f);
  error = CCD_DETERMINANT * (extent * (um * wm + pm * wm + pm * um) + 2.0 * pm * um * wm);
  for (k = 0; k < 3; ++k) a[k] -= target * dnorm(n[k]);
  a[0] -= error;
  for (k = 0; k < 6 && a[0] > 0.0; ++k) {
    double rest = left - s,
           step = rest * first_quadratic_root((a[2] + min_double(0.0, a[3] * rest)) * rest * rest, a[1] * rest, a[0]);
    if (step >= rest) return 2.0;
    s += step;
    if (step <= 1e-3 * s) break;
    a[0] += step * (a[1] + step * (a[2] + step * a[3]));
    a[1] += step * (2.0 * a[2] + 3.0 * step * a[3]);
    a[2] += 3.0 * step * a[3];
  }
  return s;
}

/* 1 if a coordinate axis separates the moving hulls by more than `distance` for the whole step. */
DEVICE int axis_separated(const dvec3 *x, const dvec3 *d, int split, double distance)
{
  for (int axis = 0; axis < 3; ++axis) {
    double lo_a[2], hi_a[2], lo_b[2], hi_b[2];
    for (int s = 0; s < 2; ++s) {
      lo_a[s] = hi_a[s] = lo_b[s] = hi_b[s] = 0.0;
      for (int k = 0; k < 4; ++k) {
        double h = dcomponent(x[k], axis) + (s ? dcomponent(d[k], axis) : 0.0);
        if (k < split) {
          lo_a[s] = k == 0 ? h : min_double(lo_a[s], h);
          hi_a[s] = k == 0 ? h : max_double(hi_a[s], h);
        } else {
          lo_b[s] = k == split ? h : min_double(lo_b[s], h);
          hi_b[s] = k == split ? h : max_double(hi_b[s], h);
        }
      }
    }
    if (lo_a[0] - hi_b[0] > distance && lo_a[1] - hi_b[1] > distance) return 1;
    if (lo_b[0] - hi_a[0] > distance && lo_b[1] - hi_a[1] > distance) return 1;
  }
  return 0;
}

/* The iteration from time `start` on, up to which the pair is known to keep minimum_distance. x and d are relative to
   one vertex of the pair, `extent` is the sum of the largest coordinates at both ends, tolerance a fraction of it.
   There are no false negatives; the time is never after the first moment at which the distance is minimum_distance.
   most: iterations, beyond which the pair counts as hit at the time reached. */
DEVICE impact_time hull_impact_after(const dvec3 *x, const dvec3 *d, int split, double minimum_distance, double extent,
                                     double tolerance, double start, int most)
{
  double span = 0.0, turned, sure = minimum_distance + CCD_ROUNDING * extent,
         near = minimum_distance + tolerance * extent;
  impact_time result;
  result.hit = 0;
  result.time = 1.0;
  if (axis_separated(x, d, split, sure)) return result;
  result.hit = 1;
  result.time = start;
  for (int iteration = 0; iteration < most; ++iteration) {
    dvec3 y[4], n;
    double separation, step;
    for (int k = 0; k < 4; ++k) y[k] = daxpy(x[k], result.time, d[k]);
    n = hull_proximity(y, split).normal;
    separation = hull_separation(y, d, split, n, 0.0);
    if (!(separation > sure)) return result;
    step = hull_advance(y, d, split, n, sure);
    if (result.time + step <= 1.0)
      step = max_double(step, hull_advance_coplanar(y, d, split, sure, extent, 1.0 - result.time));
    if (iteration > 0 && result.time + step <= 1.0) {
      dvec3 z[4], m;
      span = min_double(max_double(2.0 * step, span), 1.0 - result.time);
      for (int k = 0; k < 4; ++k) z[k] = daxpy(y[k], span, d[k]);
      m = hull_proximity(z, split).normal;
      if (ddot(m, n) < 0.0) m = dscale(-1.0, m); /* beyond the contact, on the other side */
      turned = hull_advance_turning(y, d, split, n, m, span, sure);
      if (turned >= span && result.time + span >= 1.0) turned = 2.0;
      step = max_double(step, turned);
      span = turned >= span ? 4.0 * span : step;
    }
    if (result.time + step > 1.0) {
      result.hit = 0;
      result.time = 1.0;
      return result;
    }
    if (separation <= near || !(result.time + step > result.time)) return result;
    result.time += step;
  }
  return result;
}

DEVICE impact_time hull_impact_time(const dvec3 *x, const dvec3 *d, int split, double minimum_distance, double extent,
                                    double tolerance)
{
  return hull_impact_after(x, d, split, minimum_distance, extent, tolerance, 0.0, CCD_ITERATIONS);
}

/* x and d relative to the first vertex; returns `extent`. */
DEVICE double relative_motion(const dvec3 *from, const dvec3 *to, dvec3 *x, dvec3 *d)
{
  double start = 0.0, end = 0.0;
  x[0] = d[0] = dvec3_make(0.0, 0.0, 0.0);
  for (int k = 1; k < 4; ++k) {
    x[k] = dsub(from[k], from[0]);
    d[k] = dsub(to[k], to[0]);
    start = max_double(start, largest_component(x[k]));
    end = max_double(end, largest_component(d[k]));
    d[k] = dsub(d[k], x[k]);
  }
  return start + end;
}

DEVICE void four_points(dvec3 *x, dvec3 a, dvec3 b, dvec3 c, dvec3 d)
{
  x[0] = a;
  x[1] = b;
  x[2] = c;
  x[3] = d;
}

DEVICE impact_time linear_impact_time(int split, dvec3 a0, dvec3 b0, dvec3 c0, dvec3 d0, dvec3 a1, dvec3 b1, dvec3 c1,
                                      dvec3 d1, double minimum_distance, int most)
{
  dvec3 from[4], to[4], x[4], d[4];
  double extent;
  four_points(from, a0, b0, c0, d0);
  four_points(to, a1, b1, c1, d1);
  extent = relative_motion(from, to, x, d);
  return hull_impact_after(x, d, split, minimum_distance, extent, CCD_TOLERANCE, 0.0, most);
}

/* Vertex v against face (a, b, c) moving from positions 0 to positions 1. minimum_distance: m. */
DEVICE impact_time vertex_face_impact_time(dvec3 v0, dvec3 a0, dvec3 b0, dvec3 c0, dvec3 v1, dvec3 a1, dvec3 b1,
                                           dvec3 c1, double minimum_distance)
{
  return linear_impact_time(1, v0, a0, b0, c0, v1, a1, b1, c1, minimum_distance, CCD_ITERATIONS);
}

/* Edge (a, b) against edge (c, d). */
DEVICE impact_time edge_edge_impact_time(dvec3 a0, dvec3 b0, dvec3 c0, dvec3 d0, dvec3 a1, dvec3 b1, dvec3 c1, dvec3 d1,
                                         double minimum_distance)
{
  return linear_impact_time(2, a0, b0, c0, d0, a1, b1, c1, d1, minimum_distance, CCD_ITERATIONS);
}

#endif
