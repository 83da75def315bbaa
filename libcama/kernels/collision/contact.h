/* SPDX-License-Identifier: Apache-2.0 */
/* Contacts of candidate pairs (paper, sections 3.3 and 4.1), their springs, and contacts hidden behind others. */
#ifndef CAMA_KERNELS_COLLISION_CONTACT_H
#define CAMA_KERNELS_COLLISION_CONTACT_H
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"
#include "../system/incidence.h"
#include "bounds.h"
#include "distance.h"
#include "pair.h"
#include "query.h"
#include "swept_vertex.h"

/* Pair i of the two candidate lists one behind the other, vertex-face first. */
DEVICE pair listed_pair(int i, int first_size, GLOBAL const pair *vertex_face, GLOBAL const pair *edge_edge)
{
  return i < first_size ? vertex_face[i] : edge_edge[i - first_size];
}

/* Lists the pairs that no bound decides: those whose gap_bound is 0. n: teams. */
KERNEL list_near_pairs(int n, int pairs, int first_size, GLOBAL const float *vertex_face_gap_bound,
                       GLOBAL const float *edge_edge_gap_bound, GLOBAL int *list, GLOBAL int *found)
{
  TEAM_LOCAL(int, chosen, RUN_PAIRS);
  TEAM_LOCAL(int, listed, 2);
  FOR_EACH_TEAM(t, n) {
    const int first = t * RUN_PAIRS;
    begin_chosen(listed);
    TEAM_FOR(l, min_int(pairs - first, RUN_PAIRS)) {
      const int i = first + l;
      if (!((i < first_size ? vertex_face_gap_bound[i] : edge_edge_gap_bound[i - first_size]) > 0.0f))
        chosen[local_add_int(listed, 1)] = i;
    }
    append_chosen(chosen, listed, list, found + NEAR_PAIRS);
  }
}

/* The bound along the direction between the closest points, m; 0: none. */
DEVICE float gap_bound_of(int kind, element_nodes e, proximity p, GLOBAL const swept_vertex *swept_vertices,
                          GLOBAL const float *rounding_margin)
{
  const fvec3 normal =
      fvec3_make(0.999999f * (float)p.normal.x, 0.999999f * (float)p.normal.y, 0.999999f * (float)p.normal.z);
  return gap_bound_along(kind, swept_vertices[e.node[0]], swept_vertices[e.node[1]], swept_vertices[e.node[2]],
                         swept_vertices[e.node[3]], normal, rounding_margin[0]);
}

/* The listed pairs, which have no bound yet: the direction between their closest points, and the bound along it. n:
   teams. */
KERNEL bound_near_pairs(int n, int first_size, GLOBAL const int *list, GLOBAL const int *found,
                        GLOBAL const pair *vertex_face, GLOBAL const pair *edge_edge, GLOBAL const face_nodes *face,
                        GLOBAL const edge_nodes *edge, GLOBAL const dvec3 *position,
                        GLOBAL const swept_vertex *swept_vertices, GLOBAL const float *rounding_margin,
                        GLOBAL const vertex_contact *v, GLOBAL fvec3 *vertex_face_direction,
                        GLOBAL float *vertex_face_gap_bound, GLOBAL fvec3 *edge_edge_direction,
                        GLOBAL float *edge_edge_gap_bound)
{
  FOR_EACH_LISTED(t, k, n, found + NEAR_PAIRS)
  {
    const int i = list[k_run + k], kind = i >= first_size, at = kind == 0 ? i : i - first_size;
    const element_nodes e = pair_nodes(kind, listed_pair(i, first_size, vertex_face, edge_edge), face, edge);
    const proximity p = surface_proximity(kind, e, position, v);
    const float gap_bound = gap_bound_of(kind, e, p, swept_vertices, rounding_margin);
    if (kind == 0) {
      vertex_face_direction[at] = to_direction(p.normal);
      vertex_face_gap_bound[at] = gap_bound;
    } else {
      edge_edge_direction[at] = to_direction(p.normal);
      edge_edge_gap_bound[at] = gap_bound;
    }
  }
}

/* In the list of candidates those that are contacts become their codes, the others NO_PAIR. direction: one that
   separates its sides, from side B to side A; gap_bound: lower bound of their distance along it until the prediction,
   m, 0 where it is not known to exceed the thickness. cull_separated_pairs has both for the pairs that are not listed.
   n: teams. */
KERNEL find_contacts(int n, int first_size, GLOBAL const int *found, GLOBAL const pair *vertex_face,
                     GLOBAL const pair *edge_edge, GLOBAL const face_nodes *face, GLOBAL const edge_nodes *edge,
                     GLOBAL const edge_nodes *wing, GLOBAL const dvec3 *position, GLOBAL const dvec3 *predicted,
                     GLOBAL const swept_vertex *swept_vertices, GLOBAL const float *rounding_margin,
                     GLOBAL const vertex_contact *v, double anticipate, GLOBAL fvec3 *vertex_face_direction,
                     GLOBAL float *vertex_face_gap_bound, GLOBAL fvec3 *edge_edge_direction,
                     GLOBAL float *edge_edge_gap_bound, GLOBAL int *list)
{
  FOR_EACH_LISTED(t, k, n, found + NEAR_PAIRS)
  {
    contact c;
    const int i = list[k_run + k], kind = i >= first_size, at = kind == 0 ? i : i - first_size;
    pair q = listed_pair(i, first_size, vertex_face, edge_edge);
    element_nodes e = pair_nodes(kind, q, face, edge);
    proximity p = surface_proximity(kind, e, position, v);
    const int hit = make_contact(kind, q, e, wing, position, predicted, v, anticipate, p, &c);
    if (kind == 0)
      vertex_face_direction[at] = to_direction(p.normal);
    else
      edge_edge_direction[at] = to_direction(p.normal);
    list[k_run + k] = hit ? pair_code(kind, at) : NO_PAIR;
    if (!hit) {
      float gap_bound = gap_bound_of(kind, e, p, swept_vertices, rounding_margin);
      if (gap_bound > 0.0f) {
        if (kind == 0)
          vertex_face_gap_bound[at] = gap_bound;
        else
          edge_edge_gap_bound[at] = gap_bound;
      }
    }
  }
}

/* The codes of the contacts in the list, in any order. n: teams. */
KERNEL collect_contacts(int n, GLOBAL const int *list, GLOBAL int *code, GLOBAL int *found)
{
  TEAM_LOCAL(int, chosen, PAIR_TEAM);
  TEAM_LOCAL(int, listed, 2);
  FOR_EACH_UNEVEN_TEAM(t, n) {
    const int many = found[NEAR_PAIRS];
    for (int first = t * PAIR_TEAM; first < many; first += n * PAIR_TEAM) {
      begin_chosen(listed);
      TEAM_FOR(l, min_int(many - first, PAIR_TEAM))
        if (list[first + l] != NO_PAIR) chosen[local_add_int(listed, 1)] = list[first + l];
      append_chosen(chosen, listed, code, found + NEAR_CONTACTS);
    }
  }
}

#define SIDES 6            /* +x, -x, +y, -y, +z, -z */
/* A direction points to every side along which its component is larger than this, to one at least. */
#define SIDE_COMPONENT 0.45

DEVICE double side_component(dvec3 n, int side)
{
  return (side & 1) ? -dcomponent(n, side >> 1) : dcomponent(n, side >> 1);
}

/* nearest[SIDES v + side]: bits of the smallest distance (float, m) at which cloth vertex v has a contact on that side;
   code: of the contacts. n: teams. */
KERNEL nearest_contacts(int n, GLOBAL const int *code, GLOBAL const int *found, GLOBAL const pair *vertex_face,
                        GLOBAL const pair *edge_edge, GLOBAL const face_nodes *face, GLOBAL const edge_nodes *edge,
                        GLOBAL const dvec3 *position, GLOBAL const vertex_contact *v, int cloth_vertex_count,
                        GLOBAL int *nearest)
{
  FOR_EACH_LISTED(t, place, n, found + NEAR_CONTACTS)
  {
    const int i = code[place_run + place], kind = code_kind(i), at = code_place(i);
    const element_nodes e = pair_nodes(kind, kind == 0 ? vertex_face[at] : edge_edge[at], face, edge);
    const proximity p = surface_proximity(kind, e, position, v);
    for (int k = 0; k < 4; ++k) {
      const dvec3 towards = k <= kind ? dscale(-1.0, p.normal) : p.normal;
      if (e.node[k] >= cloth_vertex_count) continue;
      for (int side = 0; side < SIDES; ++side)
        if (side_component(towards, side) > SIDE_COMPONENT)
          atomic_min_int(nearest + SIDES * e.node[k] + side, float_bits((float)p.distance));
    }
  }
}

/* Lists the contacts without the anticipated ones through other cloth: one of their vertices has a contact on the same
   side that is nearer by more than the thickness. The term of such a pair would pull its sides together through the
   cloth between them. n: teams. */
KERNEL drop_hidden_contacts(int n, GLOBAL const int *code, GLOBAL const pair *vertex_face, GLOBAL const pair *edge_edge,
                            GLOBAL const face_nodes *face, GLOBAL const edge_nodes *edge, GLOBAL const dvec3 *position,
                            GLOBAL const vertex_contact *v, int cloth_vertex_count, GLOBAL const int *nearest,
                            GLOBAL int *kept, GLOBAL int *found)
{
  FOR_EACH_LISTED(t, place, n, found + NEAR_CONTACTS)
  {
    const int i = code[place_run + place], kind = code_kind(i), at = code_place(i);
    const element_nodes e = pair_nodes(kind, kind == 0 ? vertex_face[at] : edge_edge[at], face, edge);
    const proximity p = surface_proximity(kind, e, position, v);
    const double thickness = pair_thickness(kind, e, v);
    int hidden = 0;
    for (int k = 0; k < 4 && p.distance > thickness; ++k) {
      const dvec3 towards = k <= kind ? dscale(-1.0, p.normal) : p.normal;
      if (e.node[k] >= cloth_vertex_count) continue;
      for (int side = 0; side < SIDES; ++side)
        if (side_component(towards, side) > SIDE_COMPONENT)
          hidden |= p.distance > (double)bits_float(nearest[SIDES * e.node[k] + side]) + thickness;
    }
    if (!hidden) kept[atomic_add_int(found + NEAR_KEPT, 1)] = i;
  }
}

/* The directions alone, from pair `first` on, for pairs whose contacts and bounds are not needed. */
KERNEL find_directions(int n, int kind, int first, GLOBAL const pair *pairs, GLOBAL const face_nodes *face,
                       GLOBAL const edge_nodes *edge, GLOBAL const dvec3 *position, GLOBAL const vertex_contact *v,
                       GLOBAL fvec3 *direction)
{
  FOR_EACH(i, n) {
    direction[first + i] =
        to_direction(surface_proximity(kind, pair_nodes(kind, pairs[first + i], face, edge), position, v).normal);
  }
}

/* A key made of the features of a pair, so that lists made from pairs have one order, vertex-face pairs first, whatever
   the order of the search. */
DEVICE key64 pair_key(int kind, pair p, int bits_a, int bits_b)
{
  return ((key64)kind << (bits_a + bits_b)) | ((key64)p.a << bits_b) | (key64)p.b;
}

/* The pairs with codes code[i], with their keys. */
KERNEL coded_pairs(int n, int bits_a, int bits_b, GLOBAL const pair *vertex_face, GLOBAL const pair *edge_edge,
                   GLOBAL const int *code, GLOBAL key64 *key, GLOBAL int *index)
{
  FOR_EACH(i, n) {
    const int kind = code_kind(code[i]), at = code_place(code[i]);
    key[i] = pair_key(kind, kind == 0 ? vertex_face[at] : edge_edge[at], bits_a, bits_b);
    index[i] = code[i];
  }
}

/* Keys with 31 bits for each feature, which steps keep, from others. */
KERNEL widen_keys(int n, int bits_a, int bits_b, GLOBAL const key64 *key, GLOBAL key64 *wide)
{
  FOR_EACH(i, n) {
    pair p;
    p.a = (int)((key[i] >> bits_b) & (((key64)1 << bits_a) - 1));
    p.b = (int)(key[i] & (((key64)1 << bits_b) - 1));
    wide[i] = pair_key((int)(key[i] >> (bits_a + bits_b)), p, 31, 31);
  }
}

/* Contacts of the pairs with codes code[0 .. n). */
KERNEL fill_contacts(int n, GLOBAL const int *code, GLOBAL const pair *vertex_face, GLOBAL const pair *edge_edge,
                     GLOBAL const face_nodes *face, GLOBAL const edge_nodes *edge, GLOBAL const edge_nodes *wing,
                     GLOBAL const dvec3 *position, GLOBAL const dvec3 *predicted, GLOBAL const vertex_contact *v,
                     double anticipate, GLOBAL contact *contacts)
{
  FOR_EACH(i, n) {
    contact c;
    int k, kind = code_kind(code[i]);
    pair q = kind == 0 ? vertex_face[code_place(code[i])] : edge_edge[code_place(code[i])];
    element_nodes e = pair_nodes(kind, q, face, edge);
    c.kind = kind;
    c.candidate = code_place(code[i]);
    c.normal = dvec3_make(0.0, 0.0, 1.0);
    c.distance = c.thickness = c.stiffness = c.friction = c.static_friction = 0.0;
    for (k = 0; k < 4; ++k) {
      c.node[k] = e.node[k];
      c.weight[k] = 0.0;
    }
    make_contact(kind, q, e, wing, position, predicted, v, anticipate, surface_proximity(kind, e, position, v), &c);
    contacts[i] = c;
  }
}

/* Number of nodes on side A: 1 for vertex-face, 2 for edge-edge. */
KERNEL contact_splits(int n, GLOBAL const contact *contacts, GLOBAL int *split)
{
  FOR_EACH(i, n) {
    split[i] = contacts[i].kind + 1;
  }
}

KERNEL contact_nodes(int n, GLOBAL const contact *contacts, GLOBAL element_nodes *nodes)
{
  FOR_EACH(i, n) {
    int a;
    for (a = 0; a < 4; ++a) nodes[i].node[a] = contacts[i].node[a];
  }
}

/* Nodes of stitches, from element `first` on. */
KERNEL stitch_nodes(int n, GLOBAL const stitch *stitches, int first, GLOBAL element_nodes *nodes)
{
  FOR_EACH(i, n) {
    int a;
    for (a = 0; a < 3; ++a) nodes[first + i].node[a] = stitches[i].node[a];
    nodes[first + i].node[3] = -1;
  }
}

/* Penalty force, N; pairs that are only anticipated do not push yet. */
DEVICE double contact_load(contact c) { return c.stiffness * max_double(c.thickness - c.distance, 0.0); }

/* Normal load of each cloth vertex from its contacts, N. incidence: 4 * term + local index; terms from `contact_count`
   on are stitches. */
KERNEL vertex_loads(int n, int contact_count, GLOBAL const int *row, GLOBAL const int *incidence,
                    GLOBAL const contact *contacts, GLOBAL double *load)
{
  FOR_EACH(i, n) {
    const int end = row[i + 1];
    double sum = 0.0;
    int k;
    for (k = row[i]; k < end; k += AT_ONCE(8)) {
      int at[AT_ONCE(8)];
      double own[AT_ONCE(8)];
      FOR_AT_ONCE(q, 8, end - k) at[q] = incidence[k + q];
      FOR_AT_ONCE(q, 8, end - k)
        if ((at[q] >> 2) < contact_count)
          own[q] = fabs(contacts[at[q] >> 2].weight[at[q] & 3]) * contact_load(contacts[at[q] >> 2]);
      FOR_AT_ONCE(q, 8, end - k)
        if ((at[q] >> 2) < contact_count) sum += own[q];
    }
    load[i] = sum;
  }
}

/* Sum of the penalty forces on each cloth vertex from its contacts, N; arguments as of vertex_loads. */
KERNEL vertex_pushes(int n, int contact_count, GLOBAL const int *row, GLOBAL const int *incidence,
                     GLOBAL const contact *contacts, GLOBAL dvec3 *push)
{
  FOR_EACH(i, n) {
    const int end = row[i + 1];
    dvec3 sum = dvec3_make(0.0, 0.0, 0.0);
    int k;
    for (k = row[i]; k < end; k += AT_ONCE(8)) {
      int at[AT_ONCE(8)];
      double own[AT_ONCE(8)];
      dvec3 normal[AT_ONCE(8)];
      FOR_AT_ONCE(q, 8, end - k) at[q] = incidence[k + q];
      FOR_AT_ONCE(q, 8, end - k)
        if ((at[q] >> 2) < contact_count) {
          own[q] = contacts[at[q] >> 2].weight[at[q] & 3] * contact_load(contacts[at[q] >> 2]);
          normal[q] = contacts[at[q] >> 2].normal;
        }
      FOR_AT_ONCE(q, 8, end - k)
        if ((at[q] >> 2) < contact_count) sum = daxpy(sum, own[q], normal[q]);
    }
    push[i] = sum;
  }
}

#endif
