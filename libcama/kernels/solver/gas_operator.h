/* SPDX-License-Identifier: Apache-2.0 */
/* The stiffness of enclosed gas in the linear system: k a a' for each gas, with the derivative a of its volume by
   the positions, which is not zero on the vertices of its cloth alone. */
#ifndef CAMA_KERNELS_SOLVER_GAS_OPERATOR_H
#define CAMA_KERNELS_SOLVER_GAS_OPERATOR_H
#include "../dialect/lang.h"
#include "../dialect/vec3.h"
#include "../elements/gas.h"
#include "conjugate_gradient.h"
#include "scalars.h"

/* Numbers of the gradient [n] in another precision. */
KERNEL convert_gradient(int n, GLOBAL const double *from, GLOBAL real *to)
{
  FOR_EACH(i, n) to[i] = (real)from[i];
}

/* product[t] = the sum of gradient . x over the vertices of part t. place: row of x of each vertex, -1: none; null: x
   is of vertices. Number c of a row is at x[row_stride row + c]. scalar: null, or what tells at `at` that the solve has
   ended. */
KERNEL gas_products(int n, GLOBAL const gas_part *part, GLOBAL const int *place, GLOBAL const vec3 *gradient,
                    int row_stride, GLOBAL const real *x, int at, GLOBAL const double *scalar, GLOBAL double *product)
{
  TEAM_LOCAL(double, sum, GAS_TEAM);
  AWAIT_LAUNCHES;
  if (scalar && scalar[at + CG_DONE] != 0.0) return;
  FOR_EACH_TEAM(t, n) {
    const gas_part p = part[t];
    TEAM_BARRIER;
    TEAM_FOR(l, GAS_TEAM) {
      double own = 0.0;
      int v;
      for (v = p.first + l; v < p.end; v += GAS_TEAM) {
        const int row = place ? place[v] : v;
        if (row >= 0) {
          const vec3 g = gradient[v];
          GLOBAL const real *xi = x + (size_t)row_stride * row;
          own += (double)g.x * (double)xi[0] + (double)g.y * (double)xi[1] + (double)g.z * (double)xi[2];
        }
      }
      sum[l] = own;
    }
    tree_sums(GAS_TEAM, 1, sum);
    TEAM_FOR(l, 1) product[t] = sum[0];
  }
}

/* q += factor k a (a . x) on the vertices of each part, from the products of all parts of its gas; not on those that
   have no place, or are fixed where `fixed` is not null. Number c of a row is at q[row_stride row + component_stride
   c]. partial: null, or where the conjugate gradient sums r'z and z'A z, with those of the parts from `first` on. */
KERNEL add_gas_products(int n, GLOBAL const gas_part *part, GLOBAL const gas *gases, GLOBAL const gas_state *state,
                        GLOBAL const int *place, GLOBAL const int *fixed, GLOBAL const vec3 *gradient,
                        GLOBAL const double *product, double factor, int row_stride, int component_stride, int at,
                        GLOBAL const double *scalar, GLOBAL real *q, int first, GLOBAL double *partial)
{
  TEAM_LOCAL(double, sum, GAS_TEAM);
  AWAIT_LAUNCHES;
  if (scalar && scalar[at + CG_DONE] != 0.0) return;
  FOR_EACH_TEAM(t, n) {
    const gas_part p = part[t];
    const gas g = gases[p.gas];
    double total;
    TEAM_BARRIER;
    sum_of_teams(GAS_TEAM, 1, g.vertex_parts, product + g.vertex_part, sum);
    total = factor * state[p.gas].stiffness * sum[0];
    TEAM_FOR(l, p.end - p.first) {
      const int v = p.first + l, row = place ? place[v] : v;
      if (row >= 0 && !(fixed && fixed[v])) {
        const vec3 own = scale((real)total, gradient[v]);
        GLOBAL real *qi = q + (size_t)row_stride * row;
        qi[0] += own.x;
        qi[component_stride] += own.y;
        qi[2 * (size_t)component_stride] += own.z;
      }
    }
    if (partial)
      TEAM_FOR(l, 1) {
        partial[2 * (first + t)] = 0.0;
        partial[2 * (first + t) + 1] = total * product[t];
      }
  }
}

#endif
