/* SPDX-License-Identifier: Apache-2.0 */
/* Penetration handling (paper, section 4): which candidates touch on their way, and where. impulses.h projects them. */
#ifndef CAMA_KERNELS_COLLISION_IMPACT_H
#define CAMA_KERNELS_COLLISION_IMPACT_H
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"
#include "../system/incidence.h"
#include "bounds.h"
#include "ccd.h"
#include "contact.h"
#include "cubic.h"
#include "distance.h"
#include "pair.h"
#include "query.h"
#include "swept_vertex.h"

typedef struct ALIGNED(32) {
  int node[4];
  int kind;
  int candidate;
  int repeated; /* 1: found before in this step */
  double weight[4]; /* signed, at the time of impact */
  dvec3 normal; /* from side B to side A at the time of impact */
  double target; /* distance to which the projection separates the pair, m */
} impact;

/* What the projection finds for an impact. */
typedef struct ALIGNED(16) {
  double lambda; /* multiplier of its constraint, kg m */
  double change; /* of lambda in the last step */
} impulse;

/* cubic: the paper's test, at distance 0; else the additive method, at `minimum`. */
DEVICE impact_time candidate_impact_time(int kind, int cubic, element_nodes e, GLOBAL const dvec3 *x,
                                         GLOBAL const dvec3 *y, double minimum, int most)
{
  dvec3 o = x[e.node[0]], z = dvec3_make(0.0, 0.0, 0.0);
  dvec3 a0 = dsub(x[e.node[1]], o), b0 = dsub(x[e.node[2]], o), c0 = dsub(x[e.node[3]], o);
  dvec3 o1 = dsub(y[e.node[0]], o), a1 = dsub(y[e.node[1]], o), b1 = dsub(y[e.node[2]], o), c1 = dsub(y[e.node[3]], o);
  if (cubic) return linear_impact_cubic(kind == 0 ? 1 : 2, z, a0, b0, c0, o1, a1, b1, c1);
  return linear_impact_time(kind == 0 ? 1 : 2, z, a0, b0, c0, o1, a1, b1, c1, minimum, most);
}

/* Normal of touching features, opposite to their weighted relative motion: that of the face, or common to the edges,
   where it is well defined, else that of the proximity. */
DEVICE dvec3 touching_normal(int kind, const dvec3 *at, const dvec3 *motion, proximity p)
{
  dvec3 u = kind == 0 ? dsub(at[2], at[1]) : dsub(at[1], at[0]),
        w = kind == 0 ? dsub(at[3], at[1]) : dsub(at[3], at[2]), n = dcross(u, w);
  double approach = 0.0;
  int k;
  n = ddot(n, n) > 1e-12 * ddot(u, u) * ddot(w, w) ? dnormalize(n) : p.normal;
  for (k = 0; k < 4; ++k) approach += p.weight[k] * ddot(n, motion[k]);
  return approach > 0.0 ? dscale(-1.0, n) : n;
}

/* 1 if the separation of the pair along direction n is at least `least` at both ends of the motion x to y, hence
   throughout: the separation along a fixed direction is concave in time. Only relative motion counts. */
DEVICE int separated_along(int kind, element_nodes e, GLOBAL const dvec3 *x, GLOBAL const dvec3 *y, dvec3 n,
                           double least)
{
  dvec3 o = x[e.node[0]], p = y[e.node[0]];
  double a0 = 0.0, a1 = 0.0, b0 = -1e300, b1 = -1e300;
  int k;
  for (k = 1; k < 4; ++k) {
    double h0 = ddot(n, dsub(x[e.node[k]], o)), h1 = ddot(n, dsub(y[e.node[k]], p));
    if (k == 1 && kind == 1) {
      a0 = min_double(a0, h0);
      a1 = min_double(a1, h1);
    } else {
      b0 = max_double(b0, h0);
      b1 = max_double(b1, h1);
    }
  }
  return a0 - b0 >= least && a1 - b1 >= least;
}

/* The first time at which the hulls of a pair come closer than `minimum`. A plane is hit when the height, linear in
   time, falls below `minimum`, or at once by a vertex that starts below it. The cubic, which has no minimum distance,
   is for pairs without a radius. */
DEVICE int takes_cubic(int kind, int cubic, element_nodes e, GLOBAL const vertex_contact *v)
{
  return cubic && !pair_has_plane(kind, e, v) && pair_radius(kind, e, v) == 0.0;
}
DEVICE impact_time surface_impact_time(int kind, int cubic, element_nodes e, GLOBAL const dvec3 *x,
                                       GLOBAL const dvec3 *y, GLOBAL const vertex_contact *v, double minimum, int most)
{
  impact_time r;
  double start, end;
  if (!pair_has_plane(kind, e, v))
    return candidate_impact_time(kind, takes_cubic(kind, cubic, e, v), e, x, y, minimum, most);
  start = vertex_plane_proximity(x[e.node[0]], x[e.node[1]], x[e.node[2]], x[e.node[3]]).distance;
  end = vertex_plane_proximity(y[e.node[0]], y[e.node[1]], y[e.node[2]], y[e.node[3]]).distance;
  r.hit = start < minimum || end < minimum;
  r.time = start > minimum && end < minimum ? (start - minimum) / (start - end) : 0.0;
  return r;
}

/* What detection knows of the motion of vertices, and of the vertices of faces and of edges, in this order: error, an
   upper bound of the largest distance between the end of a vertex and its prediction, m; state, in bytes, which remain
   in a cache. */
#define MOTION_FREE 1 /* a vertex is not fixed */
#define MOTION_CHANGED 2 /* a vertex has another motion than at the last detection */
#define MOTION_OPEN 3 /* both: pairs with such features have to be tested */

/* Of found[], which the kernels of a detection share: */
#define DETECTION_ESCAPED 0 /* vertices that leave their boxes */
#define DETECTION_IMPACTS 1
#define DETECTION_OPEN 2 /* pairs that neither their bound nor an unchanged motion decides */
#define DETECTION_UNCLEAR 3 /* of these the pairs that no direction is known to separate */
#define DETECTION_COLLECTED 4
#define DETECTION_COUNTS 5

/* changed: the vertices whose motion has changed; without `localized` all have. found[DETECTION_ESCAPED]: incremented
   for each vertex whose motion x to y comes nearer to the border of its box, or of those at its ends, than `least`, m.
   */
KERNEL find_prediction_errors(int n, GLOBAL const dvec3 *x, GLOBAL const dvec3 *y, GLOBAL const dvec3 *predicted,
                              GLOBAL const double *inverse_mass, int localized, GLOBAL const int *changed,
                              GLOBAL const box *vertex_box, GLOBAL const end_boxes *ends,
                              GLOBAL const dvec3 *scene_bounds, double least, GLOBAL float *error,
                              GLOBAL unsigned char *state, GLOBAL int *found)
{
  FOR_EACH(i, n) {
    error[i] = float_above(dnorm(dsub(y[i], predicted[i])) +
                           1e-15 * (largest_component(y[i]) + largest_component(predicted[i])));
    state[i] =
        (unsigned char)((inverse_mass[i] > 0.0 ? MOTION_FREE : 0) | (!localized || changed[i] ? MOTION_CHANGED : 0));
    if (!box_holds(vertex_box[i], swept_box(x[i], y[i], least, scene_bounds[0])) ||
        (ends && ends_differ(ends + i) && leaves_end_boxes(x[i], y[i], least, scene_bounds[0], ends + i)))
      atomic_add_int(found + DETECTION_ESCAPED, 1);
  }
}

DEVICE float larger_error(float a, float b) { return b > a ? b : a; }
/* n: faces and edges. */
KERNEL find_feature_motions(int n, int vertices, int faces, GLOBAL const face_nodes *face,
                            GLOBAL const edge_nodes *edge, GLOBAL float *error, GLOBAL unsigned char *state)
{
  FOR_EACH(i, n) {
    if (i < faces) {
      const face_nodes f = face[i];
      error[vertices + i] = larger_error(larger_error(error[f.node[0]], error[f.node[1]]), error[f.node[2]]);
      state[vertices + i] = (unsigned char)(state[f.node[0]] | state[f.node[1]] | state[f.node[2]]);
    } else {
      const edge_nodes e = edge[i - faces];
      error[vertices + i] = larger_error(error[e.node[0]], error[e.node[1]]);
      state[vertices + i] = (unsigned char)(state[e.node[0]] | state[e.node[1]]);
    }
  }
}

/* 1 if a pair keeps `least` over the motion, by its bound for the predicted motion and by how far its features end from
   there. */
DEVICE int bound_keeps(float gap_bound, float error_a, float error_b, double least)
{
  return gap_bound > 0.0f && (double)gap_bound - 1.00001 * ((double)error_a + (double)error_b) > least;
}

/* Lists the codes of candidates that continuous detection may have to decide, from *_from on in each list. `pairs` are
   looked at, `first_size` of them of vertices and faces. error, state: as above; pairs whose motion did not change were
   certified before. The gap_bound of a pair and the prediction errors of its features decide most pairs. *_bounds:
   number of pairs whose gap_bound holds from the start of this motion; below 0 it marks a known impact, which is tested
   `again` unless it was found twice. share: the share of the thickness that pairs keep; largest: the largest contact
   thickness, m. found[DETECTION_OPEN]: the length of the list. n: teams. */
KERNEL select_open_pairs(int n, int pairs, int first_size, int vertices, int faces, int again,
                         GLOBAL const pair *vertex_face, GLOBAL const pair *edge_edge, double share, double largest,
                         GLOBAL const float *error, GLOBAL const unsigned char *state, int vertex_face_from,
                         int edge_edge_from, int vertex_face_bounds, GLOBAL const float *vertex_face_gap_bound,
                         int edge_edge_bounds, GLOBAL const float *edge_edge_gap_bound, GLOBAL int *list,
                         GLOBAL int *found)
{
  TEAM_LOCAL(int, chosen, RUN_PAIRS);
  TEAM_LOCAL(int, listed, 2);
  FOR_EACH_TEAM(t, n) {
    const int first = t * RUN_PAIRS;
    begin_chosen(listed);
    TEAM_FOR(l, min_int(pairs - first, RUN_PAIRS)) {
      const int i = first + l, kind = i >= first_size,
                at = kind == 0 ? vertex_face_from + i : edge_edge_from + i - first_size;
      const pair p = kind == 0 ? vertex_face[at] : edge_edge[at];
      const int a = kind == 0 ? p.a : vertices + faces + p.a, b = kind == 0 ? vertices + p.b : vertices + faces + p.b;
      int open = (state[a] | state[b]) == MOTION_OPEN;
      if (open) {
        const float gap_bound = kind == 0 ? vertex_face_gap_bound[at] : edge_edge_gap_bound[at];
        open = !(gap_bound < (again ? -1.0f : 0.0f));
        if (open && at < (kind == 0 ? vertex_face_bounds : edge_edge_bounds))
          open = !bound_keeps(gap_bound, error[a], error[b], 1.01 * share * largest);
      }
      if (open) chosen[local_add_int(listed, 1)] = pair_code(kind, at);
    }
    append_chosen(chosen, listed, list, found + DETECTION_OPEN);
  }
}

/* Of these the codes of pairs that continuous detection has to decide: the direction known from their search does not
   separate them. found[DETECTION_UNCLEAR]: the length of the list. n: teams. */
KERNEL select_ccd_pairs(int n, GLOBAL const pair *vertex_face, GLOBAL const pair *edge_edge,
                        GLOBAL const face_nodes *face, GLOBAL const edge_nodes *edge, double share,
                        GLOBAL const dvec3 *x, GLOBAL const dvec3 *y, GLOBAL const vertex_contact *v,
                        GLOBAL const fvec3 *vertex_face_direction, GLOBAL const fvec3 *edge_edge_direction,
                        GLOBAL const int *open, GLOBAL int *list, GLOBAL int *found)
{
  TEAM_LOCAL(int, chosen, PAIR_TEAM);
  TEAM_LOCAL(int, listed, 2);
  FOR_EACH_UNEVEN_TEAM(t, n) {
    const int many = found[DETECTION_OPEN];
    for (int first = t * PAIR_TEAM; first < many; first += n * PAIR_TEAM) {
      begin_chosen(listed);
      TEAM_FOR(l, min_int(many - first, PAIR_TEAM)) {
        const int code = open[first + l], kind = code_kind(code), at = code_place(code);
        const element_nodes e = pair_nodes(kind, kind == 0 ? vertex_face[at] : edge_edge[at], face, edge);
        if (!separated_along(kind, e, x, y,
                             from_direction(kind == 0 ? vertex_face_direction[at] : edge_edge_direction[at]),
                             pair_clearance(kind, e, v, share) + 0.001 * share * pair_min_thickness(e, v)))
          chosen[local_add_int(listed, 1)] = code;
      }
      append_chosen(chosen, listed, list, found + DETECTION_UNCLEAR);
    }
  }
}

/* Continuous detection over these: those that are no impacts become NO_PAIR; found[DETECTION_IMPACTS]: the number of
   impacts. n: teams. */
KERNEL find_impacts(int n, int cubic, GLOBAL const pair *vertex_face, GLOBAL const pair *edge_edge,
                    GLOBAL const face_nodes *face, GLOBAL const edge_nodes *edge, GLOBAL const dvec3 *x,
                    GLOBAL const dvec3 *y, GLOBAL const vertex_contact *v, double share, GLOBAL int *list,
                    GLOBAL int *found)
{
  FOR_EACH_LISTED(t, k, n, found + DETECTION_UNCLEAR)
  {
    const int code = list[k_run + k], kind = code_kind(code), at = code_place(code);
    element_nodes e = pair_nodes(kind, kind == 0 ? vertex_face[at] : edge_edge[at], face, edge);
    if (surface_impact_time(kind, cubic, e, x, y, v, pair_clearance(kind, e, v, share), CCD_ITERATIONS).hit)
      atomic_add_int(found + DETECTION_IMPACTS, 1);
    else
      list[k_run + k] = NO_PAIR;
  }
}

/* The same for lists of many pairs. One iteration clears most of them; a team collects the others and decides these at
   last, as commit_many_pairs does. */
KERNEL find_many_impacts(int n, int cubic, GLOBAL const pair *vertex_face, GLOBAL const pair *edge_edge,
                         GLOBAL const face_nodes *face, GLOBAL const edge_nodes *edge, GLOBAL const dvec3 *x,
                         GLOBAL const dvec3 *y, GLOBAL const vertex_contact *v, double share, GLOBAL int *list,
                         GLOBAL int *found)
{
  TEAM_LOCAL(int, unclear, 2 * PAIR_TEAM);
  TEAM_LOCAL(int, collected, 2);
  FOR_EACH_UNEVEN_TEAM(t, n) {
    const int listed = found[DETECTION_UNCLEAR], stride = n * PAIR_TEAM, late_work = has_late_work(listed, stride);
    int run, late;
    begin_chosen(collected);
    for (run = t * PAIR_TEAM; run < listed; run += stride)
      for (late = 0; late <= late_work; ++late) {
        const int some = late ? chosen_so_far(collected) : min_int(listed - run, PAIR_TEAM);
        if (late && some < PAIR_TEAM && listed - run > stride) break;
        TEAM_FOR(k, some) {
          const int place = late ? unclear[k] : run + k, code = list[place], kind = code_kind(code),
                    at = code_place(code), most = late_work && !late ? 1 : CCD_ITERATIONS;
          const element_nodes e = pair_nodes(kind, kind == 0 ? vertex_face[at] : edge_edge[at], face, edge);
          if (!surface_impact_time(kind, cubic, e, x, y, v, pair_clearance(kind, e, v, share), most).hit)
            list[place] = NO_PAIR;
          else if (most == 1)
            unclear[local_add_int(collected, 1)] = place;
          else
            atomic_add_int(found + DETECTION_IMPACTS, 1);
        }
        if (late) begin_chosen(collected);
      }
  }
}

/* The codes of the impacts in the list, in any order, from code[first] on; found[DETECTION_COLLECTED]: their number, 0
   before. n: teams. */
KERNEL collect_impacts(int n, int first, GLOBAL const int *list, GLOBAL int *code, GLOBAL int *found)
{
  FOR_EACH_LISTED(t, k, n, found + DETECTION_UNCLEAR)
  if (list[k_run + k] != NO_PAIR) code[first + atomic_add_int(found + DETECTION_COLLECTED, 1)] = list[k_run + k];
}

/* Impacts of the pairs with codes code[0 .. n), from `first` on; their gap_bound becomes -1, a known impact, or -2, one
   that was found before. repeat: counts all as found before. repeated[0]: incremented for each of those. */
KERNEL fill_impacts(int n, int cubic, int repeat, GLOBAL const int *code, GLOBAL const pair *vertex_face,
                    GLOBAL const pair *edge_edge, GLOBAL const face_nodes *face, GLOBAL const edge_nodes *edge,
                    GLOBAL const dvec3 *x, GLOBAL const dvec3 *y, GLOBAL const vertex_contact *v, double share,
                    double target_share, int first, GLOBAL float *vertex_face_gap_bound,
                    GLOBAL float *edge_edge_gap_bound, GLOBAL impact *impacts, GLOBAL int *repeated)
{
  FOR_EACH(i, n) {
    int k, kind = code_kind(code[i]), candidate = code_place(code[i]);
    element_nodes e = pair_nodes(kind, kind == 0 ? vertex_face[candidate] : edge_edge[candidate], face, edge);
    double t = surface_impact_time(kind, cubic, e, x, y, v, pair_clearance(kind, e, v, share), CCD_ITERATIONS).time;
    dvec3 o = dlerp(x[e.node[0]], y[e.node[0]], t), at[4], motion[4];
    impact m;
    proximity p;
    for (k = 0; k < 4; ++k) {
      at[k] = dsub(dlerp(x[e.node[k]], y[e.node[k]], t), o);
      motion[k] = dsub(y[e.node[k]], x[e.node[k]]);
    }
    if (pair_has_plane(kind, e, v))
      p = vertex_plane_proximity(at[0], at[1], at[2], at[3]);
    else
      p = kind == 0 ? vertex_face_proximity(at[0], at[1], at[2], at[3])
                    : edge_edge_proximity(at[0], at[1], at[2], at[3]);
    for (k = 0; k < 4; ++k) {
      m.node[k] = e.node[k];
      m.weight[k] = p.weight[k];
    }
    m.kind = kind;
    m.candidate = candidate;
    m.repeated = repeat || (kind == 0 ? vertex_face_gap_bound[candidate] : edge_edge_gap_bound[candidate]) < 0.0f;
    if (m.repeated) atomic_add_int(repeated, 1);
    m.normal = takes_cubic(kind, cubic, e, v) ? touching_normal(kind, at, motion, p) : p.normal;
    m.target = pair_clearance(kind, e, v, target_share);
    if (kind == 0)
      vertex_face_gap_bound[candidate] = m.repeated ? -2.0f : -1.0f;
    else
      edge_edge_gap_bound[candidate] = m.repeated ? -2.0f : -1.0f;
    impacts[first + i] = m;
  }
}

/* Resets the gap_bound of known impacts. */
KERNEL forget_impacts(int n, GLOBAL float *gap_bound)
{
  FOR_EACH(i, n) {
    if (gap_bound[i] < 0.0f) gap_bound[i] = 0.0f;
  }
}

#endif
