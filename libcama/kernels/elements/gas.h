/* SPDX-License-Identifier: Apache-2.0 */
/* Gas enclosed by closed cloth, at constant temperature: pressure times volume is constant
   (docs/theory/elasticity.md). */
#ifndef CAMA_KERNELS_ELEMENTS_GAS_H
#define CAMA_KERNELS_ELEMENTS_GAS_H
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"
#include "../solver/scalars.h"
#include "../system/incidence.h"

#define GAS_TEAM 128 /* members of a team that sums over a part */

typedef struct {
  int cloth, first_vertex;
  int triangle_part, triangle_parts; /* first of its parts, and their number */
  int vertex_part, vertex_parts;
  double amount;                     /* absolute pressure times volume, J */
  double ambient;                    /* pressure outside, Pa */
  double least_volume;               /* below it the pressure is linear in the volume, m^3 */
} gas;

/* Triangles or vertices of a gas that a team sums over. */
typedef struct {
  int gas, first, end;
} gas_part;

typedef struct {
  double volume;    /* m^3 */
  double pressure;  /* above that outside, Pa */
  double stiffness; /* -dp/dV times the square of the time step, kg/m^4 */
} gas_state;

/* The gas in this volume; an ideal gas at constant temperature has dp/dV = -p / V. Below the least volume, also below
   none, the pressure is on the tangent there. */
DEVICE gas_state gas_in_volume(gas g, double volume, double time_step)
{
  double filled = max_double(volume, g.least_volume), absolute = g.amount / filled, slope = absolute / filled;
  gas_state s;
  s.volume = volume;
  s.pressure = absolute + slope * (filled - volume) - g.ambient;
  s.stiffness = time_step * time_step * slope;
  return s;
}

/* volume[i] of the tetrahedra between the triangles of part i and the first vertex of the cloth, with their sign. */
KERNEL measure_volumes(int n, GLOBAL const gas_part *part, GLOBAL const gas *gases,
                       GLOBAL const element_nodes *triangle, GLOBAL const dvec3 *position, GLOBAL double *volume)
{
  TEAM_LOCAL(double, sum, GAS_TEAM);
  FOR_EACH_TEAM(t, n) {
    const gas_part p = part[t];
    const dvec3 origin = position[gases[p.gas].first_vertex];
    TEAM_BARRIER;
    TEAM_FOR(l, GAS_TEAM) {
      double own = 0.0;
      int k;
      for (k = p.first + l; k < p.end; k += GAS_TEAM) {
        const element_nodes e = triangle[k];
        own += ddot(dsub(position[e.node[0]], origin),
                    dcross(dsub(position[e.node[1]], origin), dsub(position[e.node[2]], origin)));
      }
      sum[l] = own;
    }
    tree_sums(GAS_TEAM, 1, sum);
    TEAM_FOR(l, 1) volume[t] = sum[0] / 6.0;
  }
}

/* The state of each gas from the volumes of its parts. A team each. */
KERNEL gas_pressures(int n, GLOBAL const gas *gases, GLOBAL const double *volume, double time_step,
                     GLOBAL gas_state *state)
{
  TEAM_LOCAL(double, sum, GAS_TEAM);
  FOR_EACH_TEAM(t, n) {
    const gas g = gases[t];
    TEAM_BARRIER;
    sum_of_teams(GAS_TEAM, 1, g.triangle_parts, volume + g.triangle_part, sum);
    TEAM_FOR(l, 1) state[t] = gas_in_volume(g, sum[0], time_step);
  }
}

#endif
