/* SPDX-License-Identifier: Apache-2.0 */
/* Impulses of the solve on what is prescribed: obstacles, pins and attachments. A solve ends with the momentum equation
   of every free vertex satisfied; the same equation of a prescribed vertex leaves what holds it. */
#ifndef CAMA_KERNELS_SYSTEM_REACTIONS_H
#define CAMA_KERNELS_SYSTEM_REACTIONS_H
#include "../collision/pair.h"
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"
#include "../dialect/vec3.h"
#include "linear_system.h"
#include "term.h"

/* The impulse of a term on its node a, N s: with the forces where they were linearised, and the matrix times `change`,
   by which the solve moved the velocities from there. contact: 1, or 0 for a stitch. newton: the forces are those of
   the solution itself. in_matrix: leaves out what the matrix of the elements has. hold: of its friction. */
DEVICE vec3 term_impulse(term t, vec3 hold, int contact, int form, int newton, int in_matrix, int a,
                         GLOBAL const dvec3 *velocity, GLOBAL const vec3 *change)
{
  vec3 sum = axpy(scale(t.weight[a] * t.push, t.normal), t.weight[a], hold),
       before = vec3_make((real)0, (real)0, (real)0), by = before;
  int b;
  for (b = 0; b < 4; ++b)
    if (t.node[b] >= 0) {
      real c = term_coupling(t, form, a, b);
      vec3 v = to_vec3(velocity[t.node[b]]);
      if (!newton) by = axpy(by, c, change[t.node[b]]);
      before = axpy(before, c, newton ? v : sub(v, change[t.node[b]]));
    }
  if (!newton && !in_matrix) sum = axpy(axpy(sum, -t.along * dot(t.normal, by), t.normal), -t.around, by);
  return contact ? axpy(sum, -t.around, axpy(before, -dot(t.normal, before), t.normal)) : sum;
}

/* linear[i]: impulse of the cloth on vertex i, N s, angular[i]: its moment about the origin, N m s; zero for free
   vertices. n: all vertices. row, incidence: of terms at all vertices, the first `contacts` of which are contacts.
   newton: the forces are those of the solution; in_matrix: the matrix has the terms of cloth vertices. position: at the
   start of the step, where contacts were found. properties: none without contact. */
KERNEL solve_reactions(int n, int rows, int contacts, int newton, int in_matrix, int form, real time_step,
                       GLOBAL const int *row, GLOBAL const int *incidence, GLOBAL const term *terms,
                       GLOBAL const vec3 *hold, GLOBAL const int *matrix_row, GLOBAL const int *matrix_column,
                       GLOBAL const mat3 *block, GLOBAL const real *mass, GLOBAL const vec3 *force,
                       GLOBAL const int *fixed, GLOBAL const dvec3 *base_velocity, GLOBAL const dvec3 *velocity,
                       GLOBAL const vec3 *change, GLOBAL const dvec3 *position, GLOBAL const vertex_contact *properties,
                       GLOBAL dvec3 *linear, GLOBAL dvec3 *angular)
{
  FOR_EACH(i, n) {
    dvec3 sum = dvec3_make(0.0, 0.0, 0.0), moment = sum;
    int k;
    if (fixed[i]) {
      for (k = row[i]; k < row[i + 1]; ++k) {
        term t = terms[incidence[k] >> 2];
        int a = incidence[k] & 3, contact = (incidence[k] >> 2) < contacts;
        /* towards the other side, by the radius of an exact obstacle */
        double reach = properties && i >= rows ? (t.weight[a] < (real)0 ? 1.0 : -1.0) * properties[i].radius : 0.0;
        vec3 held = hold ? hold[incidence[k] >> 2] : vec3_make((real)0, (real)0, (real)0);
        dvec3 own = to_dvec3(term_impulse(t, held, contact, form, newton, in_matrix && i < rows, a, velocity, change));
        sum = dadd(sum, own);
        moment = dadd(moment, dcross(daxpy(position[i], reach, to_dvec3(t.normal)), own));
      }
      if (i < rows) {
        dvec3 own =
            daxpy(dscale((double)time_step, to_dvec3(force[i])), -(double)mass[i], dsub(velocity[i], base_velocity[i]));
        if (!newton)
          for (k = matrix_row[i]; k < matrix_row[i + 1]; ++k)
            own = dsub(own, to_dvec3(mat3_multiply(block[k], sub(change[matrix_column[k]], change[i]))));
        sum = dadd(sum, own);
        moment = dadd(moment, dcross(position[i], own));
      }
    }
    linear[i] = sum;
    angular[i] = moment;
  }
}

/* Adds `share` of what contact stopped abruptly (abrupt.h) to impulses and moments of prescribed vertices. n,
   incidence, position, properties: as above. */
KERNEL add_abrupt_reactions(int n, int rows, int contacts, double share, GLOBAL const int *row,
                            GLOBAL const int *incidence, GLOBAL const term *terms, GLOBAL const dvec3 *abrupt,
                            GLOBAL const int *fixed, GLOBAL const dvec3 *position,
                            GLOBAL const vertex_contact *properties, GLOBAL dvec3 *linear, GLOBAL dvec3 *angular)
{
  FOR_EACH(i, n) {
    dvec3 sum = linear[i], moment = angular[i];
    int k;
    if (!fixed[i]) continue;
    for (k = row[i]; k < row[i + 1]; ++k) {
      int e = incidence[k] >> 2;
      if (e < contacts) {
        double weight = (double)terms[e].weight[incidence[k] & 3];
        double reach = i >= rows ? (weight < 0.0 ? 1.0 : -1.0) * properties[i].radius : 0.0;
        dvec3 own = dscale(share * weight, abrupt[e]);
        sum = dadd(sum, own);
        moment = dadd(moment, dcross(daxpy(position[i], reach, to_dvec3(terms[e].normal)), own));
      }
    }
    linear[i] = sum;
    angular[i] = moment;
  }
}

/* impulse[i]: of contact i on its side A, N s, with `share` of what it stopped abruptly (abrupt.h; any: whether there
   is such). */
KERNEL contact_impulses(int n, int newton, int form, int any, double share, GLOBAL const term *terms,
                        GLOBAL const vec3 *hold, GLOBAL const dvec3 *abrupt, GLOBAL const dvec3 *velocity,
                        GLOBAL const vec3 *change, GLOBAL dvec3 *impulse)
{
  FOR_EACH(i, n) {
    term t = terms[i];
    vec3 sum = vec3_make((real)0, (real)0, (real)0), held = hold ? hold[i] : sum;
    int a;
    for (a = 0; a < 4; ++a)
      if (t.weight[a] > (real)0) sum = add(sum, term_impulse(t, held, 1, form, newton, 0, a, velocity, change));
    impulse[i] = any ? daxpy(to_dvec3(sum), share, abrupt[i]) : to_dvec3(sum);
  }
}

#define RESISTANCE 21 /* upper triangle of a symmetric 6 x 6 matrix, row by row */

/* sum += weight [D; x cross D] [own I; arm cross]', upper triangle: the impulse at x by the symmetric matrix D, and its
   moment, when a rigid body moves what D acts on, which has the weight `own` and the lever `arm`. */
DEVICE void add_resistance(double weight, mat3 block, dvec3 x, double own, dvec3 arm, double *sum)
{
  double left[6][3], right[6][3];
  int i, j, k, at = 0;
  for (k = 0; k < 3; ++k) {
    dvec3 axis = dvec3_make(k == 0 ? 1.0 : 0.0, k == 1 ? 1.0 : 0.0, k == 2 ? 1.0 : 0.0), turn = dcross(arm, axis);
    dvec3 column = to_dvec3(block.row[k]), moment = dcross(x, column);
    for (i = 0; i < 3; ++i) {
      left[i][k] = weight * dcomponent(column, i);
      left[3 + i][k] = weight * dcomponent(moment, i);
      right[i][k] = own * dcomponent(axis, i);
      right[3 + i][k] = dcomponent(turn, i);
    }
  }
  for (i = 0; i < 6; ++i)
    for (j = i; j < 6; ++j, ++at)
      for (k = 0; k < 3; ++k) sum[at] += left[i][k] * right[j][k];
}

/* resistance[RESISTANCE i ...]: by which the terms at the vertices member[row[i]] to member[row[i + 1] - 1] of a rigid
   obstacle, and the matrix at cloth vertices that are attached to it, push back when it moves: impulse over velocity
   and about the origin, kg, kg m, kg m^2; the sum over the obstacle is symmetric. An upper bound, in which the cloth
   does not give way. range: first and last + 1 vertex of the obstacle of each i. rows: cloth vertices. term_row,
   incidence: of terms at all vertices. */
KERNEL motion_resistance(int n, int rows, GLOBAL const int *row, GLOBAL const int *member, GLOBAL const int *range,
                         GLOBAL const int *fixed, GLOBAL const int *term_row, GLOBAL const int *incidence,
                         GLOBAL const term *terms, GLOBAL const int *matrix_row, GLOBAL const int *matrix_column,
                         GLOBAL const mat3 *block, GLOBAL const dvec3 *position, GLOBAL double *resistance)
{
  FOR_EACH(i, n) {
    double sum[RESISTANCE];
    int j, k, a;
    for (j = 0; j < RESISTANCE; ++j) sum[j] = 0.0;
    for (j = row[i]; j < row[i + 1]; ++j) {
      int v = member[j];
      if (!fixed[v]) continue;
      if (v < rows)
        add_resistance(1.0, block[diagonal_place(matrix_row, matrix_column, v)], position[v], 1.0, position[v], sum);
      else
        for (k = term_row[v]; k < term_row[v + 1]; ++k) {
          term t = terms[incidence[k] >> 2];
          double own = 0.0;
          dvec3 arm = dvec3_make(0.0, 0.0, 0.0);
          for (a = 0; a < 4; ++a)
            if (t.node[a] >= range[2 * i] && t.node[a] < range[2 * i + 1]) {
              own += (double)t.weight[a];
              arm = daxpy(arm, (double)t.weight[a], position[t.node[a]]);
            }
          add_resistance((double)t.weight[incidence[k] & 3],
                         mat3_add_outer(mat3_diagonal(t.around), t.along, t.normal, t.normal), position[v], own, arm,
                         sum);
        }
    }
    for (j = 0; j < RESISTANCE; ++j) resistance[RESISTANCE * i + j] = sum[j];
  }
}

#endif
