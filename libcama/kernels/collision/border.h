/* SPDX-License-Identifier: Apache-2.0 */
/* Contacts whose closest point lies on the border of a face: of the faces that share it, one makes the contact. */
#ifndef CAMA_KERNELS_COLLISION_BORDER_H
#define CAMA_KERNELS_COLLISION_BORDER_H
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"
#include "../system/incidence.h"
#include "bounds.h"
#include "distance.h"

/* across[k]: the vertex of the face beyond the edge opposite corner k, -1 where there is none. owned: with bit k, this
   face and no other makes the contacts of that edge; with bit 3 + k, those of corner k; with bit 6 + k, corner k lies
   on the rim of the surface. */
typedef struct {
  int across[3];
  int owned;
} face_border;

/* Faces at corner or edge k of a face. */
#define OWNS_EDGE(border, k) (((border).owned >> (k)) & 1)
#define OWNS_CORNER(border, k) (((border).owned >> (3 + (k))) & 1)
#define RIM_CORNER(border, k) (((border).owned >> (6 + (k))) & 1)

/* A closest point whose weights are below NEAR_BORDER may be on either side of a border by rounding; all faces there
   then decide by the same numbers. A sine below RISES is zero. */
#define NEAR_BORDER 1e-6
#define RISES 1e-10
/* A normal that leans by a larger sine off all faces at a border is one around a sharp ridge or tip; held through a
   step it would throw what slides around it, and impacts act there. */
#define LEANS_OFF 0.05

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

/* The same towards vertex v, equal in bits for (a, b) and (b, a). */
DEVICE double rise_towards(int v, int a, int b, int w, GLOBAL const dvec3 *position)
{
  int first = a < b ? a : b, second = a < b ? b : a;
  dvec3 u = dsub(position[second], position[first]);
  if (!(ddot(u, u) > 0.0)) return 0.0;
  return rise_along(first, second, w, dnormalize(segment_rejection(dsub(position[v], position[first]), u)), position);
}

/* Cosine of the angle at corner w between vertex v and vertex k. */
DEVICE double corner_cosine(int v, int w, int k, GLOBAL const dvec3 *position)
{
  dvec3 p = dsub(position[v], position[w]), u = dsub(position[k], position[w]);
  double size = ddot(p, p) * ddot(u, u);
  return size > 0.0 ? ddot(p, u) / sqrt(size) : 0.0;
}

/* 1 if corner w is the closest point of the surface around it to vertex v, which a neighbour of w is not, with two
   edges across which the normal does not lean. On a rim v stands straight above it (flat). */
DEVICE int closest_corner(int v, int w, int flat, GLOBAL const int *neighbour_row, GLOBAL const int *neighbour,
                          GLOBAL const dvec3 *position)
{
  int i, across = 0;
  for (i = neighbour_row[w]; i < neighbour_row[w + 1]; ++i) {
    double along = corner_cosine(v, w, neighbour[i], position);
    if (along > RISES || (flat && along < -RISES)) return 0;
    across += along > -LEANS_OFF;
  }
  return across > 1;
}

/* 1 if the face of e makes the contact of vertex e.node[0] whose closest point has the weights of p. Inside the face it
   does. On an edge or a corner it does if no face there has a nearer point and this one owns the contacts there; two
   corners have one contact, that of the first. A rim has contacts only straight above it: their normals would lean
   outward, and be a ledge for what slides across. */
DEVICE int makes_contact(element_nodes e, proximity p, face_border border, GLOBAL const int *neighbour_row,
                         GLOBAL const int *neighbour, GLOBAL const dvec3 *position)
{
  const int v = e.node[0];
  double own = 2.0, other;
  int k, w, near = 0, corner = 0, side = 0;
  for (k = 0; k < 3; ++k) {
    if (-p.weight[k + 1] < NEAR_BORDER)
      ++near;
    else
      corner = k;
  }
  if (near == 0) return 1;
  w = e.node[1 + corner];
  if (near == 2 && !(corner_cosine(v, w, e.node[1 + (corner + 1) % 3], position) > RISES) &&
      !(corner_cosine(v, w, e.node[1 + (corner + 2) % 3], position) > RISES))
    return OWNS_CORNER(border, corner) &&
           closest_corner(v, w, RIM_CORNER(border, corner), neighbour_row, neighbour, position) &&
           (v < w || neighbour_row[v] == neighbour_row[v + 1] ||
            !closest_corner(w, v, 0, neighbour_row, neighbour, position));
  for (k = 0; k < 3; ++k)
    if (-p.weight[k + 1] < NEAR_BORDER) {
      double rise = rise_towards(v, e.node[1 + (k + 1) % 3], e.node[1 + (k + 2) % 3], e.node[1 + k], position);
      if (rise < own) {
        own = rise;
        side = k;
      }
    }
  if (own > RISES) return 1;
  if (border.across[side] < 0) return own > -RISES;
  if (!OWNS_EDGE(border, side)) return 0;
  other = rise_towards(v, e.node[1 + (side + 1) % 3], e.node[1 + (side + 2) % 3], border.across[side], position);
  return !(other > RISES) && max_double(own, other) > -LEANS_OFF;
}

#endif
