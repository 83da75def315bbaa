/* SPDX-License-Identifier: Apache-2.0 */
/* Bending of a plate whose energy does not depend on the mesh: the moments of the lowest Hellan-Herrmann-Johnson
   element, one at each hinge, are those that fit the angles of all hinges (docs/theory/elasticity.md). */
#ifndef CAMA_KERNELS_ELEMENTS_PLATE_H
#define CAMA_KERNELS_ELEMENTS_PLATE_H
#include "../dialect/lanes.h"
#include "bending.h"

typedef struct {
  int neighbour[4];   /* hinges with which it shares a triangle; itself where there is none */
  int cloth;
  real coupling[4];   /* of the compliance with each of them, scaled to a diagonal of ones */
  real scale;         /* scaled angle for an angle, sqrt(J) */
  real bound;         /* the matrix's stiffness for scaled angles, at least half of the true one */
  real reference;     /* hinge stiffness at no curvature, N m; 0: stiffness does not vary */
} hinge_coupling;

/* A step of Chebyshev's iteration for the moments of a cloth; both 0 once it has had its steps. The first of all has
   the share of the scaled angles that the moments begin with. */
typedef struct {
  real momentum, share;
} moment_step;

/* Scaled angle for the difference of an angle from its rest, sqrt(J). */
DEVICE real angle_scale(hinge_coupling c, GLOBAL const bending_stiffness *table, hinge_rest rest, real angle)
{
  if (c.reference > (real)0)
    return c.scale * (real)sqrt(hinge_stiffness(table + rest.material, rest, angle, 0) / c.reference);
  return c.scale;
}

/* Angles of LANES hinges, with their gradients. */
typedef struct {
  real angle[LANES], gradient[12][LANES];
} hinge_angles;

/* Those of `count` hinges from `first` on; the loop over lanes, which a CPU makes of vectors, neither loads nor stores
   elsewhere. */
DEVICE INLINED hinge_angles load_hinges(int first, int count, GLOBAL const hinge_rest *rest,
                                        GLOBAL const dvec3 *position)
{
  hinge_angles h;
  real edge[9][LANES];
  for (int q = 0; q < LANES; ++q) {
    GLOBAL const hinge_rest *r = rest + first + min_int(q, count - 1);
    const dvec3 x0 = position[r->node[0]];
    for (int k = 0; k < 3; ++k) {
      const vec3 e = to_vec3(dsub(position[r->node[k + 1]], x0));
      edge[3 * k][q] = e.x;
      edge[3 * k + 1][q] = e.y;
      edge[3 * k + 2][q] = e.z;
    }
  }
  SIMD
  for (int q = 0; q < LANES; ++q) {
    const hinge_angle own =
        measure_hinge(vec3_make(edge[0][q], edge[1][q], edge[2][q]), vec3_make(edge[3][q], edge[4][q], edge[5][q]),
                      vec3_make(edge[6][q], edge[7][q], edge[8][q]));
    h.angle[q] = own.angle;
    for (int k = 0; k < 4; ++k) {
      h.gradient[3 * k][q] = own.gradient[k].x;
      h.gradient[3 * k + 1][q] = own.gradient[k].y;
      h.gradient[3 * k + 2][q] = own.gradient[k].z;
    }
  }
  return h;
}

/* Scaled angles, their scales and first moments [n], and matrix factors [n] of all hinges. */
KERNEL scale_angles(int n, GLOBAL const hinge_rest *rest, GLOBAL const hinge_coupling *coupling,
                    GLOBAL const bending_stiffness *table, GLOBAL const real *material_scale,
                    GLOBAL const moment_step *start, GLOBAL const dvec3 *position, GLOBAL hinge_factor *factor,
                    GLOBAL real *scales, GLOBAL real *angle, GLOBAL real *moment)
{
  FOR_EACH_LANES(first, n) {
    const int count = min_int(n - first, LANES);
    const hinge_angles h = load_hinges(first, count, rest, position);
    for (int q = 0; q < count; ++q) {
      const int i = first + q;
      hinge_rest r = rest[i];
      real s = angle_scale(coupling[i], table, r, h.angle[q]), y = s * angle_difference(h.angle[q], r.rest_angle);
      hinge_factor f;
      int a;
      for (a = 0; a < 4; ++a)
        f.gradient[a] = vec3_make(h.gradient[3 * a][q], h.gradient[3 * a + 1][q], h.gradient[3 * a + 2][q]);
      f.coefficient = coupling[i].bound * s * s * material_scale[r.material];
      factor[i] = f;
      scales[i] = s;
      angle[i] = y;
      moment[i] = start[r.material].share * y;
    }
  }
}

/* Scaled angles and first moments [n] alone. */
KERNEL measure_angles(int n, GLOBAL const hinge_rest *rest, GLOBAL const hinge_coupling *coupling,
                      GLOBAL const bending_stiffness *table, GLOBAL const moment_step *start,
                      GLOBAL const dvec3 *position, GLOBAL real *angle, GLOBAL real *moment)
{
  FOR_EACH_LANES(first, n) {
    const int count = min_int(n - first, LANES);
    const hinge_angles h = load_hinges(first, count, rest, position);
    for (int q = 0; q < count; ++q) {
      const int i = first + q;
      hinge_rest r = rest[i];
      real y = angle_scale(coupling[i], table, r, h.angle[q]) * angle_difference(h.angle[q], r.rest_angle);
      angle[i] = y;
      moment[i] = start[r.material].share * y;
    }
  }
}

/* Scaled rates of the angles times the damping, and first moments [n]; material_scale = h (h + damping). */
KERNEL measure_rates(int n, GLOBAL const hinge_rest *rest, GLOBAL const hinge_factor *factor,
                     GLOBAL const real *material_scale, real step, GLOBAL const moment_step *start,
                     GLOBAL const dvec3 *velocity, GLOBAL const real *scales, GLOBAL real *rate, GLOBAL real *moment)
{
  FOR_EACH(i, n) {
    hinge_rest r = rest[i];
    real own = (real)0;
    int a;
    for (a = 1; a < 4; ++a) own += dot(factor[i].gradient[a], to_vec3(dsub(velocity[r.node[a]], velocity[r.node[0]])));
    rate[i] = scales[i] * (material_scale[r.material] / step - step) * own;
    moment[i] = start[r.material].share * rate[i];
  }
}

/* Moment of a hinge after a step s of Chebyshev's iteration from m. change: m less the one before; near: moments of its
   neighbours. */
DEVICE real next_moment(hinge_coupling c, moment_step s, real angle, real m, real change, const real *near)
{
  real left = angle - m;
  int k;
  for (k = 0; k < 4; ++k) left -= c.coupling[k] * near[k];
  return m + s.momentum * change + s.share * left;
}

/* That of hinge i; where `first`, the moments before are read as zero. */
DEVICE real improved_moment(int i, hinge_coupling c, moment_step s, int first, GLOBAL const real *angle,
                            GLOBAL const real *moment, GLOBAL const real *before)
{
  const real m = moment[i];
  real near[4];
  int k;
  for (k = 0; k < 4; ++k) near[k] = moment[c.neighbour[k]];
  return next_moment(c, s, angle[i], m, first ? m : m - before[i], near);
}

/* A step of Chebyshev's iteration for the moments, that of each cloth in `step` from `row` on: before = moment +
   momentum (moment - before) + share (angle - compliance moment). rate, rate_moment, rate_before: the same for the
   rates of the angles, or null. */
KERNEL improve_moments(int n, GLOBAL const hinge_coupling *coupling, GLOBAL const real *angle,
                       GLOBAL const moment_step *step, int row, int first, GLOBAL const real *moment,
                       GLOBAL real *before, GLOBAL const real *rate, GLOBAL const real *rate_moment,
                       GLOBAL real *rate_before)
{
  FOR_EACH_EARLY(i, n) {
    hinge_coupling c = coupling[i];
    moment_step s = step[row + c.cloth];
    AWAIT_LAUNCHES;
    before[i] = improved_moment(i, c, s, first, angle, moment, before);
    if (rate) rate_before[i] = improved_moment(i, c, s, first, rate, rate_moment, rate_before);
  }
}

/* Steps s and t of hinge i, whose neighbours have the couplings `near`: `next` and next_before are moment and before
   after both. */
DEVICE void improve_twice(int i, hinge_coupling c, const hinge_coupling *near, moment_step s, moment_step t, int first,
                          GLOBAL const real *angle, GLOBAL const real *moment, GLOBAL const real *before,
                          GLOBAL real *next, GLOBAL real *next_before)
{
  const real own = improved_moment(i, c, s, first, angle, moment, before);
  real after[4];
  int k;
  for (k = 0; k < 4; ++k) after[k] = improved_moment(c.neighbour[k], near[k], s, first, angle, moment, before);
  next_before[i] = own;
  next[i] = next_moment(c, t, angle[i], own, own - moment[i], after);
}

/* Two steps, from `row` and from row + cloths on, for scenes that wait for launches: each hinge also finds what its
   neighbours have after the first. */
KERNEL improve_moments_twice(int n, GLOBAL const hinge_coupling *coupling, GLOBAL const real *angle,
                             GLOBAL const moment_step *step, int row, int cloths, int first, GLOBAL const real *moment,
                             GLOBAL const real *before, GLOBAL real *next, GLOBAL real *next_before,
                             GLOBAL const real *rate, GLOBAL const real *rate_moment, GLOBAL const real *rate_before,
                             GLOBAL real *rate_next, GLOBAL real *rate_next_before)
{
  FOR_EACH_EARLY(i, n) {
    const hinge_coupling c = coupling[i];
    const moment_step s = step[row + c.cloth], t = step[row + cloths + c.cloth];
    hinge_coupling near[4];
    int k;
    for (k = 0; k < 4; ++k) near[k] = coupling[c.neighbour[k]];
    AWAIT_LAUNCHES;
    improve_twice(i, c, near, s, t, first, angle, moment, before, next, next_before);
    if (rate) improve_twice(i, c, near, s, t, first, rate, rate_moment, rate_before, rate_next, rate_next_before);
  }
}

/* force [n], four a hinge: -moment gradient. rate_moment: that of damping, or null; its forces are in rate_force, or
   where that is null added to force. */
KERNEL bend_hinges(int n, GLOBAL const hinge_factor *factor, GLOBAL const real *scales, GLOBAL const real *moment,
                   GLOBAL const real *rate_moment, GLOBAL vec3 *force, GLOBAL vec3 *rate_force)
{
  FOR_EACH(i, n) {
    const int h = i >> 2;
    const vec3 gradient = factor[h].gradient[i & 3];
    vec3 sum = scale(-scales[h] * moment[h], gradient);
    if (rate_moment) {
      const real m = -scales[h] * rate_moment[h];
      if (rate_force)
        rate_force[i] = scale(m, gradient);
      else
        sum = axpy(sum, m, gradient);
    }
    force[i] = sum;
  }
}

/* Energy [n], J, whose sum is that of all hinges. */
KERNEL measure_bending(int n, GLOBAL const real *angle, GLOBAL const real *moment, GLOBAL double *energy)
{
  FOR_EACH(i, n) {
    energy[i] = (double)((real)0.5 * angle[i] * moment[i]);
  }
}

#endif
