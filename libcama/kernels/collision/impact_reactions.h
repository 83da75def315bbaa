/* SPDX-License-Identifier: Apache-2.0 */
/* Impulses of penetration handling on what is prescribed. Impacts push both sides alike; what else changes the momentum
   of a vertex, above all the certified commit, acts on the obstacle that is nearest to it. */
#ifndef CAMA_KERNELS_COLLISION_IMPACT_REACTIONS_H
#define CAMA_KERNELS_COLLISION_IMPACT_REACTIONS_H
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"
#include "../system/incidence.h"
#include "impact.h"
#include "pair.h"

/* linear[i] = keep linear[i] + the push of all impacts at vertex i, kg m, and its moment about the origin, angular[i].
   n: all vertices; x: their positions. row, incidence: of impacts at all vertices. */
KERNEL impact_reactions(int n, double keep, GLOBAL const int *row, GLOBAL const int *incidence,
                        GLOBAL const impact *impacts, GLOBAL const impulse *impulses, GLOBAL const dvec3 *x,
                        GLOBAL const vertex_contact *properties, GLOBAL dvec3 *linear, GLOBAL dvec3 *angular)
{
  FOR_EACH(i, n) {
    dvec3 sum = dscale(keep, linear[i]), moment = dscale(keep, angular[i]);
    int k;
    for (k = row[i]; k < row[i + 1]; ++k) {
      int e = incidence[k] >> 2;
      double weight = impacts[e].weight[incidence[k] & 3];
      dvec3 own = dscale(weight * impulses[e].lambda, impacts[e].normal),
            surface = daxpy(x[i], (weight < 0.0 ? 1.0 : -1.0) * properties[i].radius, impacts[e].normal);
      sum = dadd(sum, own);
      moment = dadd(moment, dcross(surface, own));
    }
    linear[i] = sum;
    angular[i] = moment;
  }
}

/* Adds pushes, kg m, to the impulses of prescribed vertices. */
KERNEL add_pushes(int n, double time_step, GLOBAL const int *fixed, GLOBAL const dvec3 *push,
                  GLOBAL const dvec3 *push_moment, GLOBAL dvec3 *linear, GLOBAL dvec3 *angular)
{
  FOR_EACH(i, n) {
    if (!fixed[i]) continue;
    linear[i] = daxpy(linear[i], 1.0 / time_step, push[i]);
    angular[i] = daxpy(angular[i], 1.0 / time_step, push_moment[i]);
  }
}

#define REMAINDER 1e-12 /* of the momentum that changed: less is rounding */

/* remainder[i]: momentum that cloth vertex i won after the solve other than by impacts, N s. nearest, surface: reset
   for the kernels below. */
KERNEL momentum_remainders(int n, double time_step, GLOBAL const int *fixed, GLOBAL const double *inverse_mass,
                           GLOBAL const dvec3 *solved, GLOBAL const dvec3 *velocity, GLOBAL const dvec3 *push,
                           GLOBAL dvec3 *remainder, GLOBAL int *nearest, GLOBAL int *surface)
{
  FOR_EACH(i, n) {
    dvec3 rest = dvec3_make(0.0, 0.0, 0.0);
    if (!fixed[i]) {
      dvec3 won = dscale(1.0 / inverse_mass[i], dsub(velocity[i], solved[i])), by = dscale(1.0 / time_step, push[i]);
      dvec3 left = dsub(won, by);
      if (dnorm(left) > REMAINDER * (dnorm(won) + dnorm(by))) rest = left;
    }
    remainder[i] = rest;
    nearest[i] = 0x7f7fffff; /* the largest float */
    surface[i] = 0x7fffffff;
  }
}

/* Bits of the distance of a pair as a float, m; distances are not negative. */
DEVICE int distance_bits(int kind, element_nodes e, GLOBAL const dvec3 *position, GLOBAL const vertex_contact *v)
{
  return float_bits((float)max_double(surface_proximity(kind, e, position, v).distance, 0.0));
}

/* 1 if a vertex of the pair has a remainder. */
DEVICE int takes_remainder(element_nodes e, int rows, GLOBAL const dvec3 *remainder)
{
  int k, takes = 0;
  for (k = 0; k < 4; ++k) takes |= e.node[k] < rows && ddot(remainder[e.node[k]], remainder[e.node[k]]) > 0.0;
  return takes;
}

/* nearest[v]: bits of the distance (float, m) to the nearest partner of cloth vertex v, where v has a remainder. */
KERNEL nearest_partners(int n, int kind, int rows, GLOBAL const pair *pairs, GLOBAL const face_nodes *face,
                        GLOBAL const edge_nodes *edge, GLOBAL const dvec3 *position, GLOBAL const vertex_contact *v,
                        GLOBAL const dvec3 *remainder, GLOBAL int *nearest)
{
  FOR_EACH_UNEVEN(i, n) {
    element_nodes e = pair_nodes(kind, pairs[i], face, edge);
    int k, bits;
    if (!takes_remainder(e, rows, remainder)) continue;
    bits = distance_bits(kind, e, position, v);
    for (k = 0; k < 4; ++k)
      if (e.node[k] < rows) atomic_min_int(nearest + e.node[k], bits);
  }
}

/* surface[v]: the lowest obstacle vertex of the nearest partners of v; it keeps its reset value if these are cloth. */
KERNEL nearest_surfaces(int n, int kind, int rows, GLOBAL const pair *pairs, GLOBAL const face_nodes *face,
                        GLOBAL const edge_nodes *edge, GLOBAL const dvec3 *position, GLOBAL const vertex_contact *v,
                        GLOBAL const dvec3 *remainder, GLOBAL const int *nearest, GLOBAL int *surface)
{
  FOR_EACH_UNEVEN(i, n) {
    element_nodes e = pair_nodes(kind, pairs[i], face, edge);
    int k, bits, obstacle = 0x7fffffff;
    for (k = 0; k < 4; ++k)
      if (e.node[k] >= rows) obstacle = min_int(obstacle, e.node[k]);
    if (obstacle == 0x7fffffff || !takes_remainder(e, rows, remainder)) continue;
    bits = distance_bits(kind, e, position, v);
    for (k = 0; k < 4; ++k)
      if (e.node[k] < rows && nearest[e.node[k]] == bits) atomic_min_int(surface + e.node[k], obstacle);
  }
}

/* Where the remainder of each cloth vertex goes: to an obstacle, or to the vertex itself. */
KERNEL remainder_nodes(int n, int vertices, GLOBAL const int *surface, GLOBAL element_nodes *nodes)
{
  FOR_EACH(i, n) {
    nodes[i].node[0] = surface[i] < vertices ? surface[i] : i;
    nodes[i].node[1] = nodes[i].node[2] = nodes[i].node[3] = -1;
  }
}

/* Gives what takes a remainder the opposite impulse, where the cloth vertex is. */
KERNEL add_remainders(int n, GLOBAL const int *row, GLOBAL const int *incidence, GLOBAL const dvec3 *remainder,
                      GLOBAL const dvec3 *position, GLOBAL dvec3 *linear, GLOBAL dvec3 *angular)
{
  FOR_EACH(i, n) {
    dvec3 sum = linear[i], moment = angular[i];
    int k;
    for (k = row[i]; k < row[i + 1]; ++k) {
      int v = incidence[k] >> 2;
      sum = dsub(sum, remainder[v]);
      moment = dsub(moment, dcross(position[v], remainder[v]));
    }
    linear[i] = sum;
    angular[i] = moment;
  }
}

#define FORGOTTEN 1e-9 /* of the change of velocity: less is rounding */

/* What BDF2 will not carry on of the change of velocity of a blow (keep_history), which is missing in the momentum of
   the next step: the vertex itself receives it. previous, solved, velocity: at the start of the step, after the solve,
   at the end; before: what was kept. share: h / dt. */
KERNEL add_forgotten(int n, double share, GLOBAL const int *fixed, GLOBAL const double *inverse_mass,
                     GLOBAL const dvec3 *position, GLOBAL const dvec3 *previous, GLOBAL const dvec3 *solved,
                     GLOBAL const dvec3 *velocity, GLOBAL const dvec3 *before, GLOBAL const dvec3 *abrupt,
                     GLOBAL dvec3 *linear, GLOBAL dvec3 *angular)
{
  FOR_EACH(i, n) {
    dvec3 whole = dsub(daxpy(solved[i], -share, abrupt[i]), previous[i]);
    dvec3 lost = dsub(whole, dsub(velocity[i], before[i]));
    if (fixed[i] || dnorm(lost) <= FORGOTTEN * (dnorm(whole) + dnorm(velocity[i]))) continue;
    lost = dscale(1.0 / inverse_mass[i], lost);
    linear[i] = dadd(linear[i], lost);
    angular[i] = dadd(angular[i], dcross(position[i], lost));
  }
}

/* total += share impulse. */
KERNEL add_impulses(int n, double share, GLOBAL const dvec3 *impulse, GLOBAL dvec3 *total)
{
  FOR_EACH(i, n) {
    total[i] = daxpy(total[i], share, impulse[i]);
  }
}

/* wrench[first + 2 i], wrench[first + 2 i + 1]: sums of the impulses, N s, and of their moments, N m s, over the
   vertices member[row[i]] to member[row[i + 1] - 1] that are prescribed. */
KERNEL sum_wrenches(int n, int first, GLOBAL const int *row, GLOBAL const int *member, GLOBAL const int *fixed,
                    GLOBAL const dvec3 *linear, GLOBAL const dvec3 *angular, GLOBAL dvec3 *wrench)
{
  FOR_EACH(i, n) {
    dvec3 sum = dvec3_make(0.0, 0.0, 0.0), moment = sum;
    int k;
    for (k = row[i]; k < row[i + 1]; ++k)
      if (fixed[member[k]]) {
        sum = dadd(sum, linear[member[k]]);
        moment = dadd(moment, angular[member[k]]);
      }
    wrench[first + 2 * i] = sum;
    wrench[first + 2 * i + 1] = moment;
  }
}

#endif
