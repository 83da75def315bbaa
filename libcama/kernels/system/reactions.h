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

/* How the solve took its forces. */
#define SOLVE_OPERATOR 0 /* linearised, terms apart from the matrix */
#define SOLVE_MATRIX 1 /* linearised, the matrix includes the terms of cloth vertices */
#define SOLVE_NEWTON 2 /* forces at the solution */

/* The impulse of a term on its node a, N s, at the velocities of the solve. */
DEVICE vec3 term_impulse(term t, int form, int newton, int a, GLOBAL const dvec3 *velocity)
{
  vec3 sum = scale(t.weight[a] * t.push, t.normal), across = vec3_make((real)0, (real)0, (real)0);
  int b;
  for (b = 0; b < 4; ++b)
    if (t.node[b] >= 0) across = axpy(across, term_coupling(t, form, a, b), to_vec3(velocity[t.node[b]]));
  if (newton) return axpy(sum, -t.around, axpy(across, -dot(t.normal, across), t.normal));
  return axpy(axpy(sum, -t.along * dot(t.normal, across), t.normal), -t.around, across);
}

/* linear[i]: impulse of the cloth on vertex i, N s, angular[i]: its moment about the origin, N m s; zero for free
   vertices. n: all vertices. row, incidence: of terms at all vertices. position: at the start of the step, where
   contacts were found. properties: none without contact. */
KERNEL solve_reactions(int n, int rows, int solve, int form, real time_step, GLOBAL const int *row,
                       GLOBAL const int *incidence, GLOBAL const term *terms, GLOBAL const int *matrix_row,
                       GLOBAL const int *matrix_column, GLOBAL const mat3 *block, GLOBAL const real *mass,
                       GLOBAL const vec3 *force, GLOBAL const int *fixed, GLOBAL const dvec3 *base_velocity,
                       GLOBAL const dvec3 *velocity, GLOBAL const dvec3 *position,
                       GLOBAL const vertex_contact *properties, GLOBAL dvec3 *linear, GLOBAL dvec3 *angular)
{
  FOR_EACH(i, n) {
    dvec3 sum = dvec3_make(0.0, 0.0, 0.0), moment = sum;
    int k;
    if (fixed[i]) {
      for (k = row[i]; k < row[i + 1]; ++k) {
        term t = terms[incidence[k] >> 2];
        int a = incidence[k] & 3;
        /* towards the other side, by the radius of an exact obstacle */
        double reach = properties && i >= rows ? (t.weight[a] < (real)0 ? 1.0 : -1.0) * properties[i].radius : 0.0;
        dvec3 own =
            to_dvec3(i < rows && solve == SOLVE_MATRIX ? scale(t.weight[a] * t.push, t.normal)
                                                       : term_impulse(t, form, solve == SOLVE_NEWTON, a, velocity));
        sum = dadd(sum, own);
        moment = dadd(moment, dcross(daxpy(position[i], reach, to_dvec3(t.normal)), own));
      }
      if (i < rows) {
        dvec3 own =
            daxpy(dscale((double)time_step, to_dvec3(force[i])), -(double)mass[i], dsub(velocity[i], base_velocity[i]));
        if (solve != SOLVE_NEWTON)
          for (k = matrix_row[i]; k < matrix_row[i + 1]; ++k)
            own = dsub(own, to_dvec3(mat3_multiply(block[k], to_vec3(dsub(velocity[matrix_column[k]], velocity[i])))));
        sum = dadd(sum, own);
        moment = dadd(moment, dcross(position[i], own));
      }
    }
    linear[i] = sum;
    angular[i] = moment;
  }
}

/* impulse[i]: of contact i on its side A, N s. */
KERNEL contact_impulses(int n, int solve, int form, GLOBAL const term *terms, GLOBAL const dvec3 *velocity,
                        GLOBAL dvec3 *impulse)
{
  FOR_EACH(i, n) {
    term t = terms[i];
    vec3 sum = vec3_make((real)0, (real)0, (real)0);
    int a;
    for (a = 0; a < 4; ++a)
      if (t.weight[a] > (real)0) sum = add(sum, term_impulse(t, form, solve == SOLVE_NEWTON, a, velocity));
    impulse[i] = to_dvec3(sum);
  }
}

#endif
