/* SPDX-License-Identifier: Apache-2.0 */
/* Records of the contact system, and proximity tests that make contacts of candidate pairs (paper, section 3.2). */
#ifndef CAMA_KERNELS_COLLISION_PAIR_H
#define CAMA_KERNELS_COLLISION_PAIR_H
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"
#include "../system/incidence.h"
#include "bounds.h"
#include "ccd.h"
#include "distance.h"
#include "query.h"

typedef struct {
  int node[4];        /* vertex then face, or two edges */
  int kind;           /* 0 vertex-face, 1 edge-edge */
  int candidate;      /* the pair it came from */
  double weight[4];   /* sum_k w_k x_k is the difference vector, side A minus side B */
  dvec3 normal;       /* from B to A */
  double distance;    /* m */
  double thickness;   /* m */
  double stiffness;   /* N/m */
  double friction;         /* Coulomb coefficient while it slides */
  double static_friction;  /* while it sticks, not below `friction` */
} contact;

typedef struct {
  int node[3];
  double ratio, stiffness; /* 1, N/m */
  double length;           /* at rest, m; above 0 it only pulls */
} stitch;

/* Few candidates need much work. A first kernel finds them: a team takes RUN_PAIRS candidates, chooses in TEAM_LOCAL
   memory and appends to the list of the launch. A second kernel works on the list (FOR_EACH_LISTED), so that all
   threads of a warp have work, and the first has the few registers that let many threads wait for memory at once. */
#define PAIR_TEAM 256
#define RUN_PAIRS 512
#define LIST_TEAMS 1024

/* Begins a choice: listed[0], the number of what a team has chosen, is 0. */
DEVICE_TEAM void begin_chosen(LOCAL int *listed)
{
  TEAM_BARRIER;
  TEAM_FOR(l, 1) listed[0] = 0;
  TEAM_BARRIER;
}

/* Appends what a team has chosen to a list of *length items, in any order. chosen: [RUN_PAIRS]; listed: [2]. */
DEVICE_TEAM void append_chosen(LOCAL const int *chosen, LOCAL int *listed, GLOBAL int *list, GLOBAL int *length)
{
  TEAM_BARRIER;
  TEAM_FOR(l, 1) listed[1] = listed[0] > 0 ? atomic_add_int(length, listed[0]) : 0;
  TEAM_BARRIER;
  TEAM_FOR(l, listed[0]) list[listed[1] + l] = chosen[l];
}

/* How many a team has chosen; the next may be chosen at once. */
DEVICE_TEAM int chosen_so_far(LOCAL const int *listed)
{
  int count;
  TEAM_BARRIER;
  count = listed[0];
  TEAM_BARRIER;
  return count;
}

/* 1 if teams with `members` members in all put off what takes longest in a list: it is long, and they have more than a
   turn each. */
#define LATE_WORK 65536
DEVICE int has_late_work(int listed, int members) { return listed > min_int(members, LATE_WORK); }

/* The place of a candidate by one number, which stays when both lists grow: `at` in the list of vertices and faces, ~at
   in that of edges. */
DEVICE int pair_code(int kind, int at) { return kind == 0 ? at : ~at; }
DEVICE int code_kind(int code) { return code < 0; }
DEVICE int code_place(int code) { return code < 0 ? ~code : code; }
#define NO_PAIR 0x7fffffff

/* Places k in a list of *length items, by at most LIST_TEAMS teams of PAIR_TEAM members (n). */
#define FOR_EACH_LISTED(t, k, n, length)                                               \
  FOR_EACH_UNEVEN_TEAM(t, n)                                                           \
    for (int k##_run = t * PAIR_TEAM; k##_run < *(length); k##_run += (n) * PAIR_TEAM) \
      TEAM_FOR(k, min_int(*(length) - k##_run, PAIR_TEAM))

/* By how much a stitch is longer than at rest, m, where its ends are `distance` apart. */
DEVICE double stitch_stretch(stitch s, double distance)
{
  return s.length > 0.0 ? max_double(distance - s.length, 0.0) : distance;
}

/* Contact properties of a vertex. */
typedef struct {
  double thickness, area; /* m, m^2 */
  double stiffness; /* penalty per area against the same material, N/m^3 */
  double friction, static_friction;
  double radius; /* of the sphere around the vertex of an exact obstacle; 0 elsewhere, m */
  int obstacle, shape; /* shape: SHAPE_* */
} vertex_contact;

#define SHAPE_MESH 0
/* A sphere is the face (c, c, c), a capsule the face (a, b, b); distances are those of the hulls minus the radius. */
#define SHAPE_ROUND 1
#define SHAPE_PLANE 2 /* the unbounded half space below the plane of the face */

DEVICE element_nodes pair_nodes(int kind, pair p, GLOBAL const face_nodes *face, GLOBAL const edge_nodes *edge)
{
  element_nodes e;
  if (kind == 0) {
    e.node[0] = p.a;
    e.node[1] = face[p.b].node[0];
    e.node[2] = face[p.b].node[1];
    e.node[3] = face[p.b].node[2];
  } else {
    e.node[0] = edge[p.a].node[0];
    e.node[1] = edge[p.a].node[1];
    e.node[2] = edge[p.b].node[0];
    e.node[3] = edge[p.b].node[1];
  }
  return e;
}

/* The proximity of a pair at given positions. */
DEVICE proximity pair_proximity(int kind, element_nodes e, GLOBAL const dvec3 *x)
{
  dvec3 o = x[e.node[0]], z = dvec3_make(0.0, 0.0, 0.0);
  dvec3 b = dsub(x[e.node[1]], o), c = dsub(x[e.node[2]], o), d = dsub(x[e.node[3]], o);
  return kind == 0 ? vertex_face_proximity(z, b, c, d) : edge_edge_proximity(z, b, c, d);
}

/* Radii of both sides together, m. All vertices of a side belong to one object. */
DEVICE double pair_radius(int kind, element_nodes e, GLOBAL const vertex_contact *v)
{
  return v[e.node[0]].radius + v[e.node[kind + 1]].radius;
}

/* Smallest contact thickness of the four vertices, m. */
DEVICE double pair_min_thickness(element_nodes e, GLOBAL const vertex_contact *v)
{
  return min_double(min_double(v[e.node[0]].thickness, v[e.node[1]].thickness),
                    min_double(v[e.node[2]].thickness, v[e.node[3]].thickness));
}

/* Distance that a pair's hulls keep: a share of its smallest thickness, plus the radii, m. */
DEVICE double pair_clearance(int kind, element_nodes e, GLOBAL const vertex_contact *v, double share)
{
  return share * pair_min_thickness(e, v) + pair_radius(kind, e, v);
}

DEVICE int pair_has_plane(int kind, element_nodes e, GLOBAL const vertex_contact *v)
{
  return kind == 0 && v[e.node[1]].shape == SHAPE_PLANE;
}

/* A vertex over the half space below the plane of a, b, c; the distance is negative inside. A plane only translates:
   all its points move as the closest one does, so one node represents it. */
DEVICE proximity vertex_plane_proximity(dvec3 vertex, dvec3 a, dvec3 b, dvec3 c)
{
  proximity p;
  p.normal = dnormalize(dcross(dsub(b, a), dsub(c, a)));
  p.distance = ddot(p.normal, dsub(vertex, a));
  p.weight[0] = 1.0;
  p.weight[1] = -1.0;
  p.weight[2] = p.weight[3] = 0.0;
  p.interior = 1;
  return p;
}

/* 1 if the closest point of a vertex to its face lies inside an edge of it. */
DEVICE int within_edge(proximity p) { return (p.weight[1] == 0.0) + (p.weight[2] == 0.0) + (p.weight[3] == 0.0) == 1; }

/* The proximity of a pair for contact, with radii and planes taken into account. A round obstacle has no border: all
   its points are interior, and so are the points inside an edge that its centre or end is closest to, for it has no
   edge of its own that would touch there. */
DEVICE proximity surface_proximity(int kind, element_nodes e, GLOBAL const dvec3 *x, GLOBAL const vertex_contact *v)
{
  proximity p;
  if (pair_has_plane(kind, e, v)) return vertex_plane_proximity(x[e.node[0]], x[e.node[1]], x[e.node[2]], x[e.node[3]]);
  p = pair_proximity(kind, e, x);
  if (kind == 0 && (v[e.node[1]].shape == SHAPE_ROUND || (v[e.node[0]].shape == SHAPE_ROUND && within_edge(p))))
    p.interior = p.distance > 0.0;
  p.distance -= pair_radius(kind, e, v);
  return p;
}

DEVICE double mean4(double a, double b, double c, double d) { return 0.25 * (a + b + c + d); }

/* Thickness of a pair: half of side A's plus half of side B's. */
DEVICE double pair_thickness(int kind, element_nodes e, GLOBAL const vertex_contact *v)
{
  double t0 = v[e.node[0]].thickness, t1 = v[e.node[1]].thickness, t2 = v[e.node[2]].thickness,
         t3 = v[e.node[3]].thickness;
  return kind == 0 ? 0.5 * t0 + (t1 + t2 + t3) / 6.0 : mean4(t0, t1, t2, t3);
}

/* An obstacle's coefficient holds for everything that touches it; two cloths take their mean. */
DEVICE double pair_friction(vertex_contact a, vertex_contact b)
{
  return a.obstacle ? a.friction : (b.obstacle ? b.friction : 0.5 * (a.friction + b.friction));
}
DEVICE double pair_static_friction(vertex_contact a, vertex_contact b)
{
  return a.obstacle ? a.static_friction
                    : (b.obstacle ? b.static_friction : 0.5 * (a.static_friction + b.static_friction));
}

/* Penalty per area of two layers in series, N/m^3: their harmonic mean, so that two equal layers keep their own. */
DEVICE double pair_stiffness(vertex_contact a, vertex_contact b)
{
  return a.stiffness == b.stiffness ? a.stiffness : 2.0 * a.stiffness * b.stiffness / (a.stiffness + b.stiffness);
}

/* Sine of the angle at which the face of edge (a, b) and vertex w rises along n, which is perpendicular to the edge; 0
   without a face (w < 0). */
DEVICE double rise_along(int a, int b, int w, dvec3 n, GLOBAL const dvec3 *position)
{
  dvec3 u, r;
  double rr;
  if (w < 0) return 0.0;
  u = dsub(position[b], position[a]);
  if (!(ddot(u, u) > 0.0)) return 0.0;
  r = segment_rejection(dsub(position[w], position[a]), u);
  rr = ddot(r, r);
  return rr > 0.0 ? ddot(r, n) / sqrt(rr) : 0.0;
}

/* Share of its stiffness that a contact of two edges has. Where points of a face beside one of them are nearer to the
   other side, the pair is no closest one of the surfaces: its normal leans over the face, and an edge in the middle of
   a flat surface would be a ledge that stops what slides across. Such contacts fade out as the sine of the angle grows;
   they are not anticipated. wing: the vertices beside each edge, -1 where there is none. */
#define LEANS_LEAST 0.05
#define LEANS_MOST 0.3
DEVICE double edge_contact_share(element_nodes e, edge_nodes wing_a, edge_nodes wing_b, dvec3 normal,
                                 GLOBAL const dvec3 *position)
{
  double lean = LEANS_LEAST;
  int k;
  for (k = 0; k < 2; ++k) {
    lean = max_double(lean, -rise_along(e.node[0], e.node[1], wing_a.node[k], normal, position));
    lean = max_double(lean, rise_along(e.node[2], e.node[3], wing_b.node[k], normal, position));
  }
  return max_double((LEANS_MOST - lean) / (LEANS_MOST - LEANS_LEAST), 0.0);
}

/* 1 if a coordinate separates a pair by more than `distance` throughout the motion x to y. */
DEVICE int pair_separated(int kind, element_nodes e, GLOBAL const dvec3 *x, GLOBAL const dvec3 *y, double distance)
{
  dvec3 start[4], motion[4];
  for (int k = 0; k < 4; ++k) {
    start[k] = dsub(x[e.node[k]], x[e.node[0]]);
    motion[k] = dsub(dsub(y[e.node[k]], y[e.node[0]]), start[k]);
  }
  return axis_separated(start, motion, kind + 1, distance);
}

/* Makes the contact of a candidate pair, if it is one: the closest points are interior, and nearer than the thickness
   now or (anticipate > 0) after the predicted displacement, unless a coordinate separates the pair throughout. By
   distance alone (anticipate 0), as in the paper, contacts of edges have their whole stiffness. wing: [edges] the
   vertices beside each. */
DEVICE int make_contact(int kind, pair q, element_nodes e, GLOBAL const edge_nodes *wing, GLOBAL const dvec3 *position,
                        GLOBAL const dvec3 *predicted, GLOBAL const vertex_contact *v, double anticipate, proximity p,
                        contact *c)
{
  double thickness, approach = 0.0, share = 1.0, area_a, area_b;
  int k;
  if (!p.interior || !(p.distance + pair_radius(kind, e, v) > 0.0)) return 0;
  thickness = pair_thickness(kind, e, v);
  for (k = 0; k < 4; ++k) approach += p.weight[k] * ddot(p.normal, dsub(predicted[e.node[k]], position[e.node[k]]));
  if (!(p.distance < thickness || (anticipate > 0.0 && p.distance + approach < thickness))) return 0;
  if (p.distance >= thickness + anticipate) return 0;
  if (p.distance >= thickness && !pair_has_plane(kind, e, v) &&
      pair_separated(kind, e, position, predicted, pair_clearance(kind, e, v, 1.0)))
    return 0;
  if (kind == 1 && anticipate > 0.0) {
    share = edge_contact_share(e, wing[q.a], wing[q.b], p.normal, position);
    if (!(share > 0.0) || (share < 1.0 && !(p.distance < thickness))) return 0;
  }
  if (kind == 0) {
    area_a = v[e.node[0]].area;
    area_b = v[e.node[1]].area + v[e.node[2]].area + v[e.node[3]].area;
  } else {
    area_a = 0.5 * (v[e.node[0]].area + v[e.node[1]].area);
    area_b = 0.5 * (v[e.node[2]].area + v[e.node[3]].area);
  }
  for (k = 0; k < 4; ++k) {
    c->node[k] = e.node[k];
    c->weight[k] = p.weight[k];
  }
  c->kind = kind;
  c->normal = p.normal;
  c->distance = p.distance;
  c->thickness = thickness;
  c->stiffness = share * pair_stiffness(v[e.node[0]], v[e.node[3]]) * min_double(area_a, area_b);
  c->friction = pair_friction(v[e.node[0]], v[e.node[3]]);
  c->static_friction = pair_static_friction(v[e.node[0]], v[e.node[3]]);
  return 1;
}

#endif
