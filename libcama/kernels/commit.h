/* SPDX-License-Identifier: Apache-2.0 */
/* Certified commit: how far each vertex may go along its straight motion so that no candidate pair crosses (ALGORITHMS A.8; Divide and
   Truncate, arXiv 2604.15513). Given no intersection before, there is none after, whatever the solver proposed.

   Vertex v follows x_v + min(s, t_v) d_v for s from 0 to sigma, t_v its fraction (1 unless truncated), sigma the step's (1 unless an
   obstacle must wait). A pair with hulls A, B is safe in one of two ways.
   SETTLED: a fixed plane n.x = p keeps A above and B below: every vertex starts on its side by half of dmin and ends there, hence is there
   throughout, for ANY smaller t_v and sigma; so truncating others never harms it, and one pass over such pairs is final. Vertices of
   inverse mass 0 are never truncated: the plane stays ahead of them, and if it would pass a vertex of the other side, sigma is cut.
   CONDITIONAL: while all four t_v are 1 the pair moves as proposed, and min over cross pairs of n.(x_i - x_j) + s n.(d_i - d_j), concave in
   s, is at least dmin at s = 0 and s = 1 for some n, or the additive CCD certifies the distance. Only relative motion enters: common
   translation loses nothing. When a vertex of it is truncated it must be settled with planes. Each pair changes once, so passes end;
   the result does not depend on their order because a plane depends on x and d alone.
   Positions closer than dmin (bad input) may not come closer; intersecting ones cannot be certified: counted, frozen or let go. */

#define COMMIT_SETTLED 0
#define COMMIT_CONDITIONAL 1
#define COMMIT_INTERSECTING 2
#define COMMIT_WHOLE 0x3f800000   /* bits of 1.0f: what fraction[] and sigma[0] start from */

typedef struct {
  int state;            /* one of the above */
  double fraction[4];   /* upper bounds for t of the four vertices */
  double sigma;         /* upper bound for the step's fraction */
} commit_bound;

/* A float <= t, t in [0, 1]; 1 stays 1. Bits of such floats order like the numbers, so integer minima serve. */
DEVICE float fraction_below(double t) { return t >= 1.0 ? 1.0f : (t > 1e-30 ? (float)(t - 1.2e-7 * t) : 0.0f); }

DEVICE commit_bound commit_free(int state)
{
  commit_bound r;
  r.state = state;
  r.fraction[0] = r.fraction[1] = r.fraction[2] = r.fraction[3] = r.sigma = 1.0;
  return r;
}

/* SETTLED. Divides the gap along n between both hulls. x relative to one vertex, d absolute displacements, fixed[k]: vertex k cannot be
   truncated, rounding: m, covers what float arithmetic loses in x and d. */
DEVICE commit_bound commit_plane(const dvec3 *x, const dvec3 *d, const int *fixed, int split, dvec3 n, double dmin, double rounding)
{
  commit_bound r = commit_free(COMMIT_SETTLED);
  /* Heights along the outward side of each hull, A first (0), B (1) with n reversed: approach is positive towards the other hull. */
  double height[4], approach[4], start[2], most[2], most_fixed[2], floor_distance = dmin + 2.0 * rounding, gap, share, plane;
  start[0] = start[1] = most[0] = most[1] = most_fixed[0] = most_fixed[1] = 0.0;
  for (int k = 0; k < 4; ++k) {
    int side = k >= split;
    double sign = side ? -1.0 : 1.0;
    height[k] = sign * ddot(n, x[k]);
    approach[k] = -sign * ddot(n, d[k]);
    start[side] = k == 0 || k == split ? height[k] : min_double(start[side], height[k]);
    most[side] = max_double(most[side], approach[k]);
    if (fixed[k]) most_fixed[side] = max_double(most_fixed[side], approach[k]);
  }
  gap = start[0] + start[1];
  if (!(gap > rounding)) { r.state = COMMIT_INTERSECTING; return r; }
  if (most[0] + most[1] <= gap - floor_distance) return r;
  if (gap <= floor_distance) {   /* touching: nothing comes nearer, everything may leave */
    for (int k = 0; k < 4; ++k)
      if (approach[k] > 0.0) { if (fixed[k]) r.sigma = 0.0; else r.fraction[k] = 0.0; }
    return r;
  }
  if (most_fixed[0] + most_fixed[1] > gap - floor_distance) {   /* fixed vertices alone would use up the gap */
    r.sigma = 0.9 * (gap - floor_distance) / (most_fixed[0] + most_fixed[1]);
    most_fixed[0] *= r.sigma;
    most_fixed[1] *= r.sigma;
  }
  /* Depth of the plane below the lowest vertex of A: by the ratio of approaches, but behind where fixed vertices will be. */
  share = clamp_double(most[0] / (most[0] + most[1]), 0.05, 0.95) * gap;
  share = min_double(share, gap - most_fixed[1] - 0.5 * floor_distance);
  share = max_double(share, most_fixed[0] + 0.5 * floor_distance);
  for (int k = 0; k < 4; ++k) {
    double distance, room;
    plane = k < split ? start[0] - share : start[1] - (gap - share);
    distance = height[k] - plane;
    room = max_double(min_double(0.9 * distance, distance - 0.5 * floor_distance), 0.0);
    if (!fixed[k] && approach[k] > room) r.fraction[k] = room / approach[k];
  }
  return r;
}

/* 1 if along n the moving pair keeps `least` at both ends of the step, hence throughout. */
DEVICE int commit_certified(const dvec3 *x, const dvec3 *d, int split, dvec3 n, double least)
{
  return hull_separation(x, d, split, n, 0.0) >= least && hull_separation(x, d, split, n, 1.0) >= least;
}

/* One pair. first: CONDITIONAL is allowed (the first pass). Position y_k is where the step wants vertex k, a position at 1. */
DEVICE commit_bound commit_decide(dvec3 x0, dvec3 x1, dvec3 x2, dvec3 x3, dvec3 y0, dvec3 y1, dvec3 y2, dvec3 y3,
                                  int fixed0, int fixed1, int fixed2, int fixed3, int split, double dmin, int first)
{
  dvec3 x[4], y[4], d[4], relative[4], n;
  int fixed[4];
  double largest = 0.0, extent, rounding, gap, least;
  commit_bound r;
  x[0] = x0; x[1] = x1; x[2] = x2; x[3] = x3;
  y[0] = y0; y[1] = y1; y[2] = y2; y[3] = y3;
  fixed[0] = fixed0; fixed[1] = fixed1; fixed[2] = fixed2; fixed[3] = fixed3;
  extent = 0.0;
  for (int k = 0; k < 4; ++k) {
    largest = max_double(largest, max_double(largest_component(x[k]), largest_component(y[k])));
    d[k] = dsub(y[k], x[k]);
    x[k] = dsub(x[k], x0);
    y[k] = dsub(y[k], y0);
    relative[k] = dsub(y[k], x[k]);
    extent = max_double(extent, largest_component(x[k]) + largest_component(y[k]) + largest_component(d[k]));
  }
  rounding = 1e-15 * largest + CCD_ROUNDING * extent;
  n = hull_proximity(x, split).normal;
  r = commit_plane(x, d, fixed, split, n, dmin, rounding);
  if (!first || r.state == COMMIT_INTERSECTING ||
      (r.fraction[0] >= 1.0 && r.fraction[1] >= 1.0 && r.fraction[2] >= 1.0 && r.fraction[3] >= 1.0 && r.sigma >= 1.0)) return r;
  /* Pairs nearer than dmin keep what they have, but for rounding. */
  gap = hull_separation(x, d, split, n, 0.0);
  least = min_double(dmin, gap - (gap > 8.0 * rounding ? 2.0 * rounding : 0.0));
  if (commit_certified(x, relative, split, n, least)) return commit_free(COMMIT_CONDITIONAL);
  n = hull_proximity(y, split).normal;
  if (commit_certified(x, relative, split, n, least)) return commit_free(COMMIT_CONDITIONAL);
  if (!hull_impact_time(x, relative, split, least, extent).hit) return commit_free(COMMIT_CONDITIONAL);
  return r;
}

/* The four vertices of a candidate: kind 0 is (vertex, face), kind 1 (edge, edge). */
DEVICE void commit_vertices(int kind, pair p, GLOBAL const face_nodes *face, GLOBAL const edge_nodes *edge, int *v)
{
  if (kind == 0) {
    v[0] = p.a; v[1] = face[p.b].node[0]; v[2] = face[p.b].node[1]; v[3] = face[p.b].node[2];
  } else {
    v[0] = edge[p.a].node[0]; v[1] = edge[p.a].node[1]; v[2] = edge[p.b].node[0]; v[3] = edge[p.b].node[1];
  }
}

/* 1 if the pair is to be (re)decided in this pass; see commit_pairs. */
DEVICE int commit_due(int pass, int state, const int *v, const int *fixed, GLOBAL const int *fraction_before)
{
  if (pass == 0) return !(fixed[0] && fixed[1] && fixed[2] && fixed[3]);
  if (state != COMMIT_CONDITIONAL) return 0;
  return pass < 0 || fraction_before[v[0]] != COMMIT_WHOLE || fraction_before[v[1]] != COMMIT_WHOLE ||
         fraction_before[v[2]] != COMMIT_WHOLE || fraction_before[v[3]] != COMMIT_WHOLE;
}

/* Pass 0 sees every pair. Pass k > 0 settles conditional pairs that lost a vertex's t = 1; repeat until counter[0] stays as it is. Pass -1
   settles every conditional pair: final whatever came before, for a cap on the number of passes. Both kinds go through each pass.
   `fraction_before` is `fraction` as it was before the pass (a copy), or `fraction` itself when passes run until nothing changes, which
   has the same result. accepted: [n] states; fraction: [vertices] bits of floats; sigma: [1], likewise; counter: [2] pairs settled after
   having been conditional, intersecting pairs; commit_begin sets them. dmin: m. let_go 1: intersecting pairs are free, 0: their vertices stay. */
KERNEL commit_pairs(int n, int kind, int pass, GLOBAL const pair *candidate, GLOBAL const face_nodes *face, GLOBAL const edge_nodes *edge,
                    GLOBAL const dvec3 *position, GLOBAL const dvec3 *target, GLOBAL const double *inverse_mass, double dmin, int let_go,
                    GLOBAL int *accepted, GLOBAL const int *fraction_before, GLOBAL int *fraction, GLOBAL int *sigma, GLOBAL int *counter)
{
  FOR_EACH_UNEVEN(i, n) {
    int v[4], fixed[4], k;
    commit_bound r = commit_free(COMMIT_SETTLED);
    commit_vertices(kind, candidate[i], face, edge, v);
    for (k = 0; k < 4; ++k) fixed[k] = inverse_mass[v[k]] == 0.0;
    if (commit_due(pass, pass == 0 ? COMMIT_SETTLED : accepted[i], v, fixed, fraction_before)) {
      r = commit_decide(position[v[0]], position[v[1]], position[v[2]], position[v[3]], target[v[0]], target[v[1]], target[v[2]],
                        target[v[3]], fixed[0], fixed[1], fixed[2], fixed[3], kind + 1, dmin, pass == 0);
      if (pass != 0) atomic_add_int(counter, 1);
    } else if (pass != 0) continue;
    accepted[i] = r.state == COMMIT_CONDITIONAL ? COMMIT_CONDITIONAL : COMMIT_SETTLED;
    if (r.state == COMMIT_INTERSECTING) {
      atomic_add_int(counter + 1, 1);
      for (k = 0; k < 4; ++k) if (!let_go && !fixed[k]) atomic_min_int(fraction + v[k], 0);
    }
    for (k = 0; k < 4; ++k) if (r.fraction[k] < 1.0) atomic_min_int(fraction + v[k], float_bits(fraction_below(r.fraction[k])));
    if (r.sigma < 1.0) atomic_min_int(sigma, float_bits(fraction_below(r.sigma)));
  }
}

/* Nothing truncated yet. */
KERNEL commit_begin(int n, GLOBAL int *fraction, GLOBAL int *sigma, GLOBAL int *counter)
{
  FOR_EACH(i, n) {
    fraction[i] = COMMIT_WHOLE;
    if (i == 0) { sigma[0] = COMMIT_WHOLE; counter[0] = 0; counter[1] = 0; }
  }
}

/* Moves vertices: to the target where nothing was in the way. */
KERNEL commit_apply(int n, GLOBAL const dvec3 *position, GLOBAL const dvec3 *target, GLOBAL const int *fraction, GLOBAL const int *sigma,
                    GLOBAL dvec3 *committed)
{
  FOR_EACH(i, n) {
    int t = min_int(fraction[i], sigma[0]);
    committed[i] = t == COMMIT_WHOLE ? target[i] : daxpy(position[i], (double)bits_float(t), dsub(target[i], position[i]));
  }
}
