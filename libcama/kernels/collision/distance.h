/* SPDX-License-Identifier: Apache-2.0 */
/* Closest points of a vertex and a face, and of two edges, with the features clamped (Ericson, Real-Time Collision
   Detection, 5.1.5 and 5.1.9, in cross-product form). Coordinates are taken relative to one vertex of the pair, so the
   distance from the world's origin costs no digits. Every candidate is an actual point of the face or edges: `distance`
   is never below the true one by more than rounding, whatever the shape. */
#ifndef CAMA_KERNELS_COLLISION_DISTANCE_H
#define CAMA_KERNELS_COLLISION_DISTANCE_H
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"

typedef struct {
  double distance;    /* m */
  double weight[4];   /* signed: sum_k weight_k x_k = closest point of A minus closest point of B */
  dvec3 normal; /* unit, from B to A; where the distance is 0, normal of the face or common normal of the edges */
  int interior; /* 1: the closest points lie strictly inside the face, or strictly inside both edges */
} proximity;

/* Unit vector perpendicular to a; the z axis for the zero vector. */
DEVICE dvec3 any_perpendicular(dvec3 a)
{
  double x = fabs(a.x), y = fabs(a.y), z = fabs(a.z);
  dvec3 axis = dvec3_make(x <= y && x <= z ? 1.0 : 0.0, y < x && y <= z ? 1.0 : 0.0, z < x && z < y ? 1.0 : 0.0);
  dvec3 n = dcross(a, axis);
  return ddot(n, n) > 0.0 ? dnormalize(n) : dvec3_make(0.0, 0.0, 1.0);
}

/* Parameter in [0, 1] of the point of the segment s u that is closest to p; 0 for a segment of length zero. */
DEVICE double segment_parameter(dvec3 p, dvec3 u)
{
  double uu = ddot(u, u);
  return uu > 0.0 ? clamp_double(ddot(p, u) / uu, 0.0, 1.0) : 0.0;
}

/* The part of r perpendicular to u. */
DEVICE dvec3 segment_rejection(dvec3 r, dvec3 u) { return daxpy(r, -ddot(r, u) / ddot(u, u), u); }

/* Difference vector p - s u. Where the foot point is inside the segment, the part along u that rounding left is
   removed. */
DEVICE dvec3 segment_difference(dvec3 p, dvec3 u, double s)
{
  dvec3 r = daxpy(p, -s, u);
  return s > 0.0 && s < 1.0 ? segment_rejection(r, u) : r;
}

/* Sets distance and normal from the difference vector; `fallback` is the normal of touching features. */
DEVICE proximity finish_proximity(proximity p, dvec3 difference, dvec3 fallback, dvec3 along)
{
  p.distance = dnorm(difference);
  if (p.distance > 0.0)
    p.normal = dscale(1.0 / p.distance, difference);
  else if (ddot(fallback, fallback) > 0.0)
    p.normal = dnormalize(fallback);
  else
    p.normal = any_perpendicular(along);
  return p;
}

/* Vertex v against face (a, b, c): weights (1, -w_a, -w_b, -w_c). */
DEVICE proximity vertex_face_proximity(dvec3 v, dvec3 a, dvec3 b, dvec3 c)
{
  dvec3 p = dsub(v, a), u = dsub(b, a), w = dsub(c, a), n = dcross(u, w), m = dsub(c, b), r;
  double uu = ddot(u, u), ww = ddot(w, w), nn = ddot(n, n), sliver = 1e-6 * uu * ww, best, d, s;
  proximity result;
  result.interior = 0;
  best = -1.0;
  r = p;
  result.weight[0] = 1.0;
  result.weight[1] = -1.0;
  result.weight[2] = 0.0;
  result.weight[3] = 0.0;
  if (nn > 0.0) {
    double wb = ddot(dcross(p, w), n) / nn, wc = ddot(dcross(u, p), n) / nn, wa;
    if (!(nn > sliver)) { /* both weights are uncertain along the sliver: that of the longer edge follows from the
                             other */
      if (uu > ww)
        wb = ddot(daxpy(p, -wc, w), u) / uu;
      else
        wc = ddot(daxpy(p, -wb, u), w) / ww;
    }
    wa = 1.0 - wb - wc;
    if (wa > 0.0 && wb > 0.0 && wc > 0.0) {
      double h = ddot(p, n) / sqrt(nn);
      result.interior = 1;
      result.weight[1] = -wa;
      result.weight[2] = -wb;
      result.weight[3] = -wc;
      r = nn > sliver ? dscale(h / sqrt(nn), n) : segment_rejection(daxpy(daxpy(p, -wb, u), -wc, w), uu > ww ? u : w);
      best = ddot(r, r);
    }
  }
  if (!result.interior || !(nn > sliver)) { /* edges ab, ac, bc */
    dvec3 e;
    s = segment_parameter(p, u);
    e = segment_difference(p, u, s);
    d = ddot(e, e);
    if (best < 0.0 || d < best) {
      best = d;
      r = e;
      result.interior = 0;
      result.weight[1] = -(1.0 - s);
      result.weight[2] = -s;
      result.weight[3] = 0.0;
    }
    s = segment_parameter(p, w);
    e = segment_difference(p, w, s);
    d = ddot(e, e);
    if (d < best) {
      best = d;
      r = e;
      result.interior = 0;
      result.weight[1] = -(1.0 - s);
      result.weight[2] = 0.0;
      result.weight[3] = -s;
    }
    p = dsub(v, b);
    s = segment_parameter(p, m);
    e = segment_difference(p, m, s);
    d = ddot(e, e);
    if (d < best) {
      best = d;
      r = e;
      result.interior = 0;
      result.weight[1] = 0.0;
      result.weight[2] = -(1.0 - s);
      result.weight[3] = -s;
    }
  }
  return finish_proximity(result, r, n, uu > ww ? u : w);
}

/* Edge (a0, a1) against edge (b0, b1): weights (1-s, s, -(1-t), -t). Near-parallel edges also try the four end
   points. */
DEVICE proximity edge_edge_proximity(dvec3 a0, dvec3 a1, dvec3 b0, dvec3 b1)
{
  dvec3 u = dsub(a1, a0), v = dsub(b1, b0), q = dsub(b0, a0), n = dcross(u, v), r, e;
  double uu = ddot(u, u), vv = ddot(v, v), nn = ddot(n, n), parallel = 1e-6 * uu * vv, best = -1.0, d, s = 0.0, t = 0.0,
         k;
  proximity result;
  result.interior = 0;
  r = dscale(-1.0, q);
  if (nn > 0.0) {
    s = ddot(dcross(q, v), n) / nn;
    t = ddot(dcross(q, u), n) / nn;
    if (!(nn > parallel)) { /* both parameters are uncertain along the edges: that of the longer edge follows from the
                               other */
      if (uu > vv)
        s = ddot(daxpy(q, t, v), u) / uu;
      else
        t = ddot(dsub(dscale(s, u), q), v) / vv;
    }
    if (s > 0.0 && s < 1.0 && t > 0.0 && t < 1.0) {
      result.interior = 1;
      r = nn > parallel ? dscale(-ddot(q, n) / nn, n)
                        : segment_rejection(dsub(dscale(s, u), daxpy(q, t, v)), uu > vv ? u : v);
      best = ddot(r, r);
    }
  }
  if (!result.interior || !(nn > parallel)) {
    k = segment_parameter(dscale(-1.0, q), v);
    e = segment_difference(dscale(-1.0, q), v, k);
    d = ddot(e, e); /* a0 */
    if (best < 0.0 || d < best) {
      best = d;
      r = e;
      s = 0.0;
      t = k;
      result.interior = 0;
    }
    k = segment_parameter(dsub(a1, b0), v);
    e = segment_difference(dsub(a1, b0), v, k);
    d = ddot(e, e); /* a1 */
    if (d < best) {
      best = d;
      r = e;
      s = 1.0;
      t = k;
      result.interior = 0;
    }
    k = segment_parameter(q, u);
    e = segment_difference(q, u, k);
    d = ddot(e, e); /* b0 */
    if (d < best) {
      best = d;
      r = dscale(-1.0, e);
      s = k;
      t = 0.0;
      result.interior = 0;
    }
    k = segment_parameter(dsub(b1, a0), u);
    e = segment_difference(dsub(b1, a0), u, k);
    d = ddot(e, e); /* b1 */
    if (d < best) {
      best = d;
      r = dscale(-1.0, e);
      s = k;
      t = 1.0;
      result.interior = 0;
    }
  }
  result.weight[0] = 1.0 - s;
  result.weight[1] = s;
  result.weight[2] = -(1.0 - t);
  result.weight[3] = -t;
  return finish_proximity(result, r, n, uu > vv ? u : v);
}

#endif
