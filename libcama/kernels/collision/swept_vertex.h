/* SPDX-License-Identifier: Apache-2.0 */
/* Swept vertices: positions and motions in floats, which show most candidate pairs to be no contacts at a fraction of
   the cost of their closest points. */
#ifndef CAMA_KERNELS_COLLISION_SWEPT_VERTEX_H
#define CAMA_KERNELS_COLLISION_SWEPT_VERTEX_H
#include "../dialect/dvec3.h"
#include "../dialect/lanes.h"
#include "../dialect/lang.h"
#include "../system/incidence.h"
#include "bounds.h"
#include "ccd.h"
#include "pair.h"
#include "query.h"

/* Vectors of three floats. */
typedef struct {
  float x, y, z;
} fvec3;
DEVICE fvec3 fvec3_make(float x, float y, float z)
{
  fvec3 r;
  r.x = x;
  r.y = y;
  r.z = z;
  return r;
}
/* A unit vector as a separating direction: not longer than 1. */
DEVICE fvec3 to_direction(dvec3 n)
{
  return fvec3_make((float)(0.9999999 * n.x), (float)(0.9999999 * n.y), (float)(0.9999999 * n.z));
}
DEVICE dvec3 from_direction(fvec3 n) { return dvec3_make((double)n.x, (double)n.y, (double)n.z); }

/* Position and motion until the prediction relative to the scene's lower corner, contact thickness and radius of a
   vertex, all m. They are rounded to floats: decisions by them leave a rounding_margin of SWEPT_ROUNDING times the
   scene's extent, which covers the floats (6e-8 each, two to an offset) and the about thirty operations on them. */
typedef struct {
  float x, y, z, dx, dy, dz, thickness, radius;
} swept_vertex;
#define SWEPT_ROUNDING 6e-6

/* Of found[], which the kernels that find contacts share: */
#define NEAR_PAIRS 0    /* pairs that no bound decides */
#define NEAR_CONTACTS 1 /* of these the contacts */
#define NEAR_KEPT 2     /* of these the ones that no other cloth hides */
#define NEAR_COUNTS 3

/* A plane has a huge radius, so that swept vertices decide nothing about it. rounding_margin: [1], the most that
   rounding may take from a gap, m. found: 0 afterwards. */
KERNEL make_swept_vertices(int n, GLOBAL const dvec3 *position, GLOBAL const dvec3 *predicted,
                           GLOBAL const dvec3 *scene_bounds, GLOBAL const vertex_contact *v,
                           GLOBAL swept_vertex *swept_vertices, GLOBAL float *rounding_margin, GLOBAL int *found)
{
  FOR_EACH(i, n) {
    dvec3 x = dsub(position[i], scene_bounds[0]), d = dsub(predicted[i], position[i]);
    swept_vertex m;
    m.x = (float)x.x;
    m.y = (float)x.y;
    m.z = (float)x.z;
    m.dx = (float)d.x;
    m.dy = (float)d.y;
    m.dz = (float)d.z;
    m.thickness = float_above(v[i].thickness);
    m.radius = v[i].shape == SHAPE_PLANE ? 1e30f : float_above(v[i].radius);
    swept_vertices[i] = m;
    if (i == 0) {
      rounding_margin[0] =
          float_above(SWEPT_ROUNDING * largest_component(dsub(scene_bounds[1], scene_bounds[0])) +
                      1e-15 * max_double(largest_component(scene_bounds[0]), largest_component(scene_bounds[1])));
      found[NEAR_PAIRS] = found[NEAR_CONTACTS] = found[NEAR_KEPT] = 0;
    }
  }
}

/* Vectors and swept vertices of LANES pairs. */
typedef struct {
  float_lanes x, y, z;
} fvec3_lanes;
typedef struct {
  float_lanes x, y, z, dx, dy, dz, thickness, radius;
} swept_vertex_lanes;

DEVICE INLINED fvec3_lanes lanes_minus(fvec3_lanes a, fvec3_lanes b)
{
  fvec3_lanes r;
  r.x = a.x - b.x;
  r.y = a.y - b.y;
  r.z = a.z - b.z;
  return r;
}
DEVICE INLINED float_lanes lanes_dot(fvec3_lanes a, fvec3_lanes b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
DEVICE INLINED float_lanes lanes_max(float_lanes a, float_lanes b) { return LANES_SELECT(float_lanes, a > b, a, b); }
DEVICE INLINED float_lanes lanes_min(float_lanes a, float_lanes b) { return LANES_SELECT(float_lanes, a < b, a, b); }
/* 1 / sqrt(a) to 3e-7 for a > 0, in plain arithmetic: the same bits everywhere. */
DEVICE INLINED float_lanes lanes_inverse_root(float_lanes a)
{
  float_lanes y = BITS_FLOAT_LANES(0x5f3759df - (FLOAT_LANES_BITS(a) >> 1)), h = 0.5f * a;
  y = y * (1.5f - h * y * y);
  y = y * (1.5f - h * y * y);
  y = y * (1.5f - h * y * y);
  return y * (1.5f - h * y * y);
}
/* The same everywhere: division of doubles is rounded correctly in every language, that of floats is not. */
DEVICE INLINED float_lanes lanes_inverse(float_lanes a)
{
  return LANES_TO(float, float_lanes, 1.0 / LANES_TO(double, double_lanes, a));
}

/* A swept vertex in every lane. */
DEVICE INLINED swept_vertex_lanes swept_vertex_in_lanes(swept_vertex v)
{
  swept_vertex_lanes m;
  m.x = LANES_ALL(float_lanes, v.x);
  m.y = LANES_ALL(float_lanes, v.y);
  m.z = LANES_ALL(float_lanes, v.z);
  m.dx = LANES_ALL(float_lanes, v.dx);
  m.dy = LANES_ALL(float_lanes, v.dy);
  m.dz = LANES_ALL(float_lanes, v.dz);
  m.thickness = LANES_ALL(float_lanes, v.thickness);
  m.radius = LANES_ALL(float_lanes, v.radius);
  return m;
}

DEVICE INLINED fvec3_lanes swept_offset(swept_vertex_lanes a, swept_vertex_lanes b)
{
  fvec3_lanes r;
  r.x = a.x - b.x;
  r.y = a.y - b.y;
  r.z = a.z - b.z;
  return r;
}

/* Square of the relative motion of two vertices. */
DEVICE INLINED float_lanes swept_motion(swept_vertex_lanes a, swept_vertex_lanes b)
{
  fvec3_lanes d;
  d.x = a.dx - b.dx;
  d.y = a.dy - b.dy;
  d.z = a.dz - b.dz;
  return lanes_dot(d, d);
}

/* Upper bound of a pair's thickness, m. */
DEVICE INLINED float_lanes swept_thickness(int kind, swept_vertex_lanes m0, swept_vertex_lanes m1,
                                           swept_vertex_lanes m2, swept_vertex_lanes m3)
{
  if (kind == 0) return 1.000001f * (0.5f * m0.thickness + (m1.thickness + m2.thickness + m3.thickness) * 0.16666667f);
  return 1.000001f * (0.25f * (m0.thickness + m1.thickness + m2.thickness + m3.thickness));
}

/* What the distance of the surfaces until the prediction falls short of that of the hulls along a direction: relative
   motion of the sides, radii, rounding, m. */
DEVICE INLINED float_lanes swept_motion_spent(int kind, swept_vertex_lanes m0, swept_vertex_lanes m1,
                                              swept_vertex_lanes m2, swept_vertex_lanes m3, float rounding)
{
  float_lanes most = lanes_max(swept_motion(m0, m2), swept_motion(m0, m3));
  if (kind == 0) {
    most = lanes_max(most, swept_motion(m1, m0));
    return 1.000001f * (most * lanes_inverse_root(most)) + m0.radius + m1.radius + rounding;
  }
  most = lanes_max(lanes_max(most, swept_motion(m1, m2)), swept_motion(m1, m3));
  return 1.000001f * (most * lanes_inverse_root(most)) + m0.radius + m2.radius + rounding;
}

/* Separation of a pair's hulls along n times the length of n, at least 0; x: vertices 1 to 3 relative to vertex 0. */
DEVICE INLINED float_lanes swept_hull_separation(int kind, fvec3_lanes x1, fvec3_lanes x2, fvec3_lanes x3,
                                                 fvec3_lanes n)
{
  const float_lanes none = LANES_ALL(float_lanes, 0.0f);
  float_lanes a = lanes_dot(n, x1), high = lanes_max(lanes_dot(n, x2), lanes_dot(n, x3));
  if (kind == 0) return lanes_max(none, -lanes_max(high, a));
  return lanes_max(none, lanes_min(none, a) - high);
}

/* x, the offset of vertex a from b, at the prediction. */
DEVICE INLINED fvec3_lanes swept_end(fvec3_lanes x, swept_vertex_lanes a, swept_vertex_lanes b)
{
  x.x = x.x + (a.dx - b.dx);
  x.y = x.y + (a.dy - b.dy);
  x.z = x.z + (a.dz - b.dz);
  return x;
}

/* The least separation of a pair's surfaces along n, which is not longer than 1, until the prediction, at least 0, m.
   All vertices go straight and at the same rate, so that of the hulls is a concave function of time: its least value is
   at an end. */
DEVICE INLINED float_lanes swept_gap(int kind, swept_vertex_lanes m0, swept_vertex_lanes m1, swept_vertex_lanes m2,
                                     swept_vertex_lanes m3, fvec3_lanes n, float rounding)
{
  const fvec3_lanes x1 = swept_offset(m1, m0), x2 = swept_offset(m2, m0), x3 = swept_offset(m3, m0);
  const float_lanes none = LANES_ALL(float_lanes, 0.0f), start = swept_hull_separation(kind, x1, x2, x3, n),
                    end = swept_hull_separation(kind, swept_end(x1, m1, m0), swept_end(x2, m2, m0),
                                                swept_end(x3, m3, m0), n);
  return lanes_max(none, lanes_min(start, end) - (m0.radius + (kind == 0 ? m1.radius : m2.radius) + rounding));
}

/* `a` minus its part along b. */
DEVICE INLINED fvec3_lanes across(fvec3_lanes a, fvec3_lanes b)
{
  const float_lanes along = lanes_dot(a, b) * lanes_inverse(lanes_dot(b, b));
  a.x = a.x - along * b.x;
  a.y = a.y - along * b.y;
  a.z = a.z - along * b.z;
  return a;
}

/* gap: separation of the hulls along the direction times its length; size: the square of that length. */
typedef struct {
  float_lanes gap, size;
  fvec3_lanes direction;
} separation_bound;

/* The wider of the separations `a` and that along direction d. */
DEVICE INLINED separation_bound wider_separation(int kind, fvec3_lanes x1, fvec3_lanes x2, fvec3_lanes x3,
                                                 fvec3_lanes d, separation_bound a)
{
  float_lanes gap = swept_hull_separation(kind, x1, x2, x3, d), size = lanes_dot(d, d);
  float_lanes own = a.gap * a.gap * size, other = gap * gap * a.size;
  a.gap = LANES_SELECT(float_lanes, other > own, gap, a.gap);
  a.size = LANES_SELECT(float_lanes, other > own, size, a.size);
  a.direction.x = LANES_SELECT(float_lanes, other > own, d.x, a.direction.x);
  a.direction.y = LANES_SELECT(float_lanes, other > own, d.y, a.direction.y);
  a.direction.z = LANES_SELECT(float_lanes, other > own, d.z, a.direction.z);
  return a;
}

/* The direction with the widest gap of three: that between the centres of both sides, and its parts perpendicular to
   two of the pair's edges; its length is about 1. `gap` becomes the bound along it: the smallest distance of the
   surfaces until the prediction, 0 if it does not exceed the thickness. With `contacts` it is also 0 where a relative
   motion as long in another direction could end below the thickness. No branches: they would be mispredicted, and pairs
   could not be decided in lanes. */
DEVICE INLINED separation_bound separation_along(int kind, int contacts, swept_vertex_lanes m0, swept_vertex_lanes m1,
                                                 swept_vertex_lanes m2, swept_vertex_lanes m3, float rounding)
{
  const float_lanes none = LANES_ALL(float_lanes, 0.0f);
  fvec3_lanes x1 = swept_offset(m1, m0), x2 = swept_offset(m2, m0), x3 = swept_offset(m3, m0), middle;
  float_lanes scale, bound, certain;
  separation_bound r;
  if (kind == 0) {
    middle.x = -0.33333334f * (x1.x + x2.x + x3.x);
    middle.y = -0.33333334f * (x1.y + x2.y + x3.y);
    middle.z = -0.33333334f * (x1.z + x2.z + x3.z);
  } else {
    middle.x = 0.5f * (x1.x - x2.x - x3.x);
    middle.y = 0.5f * (x1.y - x2.y - x3.y);
    middle.z = 0.5f * (x1.z - x2.z - x3.z);
  }
  r.direction = middle;
  r.gap = swept_hull_separation(kind, x1, x2, x3, middle);
  r.size = lanes_dot(middle, middle);
  r = wider_separation(kind, x1, x2, x3, across(middle, kind == 0 ? lanes_minus(x2, x1) : x1), r);
  r = wider_separation(kind, x1, x2, x3, across(middle, lanes_minus(x3, x2)), r);
  scale = LANES_SELECT(float_lanes, r.size > 1e-30f, 0.999999f * lanes_inverse_root(r.size), none);
  r.direction.x = scale * r.direction.x;
  r.direction.y = scale * r.direction.y;
  r.direction.z = scale * r.direction.z;
  bound = certain = swept_gap(kind, m0, m1, m2, m3, r.direction, rounding);
  if (contacts) certain = r.gap * scale - swept_motion_spent(kind, m0, m1, m2, m3, rounding);
  r.gap = LANES_SELECT(float_lanes, certain > swept_thickness(kind, m0, m1, m2, m3), bound, none);
  return r;
}

/* gap_bound of one pair along a direction, m; 0 if it does not exceed the thickness. */
DEVICE float gap_bound_along(int kind, swept_vertex v0, swept_vertex v1, swept_vertex v2, swept_vertex v3,
                             fvec3 direction, float rounding)
{
  swept_vertex_lanes m0 = swept_vertex_in_lanes(v0), m1 = swept_vertex_in_lanes(v1), m2 = swept_vertex_in_lanes(v2),
                     m3 = swept_vertex_in_lanes(v3);
  fvec3_lanes n;
  float_lanes gap_bound;
  n.x = LANES_ALL(float_lanes, direction.x);
  n.y = LANES_ALL(float_lanes, direction.y);
  n.z = LANES_ALL(float_lanes, direction.z);
  gap_bound = swept_gap(kind, m0, m1, m2, m3, n, rounding);
  return LANE(gap_bound, 0) > LANE(swept_thickness(kind, m0, m1, m2, m3), 0) ? LANE(gap_bound, 0) : 0.0f;
}

/* Vertex k of the pairs in the lanes. */
DEVICE INLINED swept_vertex_lanes swept_vertices_of(GLOBAL const swept_vertex *swept_vertices, const element_nodes *e,
                                                    int k)
{
  float v[8][LANES];
  swept_vertex_lanes m;
  FOR_LANES(q) {
    swept_vertex own = swept_vertices[e[q].node[k]];
    v[0][q] = own.x;
    v[1][q] = own.y;
    v[2][q] = own.z;
    v[3][q] = own.dx;
    v[4][q] = own.dy;
    v[5][q] = own.dz;
    v[6][q] = own.thickness;
    v[7][q] = own.radius;
  }
  m.x = LANES_LOAD(float_lanes, v[0]);
  m.y = LANES_LOAD(float_lanes, v[1]);
  m.z = LANES_LOAD(float_lanes, v[2]);
  m.dx = LANES_LOAD(float_lanes, v[3]);
  m.dy = LANES_LOAD(float_lanes, v[4]);
  m.dz = LANES_LOAD(float_lanes, v[5]);
  m.thickness = LANES_LOAD(float_lanes, v[6]);
  m.radius = LANES_LOAD(float_lanes, v[7]);
  return m;
}

/* Pairs that swept vertices show to keep more than the thickness get gap_bound, the smallest separation until the
   prediction along `direction`, from side B to side A, m; the others get 0, with `contacts` all that may be one. */
KERNEL cull_separated_pairs(int n, int kind, int contacts, GLOBAL const pair *pairs, GLOBAL const face_nodes *face,
                            GLOBAL const edge_nodes *edge, GLOBAL const swept_vertex *swept_vertices,
                            GLOBAL const float *rounding_margin, GLOBAL fvec3 *direction, GLOBAL float *gap_bound)
{
  int batches = (n - 1) / LANES + 1;
  float rounding;
  AWAIT_LAUNCHES;
  rounding = rounding_margin[0];
  FOR_EACH(b, batches) {
    element_nodes e[LANES];
    swept_vertex_lanes m0, m1, m2, m3;
    separation_bound r;
    int first = LANES * b;
    FOR_LANES(q) e[q] = pair_nodes(kind, pairs[min_int(first + q, n - 1)], face, edge);
    m0 = swept_vertices_of(swept_vertices, e, 0);
    m1 = swept_vertices_of(swept_vertices, e, 1);
    m2 = swept_vertices_of(swept_vertices, e, 2);
    m3 = swept_vertices_of(swept_vertices, e, 3);
    if (kind == 0)
      r = separation_along(0, contacts, m0, m1, m2, m3, rounding);
    else
      r = separation_along(1, contacts, m0, m1, m2, m3, rounding);
    FOR_LANES(q) {
      if (first + q < n) {
        direction[first + q] = fvec3_make(LANE(r.direction.x, q), LANE(r.direction.y, q), LANE(r.direction.z, q));
        gap_bound[first + q] = LANE(r.gap, q);
      }
    }
  }
}

#endif
