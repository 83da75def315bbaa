/* SPDX-License-Identifier: Apache-2.0 */
/* Diagnostics, run on demand only. */
#ifndef CAMA_KERNELS_ELEMENTS_MEASURE_H
#define CAMA_KERNELS_ELEMENTS_MEASURE_H
#include "../collision/bounds.h"
#include "../collision/pair.h"
#include "../collision/query.h"
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"

/* Kinetic and gravitational energy of each cloth vertex, J. */
KERNEL measure_vertices(int n, GLOBAL const double *mass, GLOBAL const dvec3 *position, GLOBAL const dvec3 *velocity,
                        GLOBAL const dvec3 *gravity, GLOBAL double *kinetic, GLOBAL double *potential)
{
  FOR_EACH(i, n) {
    kinetic[i] = 0.5 * mass[i] * ddot(velocity[i], velocity[i]);
    potential[i] = -mass[i] * ddot(gravity[0], position[i]);
  }
}

/* Distance of each candidate pair, m. */
KERNEL measure_pairs(int n, int kind, GLOBAL const pair *pairs, GLOBAL const face_nodes *face,
                     GLOBAL const edge_nodes *edge, GLOBAL const dvec3 *position, GLOBAL const vertex_contact *v,
                     GLOBAL double *distance)
{
  FOR_EACH(i, n) {
    distance[i] = surface_proximity(kind, pair_nodes(kind, pairs[i], face, edge), position, v).distance;
  }
}

#endif
