/* SPDX-License-Identifier: Apache-2.0 */
/* Boxes of vertices over their motion, boxes of faces and edges from them, and Morton codes. Boxes are floats relative
   to the scene's lower corner, rounded outward, so a scene far from the origin keeps its resolution. `scene_bounds` is
   [2]: lower and upper corner. */
#ifndef CAMA_KERNELS_COLLISION_BOUNDS_H
#define CAMA_KERNELS_COLLISION_BOUNDS_H
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"

typedef struct {
  float lo[3], hi[3];
} box;
typedef struct {
  int node[3];
} face_nodes;
typedef struct {
  int node[2];
} edge_nodes;

/* Floats <= x and >= x, at most three units in the last place away (1.2e-7 > 2^-23); never denormal, since devices may
   flush denormals to zero. */
DEVICE float float_below(double x) { return fabs(x) < 1e-30 ? -1e-30f : (float)(x - 1.2e-7 * fabs(x)); }
DEVICE float float_above(double x) { return -float_below(-x); }

/* The smallest box that holds both. */
DEVICE box box_union(box a, box b)
{
  for (int k = 0; k < 3; ++k) {
    a.lo[k] = b.lo[k] < a.lo[k] ? b.lo[k] : a.lo[k];   /* no branches: they would be mispredicted */
    a.hi[k] = b.hi[k] > a.hi[k] ? b.hi[k] : a.hi[k];
  }
  return a;
}
DEVICE int box_overlap(box a, box b)
{
  return a.lo[0] <= b.hi[0] && b.lo[0] <= a.hi[0] && a.lo[1] <= b.hi[1] && b.lo[1] <= a.hi[1] && a.lo[2] <= b.hi[2] &&
         b.lo[2] <= a.hi[2];
}
/* 1 if a holds all of b. */
DEVICE int box_holds(box a, box b)
{
  return a.lo[0] <= b.lo[0] && a.lo[1] <= b.lo[1] && a.lo[2] <= b.lo[2] && a.hi[0] >= b.hi[0] && a.hi[1] >= b.hi[1] &&
         a.hi[2] >= b.hi[2];
}

DEVICE dvec3 dvec3_min(dvec3 a, dvec3 b)
{
  return dvec3_make(min_double(a.x, b.x), min_double(a.y, b.y), min_double(a.z, b.z));
}
DEVICE dvec3 dvec3_max(dvec3 a, dvec3 b)
{
  return dvec3_make(max_double(a.x, b.x), max_double(a.y, b.y), max_double(a.z, b.z));
}

/* The bounds of the scene in two stages, each by teams. Corners are pairs: lower, upper. */
#define BOUNDS_TEAM 128

/* lo, hi: [BOUNDS_TEAM]. Their bounds become pair t of `corners`. */
DEVICE_TEAM void bounds_of_team(int t, LOCAL dvec3 *lo, LOCAL dvec3 *hi, GLOBAL dvec3 *corners)
{
  int span;
  TEAM_BARRIER;
  for (span = BOUNDS_TEAM / 2; span > 0; span /= 2) {
    TEAM_FOR(l, span) {
      lo[l] = dvec3_min(lo[l], lo[l + span]);
      hi[l] = dvec3_max(hi[l], hi[l + span]);
    }
    TEAM_BARRIER;
  }
  TEAM_FOR(l, 1) {
    corners[2 * t] = lo[0];
    corners[2 * t + 1] = hi[0];
  }
}

/* First stage: pair t for every n-th of BOUNDS_TEAM positions with their targets. count: at least 1. */
KERNEL position_bounds(int n, int count, GLOBAL const dvec3 *position, GLOBAL const dvec3 *target,
                       GLOBAL dvec3 *corners)
{
  TEAM_LOCAL(dvec3, lo, BOUNDS_TEAM);
  TEAM_LOCAL(dvec3, hi, BOUNDS_TEAM);
  FOR_EACH_TEAM(t, n) {
    TEAM_BARRIER;
    TEAM_FOR(l, BOUNDS_TEAM) {
      int k = min_int(t * BOUNDS_TEAM + l, count - 1);
      dvec3 least = dvec3_min(position[k], target[k]), most = dvec3_max(position[k], target[k]);
      for (k += n * BOUNDS_TEAM; k < count; k += n * BOUNDS_TEAM) {
        least = dvec3_min(least, dvec3_min(position[k], target[k]));
        most = dvec3_max(most, dvec3_max(position[k], target[k]));
      }
      lo[l] = least;
      hi[l] = most;
    }
    bounds_of_team(t, lo, hi, corners);
  }
}

/* Second stage, by one team: the pairs of `count` teams to that of the scene. */
KERNEL reduce_bounds(int n, int count, GLOBAL const dvec3 *corners, GLOBAL dvec3 *scene_bounds)
{
  TEAM_LOCAL(dvec3, lo, BOUNDS_TEAM);
  TEAM_LOCAL(dvec3, hi, BOUNDS_TEAM);
  FOR_EACH_TEAM(t, n) {
    TEAM_BARRIER;
    TEAM_FOR(l, BOUNDS_TEAM) {
      int k = min_int(l, count - 1);
      dvec3 least = corners[2 * k], most = corners[2 * k + 1];
      for (k += BOUNDS_TEAM; k < count; k += BOUNDS_TEAM) {
        least = dvec3_min(least, corners[2 * k]);
        most = dvec3_max(most, corners[2 * k + 1]);
      }
      lo[l] = least;
      hi[l] = most;
    }
    bounds_of_team(t, lo, hi, scene_bounds);
  }
}

/* The box of one vertex that moves from x to y, inflated by margin. The relative 4e-16 covers the rounding of the two
   subtractions. */
DEVICE box swept_box(dvec3 x, dvec3 y, double margin, dvec3 origin)
{
  dvec3 lo = dsub(dvec3_min(x, y), origin), hi = dsub(dvec3_max(x, y), origin);
  box b;
  for (int k = 0; k < 3; ++k) {
    double l = dcomponent(lo, k), h = dcomponent(hi, k);
    b.lo[k] = float_below(l - margin - 4e-16 * (fabs(l) + margin));
    b.hi[k] = float_above(h + margin + 4e-16 * (fabs(h) + margin));
  }
  return b;
}

/* margin: per vertex, m; two features become candidates when their distance may be below the sum of their margins. */
KERNEL vertex_boxes(int n, GLOBAL const dvec3 *position, GLOBAL const dvec3 *target, GLOBAL const double *margin,
                    GLOBAL const dvec3 *scene_bounds, GLOBAL box *vertex_box)
{
  FOR_EACH(i, n) vertex_box[i] = swept_box(position[i], target[i], margin[i], scene_bounds[0]);
}

/* Boxes of a vertex, or of the vertices of a feature, at the start [0 .. 3] and the end [4 .. 7] of the step. The upper
   corners are negated and the fourth numbers 0, so that CPUs handle them as vectors. */
typedef struct ALIGNED(32) {
  float lo[8], minus_hi[8];
} end_boxes;

DEVICE end_boxes make_end_boxes(box start, box end)
{
  end_boxes w;
  for (int k = 0; k < 4; ++k) {
    w.lo[k] = k < 3 ? start.lo[k] : 0.0f;
    w.lo[4 + k] = k < 3 ? end.lo[k] : 0.0f;
    w.minus_hi[k] = k < 3 ? -start.hi[k] : 0.0f;
    w.minus_hi[4 + k] = k < 3 ? -end.hi[k] : 0.0f;
  }
  return w;
}

DEVICE end_boxes union_of_ends(end_boxes a, end_boxes b)
{
  SIMD
  for (int k = 0; k < 8; ++k) {
    a.lo[k] = b.lo[k] < a.lo[k] ? b.lo[k] : a.lo[k];
    a.minus_hi[k] = b.minus_hi[k] < a.minus_hi[k] ? b.minus_hi[k] : a.minus_hi[k];
  }
  return a;
}

/* 1 if one coordinate separates a and b at both ends, with the same one below. All vertices go straight and at the same
   rate, so the least coordinate of one less the largest of the other is a concave function of time: it separates them
   throughout. */
DEVICE int ends_separated(end_boxes a, end_boxes b)
{
  int a_above[8], b_above[8], above_a, above_b;
  SIMD
  for (int k = 0; k < 8; ++k) {
    a_above[k] = a.lo[k] + b.minus_hi[k] > 0.0f;
    b_above[k] = b.lo[k] + a.minus_hi[k] > 0.0f;
  }
  above_b = eight_bits(a_above);
  above_a = eight_bits(b_above);
  return ((above_b & (above_b >> 4)) | (above_a & (above_a >> 4))) != 0;
}

/* 1 unless the start x and the end y of a vertex are in its boxes, `least` from their border, m. */
DEVICE int leaves_end_boxes(dvec3 x, dvec3 y, double least, dvec3 origin, GLOBAL const end_boxes *ends)
{
  const dvec3 s = dsub(x, origin), e = dsub(y, origin);
  int leaves = 0;
  for (int k = 0; k < 3; ++k) {
    const double a = dcomponent(s, k), b = dcomponent(e, k), near_a = least + 4e-16 * (fabs(a) + least),
                 near_b = least + 4e-16 * (fabs(b) + least);
    leaves |= (a - near_a < (double)ends->lo[k]) | (-a - near_a < (double)ends->minus_hi[k]) |
              (b - near_b < (double)ends->lo[4 + k]) | (-b - near_b < (double)ends->minus_hi[4 + k]);
  }
  return leaves;
}

/* 0 if both boxes are the same. */
DEVICE int ends_differ(GLOBAL const end_boxes *ends)
{
  int differ = 0;
  for (int k = 0; k < 3; ++k) differ |= (ends->lo[k] != ends->lo[4 + k]) | (ends->minus_hi[k] != ends->minus_hi[4 + k]);
  return differ;
}

/* Where a predicted motion ends is uncertain by uncertain[0], m, and by a share of the motion; a known one changes
   little afterwards. */
#define UNCERTAIN_SHARE 0.125
#define KNOWN_SHARE 0.03125

/* A vertex that moves by no more than this, m, or hardly more than its margin and what is uncertain, may be anywhere in
   its box at both ends: boxes at the ends would separate few pairs. */
DEVICE double shortest_motion(double short_motion, double margin, double uncertain)
{
  return max_double(short_motion, 2.0 * (margin + uncertain));
}

/* far_ends[0]: incremented for each vertex, of those that are asked, that moves further than that and whose end is
   uncertain by more than short_motion: its box there would overlap with those of many neighbours. n: vertices that are
   asked, every ASKED_VERTICES-th. */
#define ASKED_VERTICES 64
KERNEL count_far_ends(int n, GLOBAL const dvec3 *position, GLOBAL const dvec3 *target, GLOBAL const double *margin,
                      GLOBAL const double *short_motion, GLOBAL const double *uncertain, GLOBAL int *far_ends)
{
  FOR_EACH(k, n) {
    const int i = ASKED_VERTICES * k;
    const double moved = dnorm(dsub(target[i], position[i]));
    if (moved > shortest_motion(short_motion[i], margin[i], uncertain[0]) &&
        uncertain[0] + UNCERTAIN_SHARE * moved > short_motion[i])
      atomic_add_int(far_ends, 1);
  }
}

/* Boxes at both ends of the motion `position` to `target`, with the margin of vertex_boxes and what is uncertain about
   its end. A motion is taken for known where more than a quarter of `all`, if any, have far ends: there would be too
   many candidates, and where cloth moves so far they are searched for again anyway. all: below 0 if the motion is
   known. */
KERNEL vertex_end_boxes(int n, GLOBAL const dvec3 *position, GLOBAL const dvec3 *target, GLOBAL const double *margin,
                        GLOBAL const double *short_motion, GLOBAL const dvec3 *scene_bounds,
                        GLOBAL const double *uncertain, int all, GLOBAL const int *far_ends,
                        GLOBAL const box *vertex_box, GLOBAL end_boxes *ends)
{
  FOR_EACH(i, n) {
    const dvec3 x = position[i], y = target[i], d = dsub(y, x);
    const int known = all < 0 || (all > 0 && 4 * far_ends[0] > all);
    const double least = shortest_motion(short_motion[i], margin[i], all < 0 ? 0.0 : uncertain[0]),
                 room = known ? KNOWN_SHARE * dnorm(d) : uncertain[0] + UNCERTAIN_SHARE * dnorm(d);
    if (ddot(d, d) > least * least)
      ends[i] = make_end_boxes(swept_box(x, x, margin[i], scene_bounds[0]),
                               swept_box(y, y, margin[i] + room, scene_bounds[0]));
    else
      ends[i] = make_end_boxes(vertex_box[i], vertex_box[i]);
  }
}

KERNEL face_boxes(int n, GLOBAL const face_nodes *face, GLOBAL const box *vertex_box, GLOBAL box *face_box)
{
  FOR_EACH(i, n) {
    face_nodes f = face[i];
    face_box[i] = box_union(box_union(vertex_box[f.node[0]], vertex_box[f.node[1]]), vertex_box[f.node[2]]);
  }
}

KERNEL edge_boxes(int n, GLOBAL const edge_nodes *edge, GLOBAL const box *vertex_box, GLOBAL box *edge_box)
{
  FOR_EACH(i, n) edge_box[i] = box_union(vertex_box[edge[i].node[0]], vertex_box[edge[i].node[1]]);
}

/* The 21 low bits of v, two zero bits before each. */
DEVICE key64 spread_bits(int v)
{
  key64 x = (key64)v & (key64)0x1fffff;
  x = (x | (x << 32)) & (key64)0x1f00000000ffff;
  x = (x | (x << 16)) & (key64)0x1f0000ff0000ff;
  x = (x | (x << 8)) & (key64)0x100f00f00f00f00f;
  x = (x | (x << 4)) & (key64)0x10c30c30c30c30c3;
  x = (x | (x << 2)) & (key64)0x1249249249249249;
  return x;
}

/* 63-bit Morton code of a box's centre on a cubic grid over the scene. origin: the point that boxes are relative to. */
DEVICE key64 morton_code(box b, GLOBAL const dvec3 *scene_bounds, dvec3 origin)
{
  dvec3 size = dsub(scene_bounds[1], scene_bounds[0]);
  double extent = max_double(size.x, max_double(size.y, size.z)), cells = extent > 0.0 ? 2097151.0 / extent : 0.0;
  dvec3 shift = dsub(origin, scene_bounds[0]);
  key64 code = 0;
  for (int k = 0; k < 3; ++k) {
    double c = (0.5 * ((double)b.lo[k] + (double)b.hi[k]) + dcomponent(shift, k)) * cells;
    code |= spread_bits((int)clamp_double(c, 0.0, 2097151.0)) << k;
  }
  return code;
}

DEVICE box box_of_face(face_nodes f, GLOBAL const box *vertex_box)
{
  return box_union(box_union(vertex_box[f.node[0]], vertex_box[f.node[1]]), vertex_box[f.node[2]]);
}
DEVICE box box_of_edge(edge_nodes e, GLOBAL const box *vertex_box)
{
  return box_union(vertex_box[e.node[0]], vertex_box[e.node[1]]);
}

/* The same for the vertices, faces or edges item[i], with their numbers; origin: [1], the point that boxes are relative
   to. */
KERNEL codes_of_vertices(int n, GLOBAL const int *item, GLOBAL const box *vertex_box, GLOBAL const dvec3 *scene_bounds,
                         GLOBAL const dvec3 *origin, GLOBAL key64 *key, GLOBAL int *index)
{
  FOR_EACH(i, n) {
    key[i] = morton_code(vertex_box[item[i]], scene_bounds, origin[0]);
    index[i] = item[i];
  }
}
KERNEL codes_of_faces(int n, GLOBAL const int *item, GLOBAL const face_nodes *face, GLOBAL const box *vertex_box,
                      GLOBAL const dvec3 *scene_bounds, GLOBAL const dvec3 *origin, GLOBAL key64 *key,
                      GLOBAL int *index)
{
  FOR_EACH(i, n) {
    key[i] = morton_code(box_of_face(face[item[i]], vertex_box), scene_bounds, origin[0]);
    index[i] = item[i];
  }
}
KERNEL codes_of_edges(int n, GLOBAL const int *item, GLOBAL const edge_nodes *edge, GLOBAL const box *vertex_box,
                      GLOBAL const dvec3 *scene_bounds, GLOBAL const dvec3 *origin, GLOBAL key64 *key,
                      GLOBAL int *index)
{
  FOR_EACH(i, n) {
    key[i] = morton_code(box_of_edge(edge[item[i]], vertex_box), scene_bounds, origin[0]);
    index[i] = item[i];
  }
}

#endif
