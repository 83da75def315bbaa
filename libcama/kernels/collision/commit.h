/* SPDX-License-Identifier: Apache-2.0 */
/* Certified commit: how far each vertex may go along its straight motion so that no candidate pair crosses
   (docs/theory/penetration-handling.md; Divide and Truncate, arXiv 2604.15513). If there is no intersection before,
   there is none after, whatever the solver proposed.

   Vertex v follows x_v + s t_v d_v for s from 0 to sigma, t_v its fraction (1 unless truncated), sigma the step's (1
   unless an obstacle must pause). A pair with hulls A, B is safe in one of two ways.

   SETTLED: a fixed plane n.x = p keeps A above and B below: every vertex starts on its side by half of dmin and ends
   there, hence is there throughout, for ANY smaller t_v and sigma; so truncating others never harms it, and one pass
   over such pairs is final. Vertices of inverse mass 0 are never truncated: the plane stays ahead of them, and if it
   would pass a vertex of the other side, sigma is cut.

   CONDITIONAL: for the fractions t as they are, the pair's actual motion is certified: for one n, min over cross pairs
   of n.(x_i - x_j), concave in s, is at least dmin at both ends, or the additive CCD certifies the distance. Only
   relative motion enters: common translation loses nothing. When a pass has truncated one of its vertices, the next
   tests the pair again, and settles it with a plane if the new motion is not certified.

   Each pair settles at most once and only settling lowers a t, so the passes end; after one in which no t fell, every
   pair is safe for the same t. Passes read a copy of t, so the result is the same everywhere. A pair closer than
   dmin (from such a start, or left by a pinch) may halve its gap, so that its sides stay separated whatever an obstacle
   does; intersecting pairs cannot be certified: they are counted, and frozen or let go. */
#ifndef CAMA_KERNELS_COLLISION_COMMIT_H
#define CAMA_KERNELS_COLLISION_COMMIT_H
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"
#include "../system/incidence.h"
#include "bounds.h"
#include "ccd.h"
#include "impact.h"
#include "pair.h"
#include "query.h"
#include "runs.h"
#include "swept_vertex.h"

#define COMMIT_SETTLED 0
#define COMMIT_CONDITIONAL 1
#define COMMIT_INTERSECTING 2
#define COMMIT_PAUSING 3          /* settled with sigma cut: the step's obstacles pause for it */
#define COMMIT_UNDECIDED 4        /* as long as continuous detection has not decided */
#define COMMIT_WHOLE 0x3f800000   /* bits of 1.0f, the initial value of fraction[] and sigma */
/* Of outcome[], which all passes of a commit share: */
#define COMMIT_CHANGES 0          /* vertices truncated or truncated further, counted once after each pass */
#define COMMIT_CROSSED 1          /* intersecting pairs */
#define COMMIT_SIGMA 2            /* bits of sigma */
#define COMMIT_LISTED 3           /* pairs that the next pass decides */
#define COMMIT_RUNS 4             /* runs of pairs near what the last pass has truncated */
#define COMMIT_OUTCOMES 5

typedef struct {
  int state; /* one of the above */
  double fraction[4]; /* upper bounds for t of the four vertices */
  double sigma; /* upper bound for the step's fraction */
} commit_bound;

/* A float <= t, t in [0, 1]; 1 stays 1. The bits of such floats order like the numbers, so minima of integers serve. */
DEVICE float fraction_below(double t) { return t >= 1.0 ? 1.0f : (t > 1e-30 ? (float)(t - 1.2e-7 * t) : 0.0f); }

DEVICE commit_bound commit_free(int state)
{
  commit_bound r;
  r.state = state;
  r.fraction[0] = r.fraction[1] = r.fraction[2] = r.fraction[3] = r.sigma = 1.0;
  return r;
}

/* SETTLED. Divides the gap along n between both hulls. radius: of both together, part of dmin, m. x: relative to one
   vertex. d: absolute displacements. fixed[k]: vertex k cannot be truncated. rounding: covers the rounding of x and d,
   m. */
DEVICE commit_bound commit_plane(const dvec3 *x, const dvec3 *d, const int *fixed, int split, dvec3 n, double dmin,
                                 double radius, double rounding)
{
  commit_bound r = commit_free(COMMIT_SETTLED);
  /* Heights along the outward side of each hull, A first (0), B (1) with n reversed: approach is positive towards the
     other hull. */
  double height[4], approach[4], start[2], most[2], max_fixed[2], floor_distance, gap, share, plane;
  start[0] = start[1] = most[0] = most[1] = max_fixed[0] = max_fixed[1] = 0.0;
  for (int k = 0; k < 4; ++k) {
    int side = k >= split;
    double sign = side ? -1.0 : 1.0;
    height[k] = sign * ddot(n, x[k]);
    approach[k] = -sign * ddot(n, d[k]);
    start[side] = k == 0 || k == split ? height[k] : min_double(start[side], height[k]);
    most[side] = max_double(most[side], approach[k]);
    if (fixed[k]) max_fixed[side] = max_double(max_fixed[side], approach[k]);
  }
  gap = start[0] + start[1];
  floor_distance = (gap < dmin ? radius + 0.5 * (gap - radius) : dmin) + 2.0 * rounding;
  if (!(gap > rounding)) {
    r.state = COMMIT_INTERSECTING;
    return r;
  }
  if (most[0] + most[1] <= gap - floor_distance) return r;
  if (gap <= floor_distance) { /* touching within rounding: no vertex comes nearer, every vertex may leave */
    for (int k = 0; k < 4; ++k)
      if (approach[k] > 0.0) {
        if (fixed[k])
          r.sigma = 0.0;
        else
          r.fraction[k] = 0.0;
      }
    return r;
  }
  if (max_fixed[0] + max_fixed[1] > gap - floor_distance) { /* fixed vertices alone would use up the gap */
    r.sigma = 0.9 * (gap - floor_distance) / (max_fixed[0] + max_fixed[1]);
    max_fixed[0] *= r.sigma;
    max_fixed[1] *= r.sigma;
  }
  /* Depth of the plane below the lowest vertex of A: by the ratio of approaches, but beyond the ends of fixed
     vertices. */
  share = clamp_double(most[0] / (most[0] + most[1]), 0.05, 0.95) * gap;
  share = min_double(share, gap - max_fixed[1] - 0.5 * floor_distance);
  share = max_double(share, max_fixed[0] + 0.5 * floor_distance);
  for (int k = 0; k < 4; ++k) {
    double distance, slack;
    plane = k < split ? start[0] - share : start[1] - (gap - share);
    distance = height[k] - plane;
    slack = max_double(min_double(0.9 * distance, distance - 0.5 * floor_distance), 0.0);
    if (!fixed[k] && approach[k] > slack) r.fraction[k] = slack / approach[k];
  }
  return r;
}

/* 1 if the boxes that the hulls sweep are separated by more than `distance` along an axis: a plane between them settles
   the pair. */
DEVICE int swept_separation(const dvec3 *x, const dvec3 *d, int split, double distance)
{
  for (int axis = 0; axis < 3; ++axis) {
    double lo[2], hi[2];
    lo[0] = hi[0] = lo[1] = hi[1] = 0.0;
    for (int k = 0; k < 4; ++k) {
      double h = dcomponent(x[k], axis), e = h + dcomponent(d[k], axis);
      int side = k >= split, first = k == 0 || k == split;
      lo[side] = first ? min_double(h, e) : min_double(lo[side], min_double(h, e));
      hi[side] = first ? max_double(h, e) : max_double(hi[side], max_double(h, e));
    }
    if (lo[0] - hi[1] > distance || lo[1] - hi[0] > distance) return 1;
  }
  return 0;
}

/* 1 if along n the motion x -> z keeps `least` at both ends, hence throughout. */
DEVICE int commit_certified(const dvec3 *x, const dvec3 *z, int split, dvec3 n, double least)
{
  return hull_separation(x, z, split, n, 0.0) >= least && hull_separation(z, x, split, n, 0.0) >= least;
}

/* Decides one pair. x: positions of its vertices; y: positions that the step proposes; t: fractions so far; fixed:
   vertices that cannot be truncated. recheck: the pair is known not to be settled already. quick: what takes continuous
   detection stays undecided. */
DEVICE commit_bound commit_decide(dvec3 *x, dvec3 *y, const double *t, const int *fixed, int split, double dmin,
                                  double radius, int conditional, int recheck, int quick)
{
  dvec3 d[4], z[4], motion[4], n, x0 = x[0], y0 = y[0];
  double largest = 0.0, extent = 0.0, rounding, gap, least;
  int whole = t[0] >= 1.0 && t[1] >= 1.0 && t[2] >= 1.0 && t[3] >= 1.0;
  commit_bound r;
  for (int k = 0; k < 4; ++k) {
    largest = max_double(largest, max_double(largest_component(x[k]), largest_component(y[k])));
    d[k] = dsub(y[k], x[k]);
    x[k] = dsub(x[k], x0);
    y[k] = dsub(y[k], y0);
    extent = max_double(extent, largest_component(x[k]) + largest_component(y[k]) + largest_component(d[k]));
  }
  rounding = 1e-15 * largest + CCD_ROUNDING * extent;
  if (!recheck && swept_separation(x, d, split, dmin + 2.0 * rounding)) return commit_free(COMMIT_SETTLED);
  n = hull_proximity(x, split).normal;
  r = commit_plane(x, d, fixed, split, n, dmin, radius, rounding);
  if (!conditional || r.state == COMMIT_INTERSECTING ||
      (r.fraction[0] >= 1.0 && r.fraction[1] >= 1.0 && r.fraction[2] >= 1.0 && r.fraction[3] >= 1.0 && r.sigma >= 1.0))
    return r;
  /* Pairs nearer than dmin keep their distance, but for rounding. */
  gap = hull_separation(x, d, split, n, 0.0);
  least = min_double(dmin, gap - (gap > 8.0 * rounding ? 2.0 * rounding : 0.0));
  for (int k = 0; k < 4; ++k) { /* where the vertices end, relative to vertex 0 */
    z[k] = whole ? y[k] : dadd(x[k], dsub(dscale(t[k], d[k]), dscale(t[0], d[0])));
    motion[k] = dsub(z[k], x[k]);
  }
  if (commit_certified(x, z, split, n, least)) return commit_free(COMMIT_CONDITIONAL);
  if (commit_certified(x, z, split, hull_proximity(z, split).normal, least)) return commit_free(COMMIT_CONDITIONAL);
  if (quick) return commit_free(COMMIT_UNDECIDED);
  if (!hull_impact_time(x, motion, split, least, extent, CCD_TOLERANCE).hit) return commit_free(COMMIT_CONDITIONAL);
  return r;
}

/* A vertex and a plane, which only translates: heights are linear in time, and the plane's normal alone decides for any
   extent. */
DEVICE commit_bound commit_half_space(dvec3 *x, const dvec3 *y, const int *fixed, double dmin, double radius)
{
  dvec3 d[4], x0 = x[0], n = vertex_plane_proximity(x[0], x[1], x[2], x[3]).normal;
  double largest = 0.0, extent = 0.0;
  for (int k = 0; k < 4; ++k) {
    largest = max_double(largest, max_double(largest_component(x[k]), largest_component(y[k])));
    d[k] = dsub(y[k], x[k]);
    x[k] = dsub(x[k], x0);
    extent = max_double(extent, largest_component(x[k]) + largest_component(d[k]));
  }
  return commit_plane(x, d, fixed, 1, n, dmin, radius, 1e-15 * largest + CCD_ROUNDING * extent);
}

/* Lists the pairs that pass 0 has to decide: not those that keep their clearance by their bound, or along the direction
   known from their search, which for most pairs decides it at a fifth of its cost. certified 1: find_impacts has
   certified, for this very motion, every pair that is no impact, so these pass without a test; *_gap_bound: below 0 for
   an impact. *_bounds, error, largest: as for select_open_pairs; *_bounds is 0 without errors. accepted: [pairs]
   states, of vertex_face and then of edge_edge. n: teams. */
KERNEL commit_screen(int n, int pairs, int first_size, int vertices, int faces, int certified,
                     GLOBAL const pair *vertex_face, GLOBAL const pair *edge_edge, GLOBAL const face_nodes *face,
                     GLOBAL const edge_nodes *edge, GLOBAL const dvec3 *position, GLOBAL const dvec3 *target,
                     GLOBAL const fvec3 *vertex_face_direction, GLOBAL const fvec3 *edge_edge_direction,
                     GLOBAL const vertex_contact *properties, int vertex_face_bounds,
                     GLOBAL const float *vertex_face_gap_bound, int edge_edge_bounds,
                     GLOBAL const float *edge_edge_gap_bound, GLOBAL const float *error, double share, double largest,
                     GLOBAL int *accepted, GLOBAL int *list, GLOBAL int *outcome)
{
  TEAM_LOCAL(int, chosen, RUN_PAIRS);
  TEAM_LOCAL(int, listed, 2);
  FOR_EACH_TEAM(t, n) {
    const int first = t * RUN_PAIRS;
    begin_chosen(listed);
    TEAM_FOR(l, min_int(pairs - first, RUN_PAIRS)) {
      const int i = first + l, kind = i >= first_size, at = kind == 0 ? i : i - first_size;
      const float gap_bound = kind == 0 ? vertex_face_gap_bound[at] : edge_edge_gap_bound[at];
      int screened = certified && !(gap_bound < 0.0f);
      if (!screened && at < (kind == 0 ? vertex_face_bounds : edge_edge_bounds)) {
        const pair p = listed_pair(i, first_size, vertex_face, edge_edge);
        const int before = kind == 0 ? 0 : vertices + faces;
        screened = bound_keeps(gap_bound, error[before + p.a], error[(kind == 0 ? vertices : before) + p.b],
                               1.01 * share * largest);
      }
      if (!screened) {
        element_nodes e = pair_nodes(kind, listed_pair(i, first_size, vertex_face, edge_edge), face, edge);
        screened = separated_along(kind, e, position, target,
                                   from_direction(kind == 0 ? vertex_face_direction[at] : edge_edge_direction[at]),
                                   pair_clearance(kind, e, properties, 1.001 * share));
      }
      accepted[i] = COMMIT_CONDITIONAL;
      if (!screened) chosen[local_add_int(listed, 1)] = i;
    }
    append_chosen(chosen, listed, list, outcome + COMMIT_LISTED);
  }
}

/* Lists the conditional pairs of which a vertex is marked: for the next pass those that have been truncated, as
   commit_changes and commit_disturb tell. outcome[COMMIT_LISTED]: the length of the list. n: teams. */
KERNEL commit_recheck(int n, int pairs, int first_size, int vertices, int faces, GLOBAL const pair *vertex_face,
                      GLOBAL const pair *edge_edge, GLOBAL const unsigned char *marked, GLOBAL const int *accepted,
                      GLOBAL int *list, GLOBAL int *outcome)
{
  TEAM_LOCAL(int, chosen, RUN_PAIRS);
  TEAM_LOCAL(int, listed, 2);
  FOR_EACH_TEAM(t, n) {
    const int first = t * RUN_PAIRS;
    begin_chosen(listed);
    TEAM_FOR(l, min_int(pairs - first, RUN_PAIRS)) {
      const int i = first + l, before = i < first_size ? 0 : vertices + faces;
      const pair p = listed_pair(i, first_size, vertex_face, edge_edge);
      if ((marked[before + p.a] | marked[(i < first_size ? vertices : before) + p.b]) &&
          accepted[i] == COMMIT_CONDITIONAL)
        chosen[local_add_int(listed, 1)] = i;
    }
    append_chosen(chosen, listed, list, outcome + COMMIT_LISTED);
  }
}

/* The same for few truncated vertices: of the runs listed by list_marked_runs (outcome[COMMIT_RUNS]) alone, which hold
   all pairs that have such a vertex. n: teams. */
KERNEL commit_recheck_runs(int n, int vertex_face_size, int edge_edge_size, GLOBAL const int *run,
                           GLOBAL const pair *vertex_face, GLOBAL const pair *edge_edge, GLOBAL const face_nodes *face,
                           GLOBAL const edge_nodes *edge, GLOBAL const int *vertex_changed, GLOBAL const int *accepted,
                           GLOBAL int *list, GLOBAL int *outcome)
{
  TEAM_LOCAL(int, chosen, RUN_PAIRS);
  TEAM_LOCAL(int, listed, 2);
  FOR_EACH_UNEVEN_TEAM(t, n) {
    const int runs = outcome[COMMIT_RUNS];
    for (int r = t; r < runs; r += n) {
      const int kind = code_kind(run[r]), first = RUN_PAIRS * code_place(run[r]),
                place = kind == 0 ? 0 : vertex_face_size;
      begin_chosen(listed);
      TEAM_FOR(l, min_int((kind == 0 ? vertex_face_size : edge_edge_size) - first, RUN_PAIRS)) {
        const int at = first + l;
        const element_nodes e = pair_nodes(kind, kind == 0 ? vertex_face[at] : edge_edge[at], face, edge);
        if ((vertex_changed[e.node[0]] | vertex_changed[e.node[1]] | vertex_changed[e.node[2]] |
             vertex_changed[e.node[3]]) &&
            accepted[place + at] == COMMIT_CONDITIONAL)
          chosen[local_add_int(listed, 1)] = place + at;
      }
      append_chosen(chosen, listed, list, outcome + COMMIT_LISTED);
    }
  }
}

/* Decides one pair, unless it is not to be decided quickly, and lowers the fractions of its vertices; returns its
   state. */
DEVICE_ATOMIC int commit_one(int kind, pair p, int pass, GLOBAL const face_nodes *face, GLOBAL const edge_nodes *edge,
                             GLOBAL const dvec3 *position, GLOBAL const dvec3 *target,
                             GLOBAL const double *inverse_mass, GLOBAL const vertex_contact *properties, double share,
                             int let_go, int quick, GLOBAL const int *fraction_before, GLOBAL int *fraction,
                             GLOBAL int *outcome)
{
  element_nodes e = pair_nodes(kind, p, face, edge);
  commit_bound r = commit_free(COMMIT_SETTLED);
  int fixed[4], k;
  double t[4];
  for (k = 0; k < 4; ++k) {
    fixed[k] = inverse_mass[e.node[k]] == 0.0;
    t[k] = (double)bits_float(fraction_before[e.node[k]]);
  }
  if (pass != 0 || !(fixed[0] && fixed[1] && fixed[2] && fixed[3])) {
    dvec3 x[4], y[4];
    double dmin = pair_clearance(kind, e, properties, share), radius = pair_radius(kind, e, properties);
    for (k = 0; k < 4; ++k) {
      x[k] = position[e.node[k]];
      y[k] = target[e.node[k]];
    }
    if (pair_has_plane(kind, e, properties))
      r = commit_half_space(x, y, fixed, dmin, radius);
    else
      r = commit_decide(x, y, t, fixed, kind + 1, dmin, radius, pass >= 0, pass != 0, quick);
  }
  if (r.state == COMMIT_UNDECIDED) return r.state;
  if (r.state == COMMIT_INTERSECTING) {
    atomic_add_int(outcome + COMMIT_CROSSED, 1);
    for (k = 0; k < 4; ++k)
      if (!let_go && !fixed[k]) atomic_min_int(fraction + e.node[k], 0);
  }
  for (k = 0; k < 4; ++k)
    if (r.fraction[k] < 1.0) atomic_min_int(fraction + e.node[k], float_bits(fraction_below(r.fraction[k])));
  if (r.sigma < 1.0) atomic_min_int(outcome + COMMIT_SIGMA, float_bits(fraction_below(r.sigma)));
  return r.sigma < 1.0 ? COMMIT_PAUSING : (r.state == COMMIT_CONDITIONAL ? COMMIT_CONDITIONAL : COMMIT_SETTLED);
}

/* Decides the listed pairs. Pass 0 is for those of commit_screen, pass k > 0 for those of commit_recheck; it is
   repeated until nothing changes. Pass -1 settles what is listed and is final whatever came before: it allows a limit
   on the number of passes. `fraction_before` is `fraction` before the pass. accepted: [pairs] states; fraction:
   [vertices] bits of floats; outcome: COMMIT_*, set by commit_begin. share: dmin is a pair's clearance at this share.
   let_go 1: intersecting pairs are free, 0: their vertices stay. n: teams. */
KERNEL commit_pairs(int n, int first_size, int pass, GLOBAL const int *list, GLOBAL const pair *vertex_face,
                    GLOBAL const pair *edge_edge, GLOBAL const face_nodes *face, GLOBAL const edge_nodes *edge,
                    GLOBAL const dvec3 *position, GLOBAL const dvec3 *target, GLOBAL const double *inverse_mass,
                    GLOBAL const vertex_contact *properties, double share, int let_go, GLOBAL int *accepted,
                    GLOBAL const int *fraction_before, GLOBAL int *fraction, GLOBAL int *outcome)
{
  FOR_EACH_LISTED(t, k, n, outcome + COMMIT_LISTED)
  {
    const int i = list[k_run + k];
    accepted[i] =
        commit_one(i >= first_size, listed_pair(i, first_size, vertex_face, edge_edge), pass, face, edge, position,
                   target, inverse_mass, properties, share, let_go, 0, fraction_before, fraction, outcome);
  }
}

/* The same for lists of many pairs: a team collects those that take continuous detection, one in twenty, and decides
   them at last, so that its members have this work at the same time. */
KERNEL commit_many_pairs(int n, int first_size, int pass, GLOBAL const int *list, GLOBAL const pair *vertex_face,
                         GLOBAL const pair *edge_edge, GLOBAL const face_nodes *face, GLOBAL const edge_nodes *edge,
                         GLOBAL const dvec3 *position, GLOBAL const dvec3 *target, GLOBAL const double *inverse_mass,
                         GLOBAL const vertex_contact *properties, double share, int let_go, GLOBAL int *accepted,
                         GLOBAL const int *fraction_before, GLOBAL int *fraction, GLOBAL int *outcome)
{
  TEAM_LOCAL(int, undecided, 2 * PAIR_TEAM);
  TEAM_LOCAL(int, collected, 2);
  FOR_EACH_UNEVEN_TEAM(t, n) {
    const int listed = outcome[COMMIT_LISTED], stride = n * PAIR_TEAM, late_work = has_late_work(listed, stride);
    int run, late;
    begin_chosen(collected);
    for (run = t * PAIR_TEAM; run < listed; run += stride)
      for (late = 0; late <= late_work; ++late) {
        const int some = late ? chosen_so_far(collected) : min_int(listed - run, PAIR_TEAM);
        if (late && some < PAIR_TEAM && listed - run > stride) break;
        TEAM_FOR(k, some) {
          const int i = late ? undecided[k] : list[run + k],
                    state = commit_one(i >= first_size, listed_pair(i, first_size, vertex_face, edge_edge), pass, face,
                                       edge, position, target, inverse_mass, properties, share, let_go,
                                       late_work && !late, fraction_before, fraction, outcome);
          if (state == COMMIT_UNDECIDED)
            undecided[local_add_int(collected, 1)] = i;
          else
            accepted[i] = state;
        }
        if (late) begin_chosen(collected);
      }
  }
}

/* Sets every fraction to 1, no cell to be marked, and the outcome to that of a motion without pairs. n: the larger
   number of vertices and cells. */
KERNEL commit_begin(int n, int vertices, int cells, GLOBAL int *fraction, GLOBAL int *fraction_before,
                    GLOBAL int *cell_marked, GLOBAL int *outcome)
{
  FOR_EACH(i, n) {
    if (i < vertices) fraction[i] = fraction_before[i] = COMMIT_WHOLE;
    if (i < cells) cell_marked[i] = 0;
    if (i == 0) {
      outcome[COMMIT_CHANGES] = outcome[COMMIT_CROSSED] = outcome[COMMIT_LISTED] = outcome[COMMIT_RUNS] = 0;
      outcome[COMMIT_SIGMA] = COMMIT_WHOLE;
    }
  }
}

/* After a pass: the vertices that it has truncated, whose cells get the mark `mark` (runs.h), `fraction_before`, and
   empty lists for the next. */
KERNEL commit_changes(int n, GLOBAL const int *fraction, GLOBAL const dvec3 *position, GLOBAL const dvec3 *scene_bounds,
                      double cell_size, int mask, int mark, GLOBAL int *fraction_before, GLOBAL int *vertex_changed,
                      GLOBAL int *cell_marked, GLOBAL int *outcome)
{
  FOR_EACH(i, n) {
    const int changed = fraction[i] != fraction_before[i];
    vertex_changed[i] = changed;
    fraction_before[i] = fraction[i];
    if (i == 0) outcome[COMMIT_LISTED] = outcome[COMMIT_RUNS] = 0;
    if (changed) {
      atomic_add_int(outcome + COMMIT_CHANGES, 1);
      atomic_max_int(cell_marked + cell_of_position(position[i], scene_bounds[0], cell_size, mask), mark);
    }
  }
}

/* Marks the vertices that have been truncated, and the faces and edges that have such a vertex;
   marked: [vertices, then faces, then edges] bytes, which remain in a cache. n: all of these. */
KERNEL commit_disturb(int n, int vertices, int faces, GLOBAL const face_nodes *face, GLOBAL const edge_nodes *edge,
                      GLOBAL const int *vertex_changed, GLOBAL unsigned char *marked)
{
  FOR_EACH(i, n) {
    int any;
    if (i < vertices) {
      any = vertex_changed[i];
    } else if (i < vertices + faces) {
      const face_nodes f = face[i - vertices];
      any = vertex_changed[f.node[0]] | vertex_changed[f.node[1]] | vertex_changed[f.node[2]];
    } else {
      const edge_nodes e = edge[i - vertices - faces];
      any = vertex_changed[e.node[0]] | vertex_changed[e.node[1]];
    }
    marked[i] = (unsigned char)any;
  }
}

/* What truncation takes from LOST_VERTICES vertices of the cloth: the sum of the shares of their motion, and how many
   have lost some. */
#define LOST_VERTICES 256
typedef struct {
  double motion;
  int vertices;
} commit_loss;
KERNEL commit_losses(int n, int cloth_vertices, GLOBAL const int *fraction, GLOBAL commit_loss *loss)
{
  FOR_EACH(i, n) {
    const int end = min_int(LOST_VERTICES * (i + 1), cloth_vertices);
    commit_loss sum;
    sum.motion = 0.0;
    sum.vertices = 0;
    for (int v = LOST_VERTICES * i; v < end; ++v)
      if (fraction[v] != COMMIT_WHOLE) {
        sum.motion += 1.0 - (double)bits_float(fraction[v]);
        ++sum.vertices;
      }
    loss[i] = sum;
  }
}

/* Where each vertex ends if obstacles do not pause. */
KERNEL commit_ends(int n, GLOBAL const dvec3 *position, GLOBAL const dvec3 *target, GLOBAL const int *fraction,
                   GLOBAL dvec3 *end)
{
  FOR_EACH(i, n) {
    const double t = (double)bits_float(fraction[i]);
    end[i] = t == 1.0 ? target[i] : daxpy(position[i], t, dsub(target[i], position[i]));
  }
}

/* After both lists have grown: the states of the earlier pairs, from `before`, and a list of the new ones, which the
   next pass decides as conditional pairs of which a vertex has been truncated. first_size: of vertex_face, now and
   *_before. n: pairs. */
KERNEL commit_extend(int n, int first_size, int vertex_face_before, int edge_edge_before, GLOBAL const int *before,
                     GLOBAL int *accepted, GLOBAL int *list, GLOBAL int *outcome)
{
  FOR_EACH(i, n) {
    const int kind = i >= first_size, at = kind == 0 ? i : i - first_size;
    if (at < (kind == 0 ? vertex_face_before : edge_edge_before)) {
      accepted[i] = before[kind == 0 ? at : vertex_face_before + at];
    } else {
      accepted[i] = COMMIT_CONDITIONAL;
      list[atomic_add_int(outcome + COMMIT_LISTED, 1)] = i;
    }
  }
}

/* Moves each vertex by its fraction; a vertex that was not truncated reaches its target. */
KERNEL commit_apply(int n, GLOBAL const dvec3 *position, GLOBAL const dvec3 *target, GLOBAL const int *fraction,
                    GLOBAL const int *outcome, GLOBAL dvec3 *committed)
{
  FOR_EACH(i, n) {
    double t = (double)bits_float(fraction[i]) * (double)bits_float(outcome[COMMIT_SIGMA]);
    committed[i] = t == 1.0 ? target[i] : daxpy(position[i], t, dsub(target[i], position[i]));
  }
}

#endif
