/* SPDX-License-Identifier: Apache-2.0 */
/* Wind, drag and pressure on triangles; enclosed gas, mass damping and forces that a driver sets, on vertices. */
#ifndef CAMA_KERNELS_ELEMENTS_EXTERNAL_H
#define CAMA_KERNELS_ELEMENTS_EXTERNAL_H
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"
#include "../dialect/vec3.h"
#include "elasticity.h"
#include "gas.h"

#define WIND_SHARE 0.5 /* largest share of a triangle's speed through the air that drag may take in a step */

/* Force on each node of a triangle from air moving with `wind` (m/s) of density rho (kg/m^3): pressure rho A (v.n)|v.n|
   along the normal and tangential drag A drag v_t, a third to each node. The velocity of the triangle is the mean of
   its nodes. rest_area > 0: A is the area at rest, ARCSim's convention; otherwise the current area. most: limit of
   force over speed at a node, kg/s: drag is explicit, and beyond mass over time step it would reverse the motion and be
   unstable. */
DEVICE vec3 wind_force(vec3 edge1, vec3 edge2, vec3 relative_velocity, real density, real drag, real rest_area,
                       real most)
{
  vec3 doubled = cross(edge1, edge2), normal, tangential;
  real area = (real)0.5 * norm(doubled), vn, speed;
  if (!(area > (real)0)) return vec3_make((real)0, (real)0, (real)0);
  normal = scale((real)0.5 / area, doubled);
  if (rest_area > (real)0) area = rest_area;
  vn = dot(normal, relative_velocity);
  speed = vn < (real)0 ? -vn : vn;
  tangential = axpy(relative_velocity, -vn, normal);
  if (area / (real)3 * max_real(density * speed, drag) > most)
    return axpy(scale(min_real(area / (real)3 * density * speed, most) * vn, normal),
                min_real(area / (real)3 * drag, most), tangential);
  return scale(area / (real)3, axpy(scale(density * speed * vn, normal), drag, tangential));
}

/* Adds the pressure of each cloth, Pa, to the element forces [3 n]: p times the area along the normal, a third to each
   node. On a closed surface this is p times the derivative of the volume. */
KERNEL add_pressure(int n, GLOBAL const triangle_rest *rest, GLOBAL const dvec3 *position,
                    GLOBAL const double *pressure, GLOBAL vec3 *force)
{
  FOR_EACH(i, n) {
    triangle_rest r = rest[i];
    dvec3 x0 = position[r.node[0]];
    vec3 f = scale((real)(pressure[r.material] / 6.0),
                   cross(to_vec3(dsub(position[r.node[1]], x0)), to_vec3(dsub(position[r.node[2]], x0))));
    force[3 * i] = add(force[3 * i], f);
    force[3 * i + 1] = add(force[3 * i + 1], f);
    force[3 * i + 2] = add(force[3 * i + 2], f);
  }
}

/* The derivative of the volume of each gas by the vertices of its cloth, gradient [n], m^2, and its pressure times that
   added to the forces [n]. row, incidence: of triangles at vertices. gas_of: of each vertex, -1: none. */
KERNEL add_gas_pressure(int n, GLOBAL const int *row, GLOBAL const int *incidence, GLOBAL const triangle_rest *rest,
                        GLOBAL const int *gas_of, GLOBAL const gas_state *state, GLOBAL const dvec3 *position,
                        GLOBAL vec3 *gradient, GLOBAL vec3 *force)
{
  FOR_EACH(i, n) {
    vec3 sum = vec3_make((real)0, (real)0, (real)0);
    int k;
    if (gas_of[i] >= 0) {
      for (k = row[i]; k < row[i + 1]; ++k) {
        triangle_rest r = rest[incidence[k] >> 2];
        dvec3 x0 = position[r.node[0]];
        sum = add(sum, cross(to_vec3(dsub(position[r.node[1]], x0)), to_vec3(dsub(position[r.node[2]], x0))));
      }
      sum = scale((real)(1.0 / 6.0), sum);
      force[i] = axpy(force[i], (real)state[gas_of[i]].pressure, sum);
    }
    gradient[i] = sum;
  }
}

/* Velocity of the wind relative to that of a triangle, m/s. */
DEVICE vec3 relative_wind(triangle_rest r, GLOBAL const dvec3 *velocity, dvec3 wind)
{
  dvec3 sum = dadd(dadd(velocity[r.node[0]], velocity[r.node[1]]), velocity[r.node[2]]);
  return to_vec3(dsub(wind, dscale(1.0 / 3.0, sum)));
}

/* Adds wind to the element forces [3 n] of all triangles. wind: [1], m/s. areal_density: by material, kg/m^2.
   Convention 1 uses ARCSim's area. limited: the force is explicit, and limited as above. */
KERNEL add_wind(int n, GLOBAL const triangle_rest *rest, GLOBAL const dvec3 *position, GLOBAL const dvec3 *velocity,
                GLOBAL const dvec3 *wind, GLOBAL const double *areal_density, real density, real drag, int convention,
                int limited, real time_step, GLOBAL vec3 *force)
{
  FOR_EACH(i, n) {
    triangle_rest r = rest[i];
    dvec3 x0 = position[r.node[0]];
    real most = limited ? (real)(WIND_SHARE / 3.0 * areal_density[r.material]) * r.area / time_step : (real)1e30;
    vec3 f = wind_force(to_vec3(dsub(position[r.node[1]], x0)), to_vec3(dsub(position[r.node[2]], x0)),
                        relative_wind(r, velocity, wind[0]), density, drag, convention ? r.area : (real)0, most);
    force[3 * i] = add(force[3 * i], f);
    force[3 * i + 1] = add(force[3 * i + 1], f);
    force[3 * i + 2] = add(force[3 * i + 2], f);
  }
}

/* The derivative of wind by velocity, negative, times the time step, kg: block [n] of each vertex for itself, of its
   triangles' third of 2 A rho |v.n| along the normal and A drag across. Each vertex counts as if it alone moved the
   triangle: the sum over a common motion is exact, and no motion has less. row, incidence: of triangles at vertices. */
KERNEL wind_drag(int n, GLOBAL const int *row, GLOBAL const int *incidence, GLOBAL const triangle_rest *rest,
                 GLOBAL const dvec3 *position, GLOBAL const dvec3 *velocity, GLOBAL const dvec3 *wind, real density,
                 real drag, int convention, real time_step, GLOBAL mat3 *block)
{
  FOR_EACH(i, n) {
    mat3 sum = mat3_zero();
    int k;
    for (k = row[i]; k < row[i + 1]; ++k) {
      triangle_rest r = rest[incidence[k] >> 2];
      dvec3 x0 = position[r.node[0]];
      vec3 normal = cross(to_vec3(dsub(position[r.node[1]], x0)), to_vec3(dsub(position[r.node[2]], x0)));
      real length = norm(normal), vn, along, across;
      if (!(length > (real)0)) continue;
      normal = scale((real)1 / length, normal);
      vn = dot(normal, relative_wind(r, velocity, wind[0]));
      across = time_step / (real)3 * (convention ? r.area : (real)0.5 * length);
      along = (real)2 * density * (vn < (real)0 ? -vn : vn) * across;
      across *= drag;
      sum = mat3_add_outer(mat3_add(sum, mat3_diagonal(across)), along - across, normal, normal);
    }
    block[i] = sum;
  }
}

/* Adds mass damping at these velocities, or the part of it that does not depend on them. rate: a m of each vertex,
   kg/s. wind: [1], m/s, the velocity of the air. */
KERNEL damp_vertices(int n, int moving, GLOBAL const real *rate, GLOBAL const dvec3 *velocity, GLOBAL const dvec3 *wind,
                     GLOBAL vec3 *force)
{
  FOR_EACH(i, n) {
    vec3 v = to_vec3(moving ? dsub(wind[0], velocity[i]) : wind[0]);
    force[i] = axpy(force[i], rate[i], v);
  }
}

/* Its derivative by velocity, negative, times the time step, kg: block [n] is set to it, or has it added. */
KERNEL mass_damping_drag(int n, int adding, real time_step, GLOBAL const real *rate, GLOBAL mat3 *block)
{
  FOR_EACH(i, n) {
    mat3 own = mat3_diagonal(time_step * rate[i]);
    block[i] = adding ? mat3_add(block[i], own) : own;
  }
}

/* Adds the forces that a driver holds on vertices, N. */
KERNEL add_driven_forces(int n, GLOBAL const dvec3 *driven, GLOBAL vec3 *force)
{
  FOR_EACH(i, n) {
    force[i] = add(force[i], to_vec3(driven[i]));
  }
}

#endif
