/* SPDX-License-Identifier: Apache-2.0 */
/* Continuous collision of a vertex and a face, and of two edges, whose vertices move on straight lines over one step, times in [0, 1].

   Additive method with a directional certificate. A and B are the convex hulls of the first `split` and the remaining of four
   vertices x_i + s d_i. For ANY unit vector n, g(s) = min_{i in A, j in B} n.(x_i - x_j) + s n.(d_i - d_j) bounds the distance from
   below at every s, and is concave and piecewise linear, so the first s at which it falls to the wanted distance is known exactly:
   the pair cannot touch before. Advance there, take n anew from the closest points, repeat. Where features turn about each other, a
   direction that turns too, (1 - s/h) n + (s/h) m with m the closest direction at s = h, goes much further: each cross pair is then a
   quadratic, its first root exact, and the direction is never longer than 1. n and m only decide how far a step goes, never whether
   it is right; no distance is trusted. Only differences enter, so common motion costs nothing. */

typedef struct { int hit; double time; } impact_time;

#define CCD_ITERATIONS 64       /* more means "hit at the time reached", the safe answer */
#define CCD_ROUNDING 4e-14      /* bound on the rounding error of g over the pair's extent */
#define CCD_DETERMINANT 7e-15   /* bound on the rounding error of a triple product, docs/ccd.md */
#define CCD_TOLERANCE 1e-9      /* a pair nearer than this, over its extent, that is not certified to the end counts as hit */
#define CUBIC_ROUNDING 2.9e-14  /* 256 u: bound on the rounding error of the coplanarity cubic over the product of three extents */
#define CUBIC_TOUCH 1e-13       /* as CCD_TOLERANCE, where the additive method decides for the cubic */

DEVICE double largest_component(dvec3 a) { return max_double(fabs(a.x), max_double(fabs(a.y), fabs(a.z))); }

/* Closest features of the pair: split 1 is vertex-face, split 2 is edge-edge. */
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
  for (int k = 0; k < 4; ++k) { height[k] = ddot(n, x[k]); rate[k] = ddot(n, d[k]); }
  for (int i = 0; i < split; ++i)
    for (int j = split; j < 4; ++j) {
      double room = height[i] - height[j] - target, closing = rate[j] - rate[i];
      if (closing > 0.0 && room < first * closing) first = max_double(room, 0.0) / closing;
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
DEVICE double hull_advance_turning(const dvec3 *x, const dvec3 *d, int split, dvec3 n, dvec3 m, double span, double target)
{
  double first = 1.0;
  dvec3 turn = dsub(m, n);
  for (int i = 0; i < split; ++i)
    for (int j = split; j < 4; ++j) {
      dvec3 c = dsub(x[i], x[j]), e = dscale(span, dsub(d[i], d[j]));
      first = min_double(first, first_quadratic_root(ddot(turn, e), ddot(n, e) + ddot(turn, c), max_double(ddot(n, c) - target, 0.0)));
    }
  return first * span;
}

/* The same for the common normal N(s) = (u + s u') x (w + s w') of the edges u, w, or of the face with sides u, w: along it every cross
   pair is as far apart as the planes, so contact needs a zero of the coplanarity cubic f(s) = N(s) . p(s). First s in [0, left] up to which
   f > target |N| is certain, reached from the left by quadratics below what is left of it; 2 if that is so up to `left`. */
DEVICE double hull_advance_coplanar(const dvec3 *x, const dvec3 *d, int split, double target, double extent, double left)
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
  if (a[0] < 0.0) for (k = 0; k < 4; ++k) a[k] = -a[k];
  pm = largest_component(p) + left * largest_component(q);
  um = largest_component(u) + left * largest_component(e);
  wm = largest_component(w) + left * largest_component(f);
  error = CCD_DETERMINANT * (extent * (um * wm + pm * wm + pm * um) + 2.0 * pm * um * wm);
  for (k = 0; k < 3; ++k) a[k] -= target * dnorm(n[k]);
  a[0] -= error;
  for (k = 0; k < 6 && a[0] > 0.0; ++k) {
    double rest = left - s, step = rest * first_quadratic_root((a[2] + min_double(0.0, a[3] * rest)) * rest * rest, a[1] * rest, a[0]);
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
        if (k < split) { lo_a[s] = k == 0 ? h : min_double(lo_a[s], h); hi_a[s] = k == 0 ? h : max_double(hi_a[s], h); }
        else { lo_b[s] = k == split ? h : min_double(lo_b[s], h); hi_b[s] = k == split ? h : max_double(hi_b[s], h); }
      }
    }
    if (lo_a[0] - hi_b[0] > distance && lo_a[1] - hi_b[1] > distance) return 1;
    if (lo_b[0] - hi_a[0] > distance && lo_b[1] - hi_a[1] > distance) return 1;
  }
  return 0;
}

/* The loop, from time `start` on, up to which the pair is known to keep minimum_distance. x and d are relative to one vertex of the pair,
   `extent` the largest coordinate at both ends together, tolerance a part of it. No false negative; the time is never after the first
   moment at which the distance is minimum_distance. */
DEVICE impact_time hull_impact_after(const dvec3 *x, const dvec3 *d, int split, double minimum_distance, double extent, double tolerance,
                                     double start)
{
  double span = 0.0, turned, sure = minimum_distance + CCD_ROUNDING * extent, near = minimum_distance + tolerance * extent;
  impact_time result;
  result.hit = 0;
  result.time = 1.0;
  if (axis_separated(x, d, split, sure)) return result;
  result.hit = 1;
  result.time = start;
  for (int iteration = 0; iteration < CCD_ITERATIONS; ++iteration) {
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
      if (ddot(m, n) < 0.0) m = dscale(-1.0, m);   /* beyond the contact, on the other side */
      turned = hull_advance_turning(y, d, split, n, m, span, sure);
      if (turned >= span && result.time + span >= 1.0) turned = 2.0;
      step = max_double(step, turned);
      span = turned >= span ? 4.0 * span : step;
    }
    if (result.time + step > 1.0) { result.hit = 0; result.time = 1.0; return result; }
    if (separation <= near || !(result.time + step > result.time)) return result;
    result.time += step;
  }
  return result;
}

DEVICE impact_time hull_impact_time(const dvec3 *x, const dvec3 *d, int split, double minimum_distance, double extent, double tolerance)
{
  return hull_impact_after(x, d, split, minimum_distance, extent, tolerance, 0.0);
}

/* x, d relative to the first vertex; returns `extent`. */
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

DEVICE void four_points(dvec3 *x, dvec3 a, dvec3 b, dvec3 c, dvec3 d) { x[0] = a; x[1] = b; x[2] = c; x[3] = d; }

DEVICE impact_time linear_impact_time(int split, dvec3 a0, dvec3 b0, dvec3 c0, dvec3 d0, dvec3 a1, dvec3 b1, dvec3 c1, dvec3 d1,
                                    double minimum_distance)
{
  dvec3 from[4], to[4], x[4], d[4];
  double extent;
  four_points(from, a0, b0, c0, d0);
  four_points(to, a1, b1, c1, d1);
  extent = relative_motion(from, to, x, d);
  return hull_impact_time(x, d, split, minimum_distance, extent, CCD_TOLERANCE);
}

/* Vertex v against face (a, b, c) moving from positions 0 to positions 1. minimum_distance: m. */
DEVICE impact_time vertex_face_impact_time(dvec3 v0, dvec3 a0, dvec3 b0, dvec3 c0, dvec3 v1, dvec3 a1, dvec3 b1, dvec3 c1,
                                           double minimum_distance)
{
  return linear_impact_time(1, v0, a0, b0, c0, v1, a1, b1, c1, minimum_distance);
}

/* Edge (a, b) against edge (c, d). */
DEVICE impact_time edge_edge_impact_time(dvec3 a0, dvec3 b0, dvec3 c0, dvec3 d0, dvec3 a1, dvec3 b1, dvec3 c1, dvec3 d1,
                                         double minimum_distance)
{
  return linear_impact_time(2, a0, b0, c0, d0, a1, b1, c1, d1, minimum_distance);
}

/* Touch, decided in double-double: what the loop above cannot tell from contact (nearer than its rounding, 4e-14 of extent) is passed in
   numbers with twice the digits, then the loop goes on. Minimum distance 0. */

#define TOUCH_ROUNDING 1e-29    /* bound on the rounding error of a separation in double-double, over extent and |n| */
#define TOUCH_CLEAR 1e-12       /* of the extent: so far apart, double goes on */
#define TOUCH_INSIDE 1e-6       /* closest points so far inside face or edges: a contact, without a second look */

/* Advance along n, which need not be unit, from y: as hull_advance; sets *separation over |n|. 0 if n does not separate. */
DEVICE double touch_advance(const double_double3 *y, const double_double3 *d, int split, double_double3 n, double extent,
                            double *separation)
{
  double_double h[4], r[4], least, most;
  double size = largest_component(dd3_rounded(n)), first = 2.0, margin = TOUCH_ROUNDING * extent * size;
  int flip = 0;
  *separation = 0.0;
  if (!(size > 0.0)) return 0.0;
  for (int k = 0; k < 4; ++k) h[k] = dd3_dot(n, y[k]);
  if (dd_less(h[0], h[split])) { flip = 1; for (int k = 0; k < 4; ++k) h[k] = dd_negate(h[k]); }
  least = split == 2 && dd_less(h[1], h[0]) ? h[1] : h[0];
  most = h[split];
  for (int k = split + 1; k < 4; ++k) if (dd_less(most, h[k])) most = h[k];
  *separation = dd_subtract(least, most).hi - margin;
  if (!(*separation > 0.0)) return 0.0;
  for (int k = 0; k < 4; ++k) { r[k] = dd3_dot(n, d[k]); if (flip) r[k] = dd_negate(r[k]); }
  for (int i = 0; i < split; ++i)
    for (int j = split; j < 4; ++j) {
      double room = dd_subtract(h[i], h[j]).hi - margin, closing = dd_subtract(r[j], r[i]).hi;
      if (closing > 0.0 && room < first * closing) first = (1.0 - 1e-9) * room / closing;
    }
  *separation /= 2.0 * size;
  return first;
}

/* Direction number k of the pair: common normal; then vertex to side; then vertex to vertex. 7 for vertex-face, 9 for edge-edge. */
DEVICE double_double3 touch_direction(const double_double3 *y, int split, int k)
{
  double_double3 p, u;
  int from, a, b;
  if (k == 0) return split == 1 ? dd3_cross(dd3_subtract(y[2], y[1]), dd3_subtract(y[3], y[1]))
                                : dd3_cross(dd3_subtract(y[1], y[0]), dd3_subtract(y[3], y[2]));
  --k;
  if (split == 1) {
    if (k >= 3) return dd3_subtract(y[0], y[k - 2]);
    from = 0; a = 1 + k; b = 1 + (k + 1) % 3;
  } else {
    if (k >= 4) return dd3_subtract(y[(k - 4) / 2], y[2 + (k & 1)]);
    from = k; a = k < 2 ? 2 : 0; b = a + 1;
  }
  p = dd3_subtract(y[from], y[a]);
  u = dd3_subtract(y[b], y[a]);
  return dd3_cross(dd3_cross(u, p), u);   /* the part of p perpendicular to u, times u.u */
}

/* From `time`, up to which the pair does not touch, to a time beyond which double can go on; 2 if it never touches, -1 if it may. */
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
      double separation, step = touch_advance(y, d, split, touch_direction(y, split, (k + last) % directions), extent, &separation);
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

/* As linear_impact_time with minimum distance 0, with pairs that pass each other nearer than double can tell looked at again. */
DEVICE impact_time linear_touch_time(int split, dvec3 a0, dvec3 b0, dvec3 c0, dvec3 d0, dvec3 a1, dvec3 b1, dvec3 c1, dvec3 d1)
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
    if (time > 1.0) { result.hit = 0; result.time = 1.0; return result; }
    result = hull_impact_after(x, d, split, 0.0, extent, CCD_TOLERANCE, time);
  }
  return result;
}

/* The paper's test: roots of the coplanarity cubic, then an inside test (Section 5; Provot 1997), with a forward error bound in place of
   tolerances and the customary early-outs (after Wang 2014). Minimum distance 0. */

/* Value of the cubic with coefficients c. */
DEVICE double cubic_value(const double *c, double t) { return c[0] + t * (c[1] + t * (c[2] + t * c[3])); }

/* The root of a cubic that changes sign over [lo, hi] and is monotone there: bisection, sped up by Newton while it stays inside. */
DEVICE double cubic_root(const double *c, double lo, double hi)
{
  int rising = cubic_value(c, lo) < 0.0;
  double t = 0.5 * (lo + hi);
  for (int k = 0; k < 80 && hi - lo > 1e-16; ++k) {
    double f = cubic_value(c, t), slope = c[1] + t * (2.0 * c[2] + 3.0 * t * c[3]), next;
    if (f == 0.0) return t;
    if ((f < 0.0) == rising) lo = t; else hi = t;
    next = slope != 0.0 ? t - f / slope : lo;
    if (!(next > lo && next < hi)) next = 0.5 * (lo + hi);
    else if (fabs(next - t) < 1e-16) return next;
    t = next;
  }
  return t;
}

/* 0, the turning points inside (0, 1) ascending, 1; returns how many. Between them the cubic is monotone. */
DEVICE int cubic_pieces(const double *c, double *end)
{
  double a = 3.0 * c[3], b = c[2], e = c[1], disc = b * b - a * e;   /* derivative a t^2 + 2 b t + e, roots without cancellation */
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

/* Where |f| > bound on the way from `in`, with |f| <= bound, to `out`, with |f| > bound: where the tangent says, else by bisection. */
DEVICE double cubic_leave(const double *c, double in, double out, double bound)
{
  double slope = fabs(c[1] + in * (2.0 * c[2] + 3.0 * in * c[3])), lo = in, hi = out;
  if (slope > 0.0) {
    double t = in + (out > in ? 1.0 : -1.0) * (4.0 * bound / slope + 4e-16);
    if ((t < out) == (out > in) && fabs(cubic_value(c, t)) > bound) return t;
  }
  for (int k = 0; k < 60; ++k) {
    double t = 0.5 * (lo + hi);
    if (fabs(cubic_value(c, t)) > bound) hi = t; else lo = t;
  }
  return hi;
}

DEVICE double triple_product(dvec3 a, dvec3 b, dvec3 c) { return ddot(a, dcross(b, c)); }

/* No false negative: contact needs |f| <= bound, f as computed. That holds in at most one interval a monotone piece. Where it is short the
   pair hardly moves in it: what a direction separates by more at one moment does not touch. Where it is long (coplanar, grazing motion) the
   additive method decides. Time: of the root where it is one. docs/ccd.md derives the bound. */
DEVICE impact_time linear_impact_cubic(int split, dvec3 a0, dvec3 b0, dvec3 c0, dvec3 d0, dvec3 a1, dvec3 b1, dvec3 c1, dvec3 d1)
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
    speed = max_double(speed, largest_component(d[k]));   /* of any two vertices apart: at most twice this a component */
  }
  count = cubic_pieces(c, end);
  for (int k = 0; k + 1 < count; ++k) {
    double lo = end[k], hi = end[k + 1], f0 = cubic_value(c, lo), f1 = cubic_value(c, hi), at, reach;
    if (min_double(f0, f1) > bound || max_double(f0, f1) < -bound) continue;
    if ((f0 < 0.0 && f1 > 0.0) || (f0 > 0.0 && f1 < 0.0)) at = cubic_root(c, lo, hi);
    else at = fabs(f0) <= fabs(f1) ? lo : hi;
    if (fabs(f0) > bound) lo = cubic_leave(c, at, lo, bound);
    if (fabs(f1) > bound) hi = cubic_leave(c, at, hi, bound);
    for (int i = 0; i < 4; ++i) y[i] = daxpy(x[i], at, d[i]);
    reach = 4.0 * speed * (hi - lo);
    if (reach <= CCD_TOLERANCE * extent) {
      if (hull_separation(y, d, split, hull_proximity(y, split).normal, 0.0) > reach + CCD_ROUNDING * extent) continue;
    } else {
      dvec3 e[4];
      for (int i = 0; i < 4; ++i) { y[i] = daxpy(x[i], lo, d[i]); e[i] = dscale(hi - lo, d[i]); }
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

DEVICE impact_time vertex_face_impact_cubic(dvec3 v0, dvec3 a0, dvec3 b0, dvec3 c0, dvec3 v1, dvec3 a1, dvec3 b1, dvec3 c1)
{
  return linear_impact_cubic(1, v0, a0, b0, c0, v1, a1, b1, c1);
}
DEVICE impact_time edge_edge_impact_cubic(dvec3 a0, dvec3 b0, dvec3 c0, dvec3 d0, dvec3 a1, dvec3 b1, dvec3 c1, dvec3 d1)
{
  return linear_impact_cubic(2, a0, b0, c0, d0, a1, b1, c1, d1);
}
