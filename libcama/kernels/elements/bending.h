/* SPDX-License-Identifier: Apache-2.0 */
/* Bending across the edge that two triangles share, with stiffness sampled in direction and curvature (Wang et al.
   2011). */
#ifndef CAMA_KERNELS_ELEMENTS_BENDING_H
#define CAMA_KERNELS_ELEMENTS_BENDING_H
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"
#include "../dialect/vec3.h"

typedef struct {
  int node[4];        /* edge nodes 0 and 1, opposite node of face 0, opposite node of face 1 */
  int material;
  real rest_angle;
  real length, area;  /* rest edge length, m; rest area of both faces, m^2 */
  real direction[2];  /* of the rest edge in each face: 0, 1, 2 = 0, 45, 90 degrees from warp */
} hinge_rest;

typedef struct {
  real k[15];
} bending_stiffness; /* [3 directions][5 curvatures 0, 5, 10, 15, 20 1/m], N m */

typedef struct {
  vec3 gradient[4];   /* of the angle, 1/m */
  real coefficient;   /* scale * stiffness: block (a, b) = coefficient g_a g_b' */
} hinge_factor;

typedef struct {
  real angle;
  vec3 gradient[4];
} hinge_angle;

/* Dihedral angle, zero when flat, and its gradient; e1, e2, e3 are the positions of nodes 1, 2, 3 relative to node
   0. */
DEVICE hinge_angle measure_hinge(vec3 e1, vec3 e2, vec3 e3)
{
  hinge_angle h;
  real l2 = dot(e1, e1), l = (real)sqrt(l2), inverse_l = (real)1 / max_real(l, (real)1e-30);
  vec3 n0 = cross(e1, e2), n1 = cross(e3, e1);
  real a0 = norm(n0), a1 = norm(n1), floor_height = (real)1e-3 * l;
  real h0 = max_real(max_real(a0 * inverse_l, floor_height), (real)1e-30),
       h1 = max_real(max_real(a1 * inverse_l, floor_height), (real)1e-30);
  real t2 = dot(e1, e2) * inverse_l * inverse_l, t3 = dot(e1, e3) * inverse_l * inverse_l;
  vec3 g0, g1;
  n0 = scale((real)1 / max_real(a0, (real)1e-30), n0);
  n1 = scale((real)1 / max_real(a1, (real)1e-30), n1);
  h.angle = atan2_plain(dot(e1, cross(n0, n1)) * inverse_l, dot(n0, n1));
  g0 = scale((real)1 / h0, n0);
  g1 = scale((real)1 / h1, n1);
  h.gradient[0] = axpy(scale((real)1 - t2, g0), (real)1 - t3, g1);
  h.gradient[1] = axpy(scale(t2, g0), t3, g1);
  h.gradient[2] = scale((real)-1, g0);
  h.gradient[3] = scale((real)-1, g1);
  return h;
}

/* Piecewise-linear sample at `direction` in [0, 2] and curvature (1/m); below the first column it extrapolates only
   with `extrapolate`. */
DEVICE real sample_bending(GLOBAL const bending_stiffness *table, real direction, real curvature, int extrapolate)
{
  real c = min_real(curvature * (real)0.2, (real)4), d = clamp_real(direction, (real)0, (real)2);
  int i, r = min_int((int)d, 1);
  if (!extrapolate) c = max_real(c, (real)0);
  i = min_int(max_int((int)c, 0), 3);
  c -= (real)i;
  d -= (real)r;
  return max_real((real)0, ((real)1 - d) * (((real)1 - c) * table->k[5 * r + i] + c * table->k[5 * r + i + 1]) +
                               d * (((real)1 - c) * table->k[5 * r + 5 + i] + c * table->k[5 * r + 6 + i]));
}

/* Bending stiffness of a hinge, N m: the smaller one of its two faces. Convention 0 samples at |curvature|; convention
   1 is ARCSim's, which samples at the signed curvature and extrapolates the table below zero. */
DEVICE real hinge_stiffness(GLOBAL const bending_stiffness *table, hinge_rest rest, real angle, int convention)
{
  real half_curvature =
      (real)0.5 * rest.length / rest.area * (convention ? -angle : (angle < (real)0 ? -angle : angle));
  return min_real(sample_bending(table, rest.direction[0], half_curvature, convention),
                  sample_bending(table, rest.direction[1], half_curvature, convention));
}

/* Energy coefficient c of E = c (angle - rest)^2 / 4, J. */
DEVICE real hinge_coefficient(hinge_rest rest, real stiffness)
{
  return stiffness * rest.length * rest.length / ((real)2 * rest.area);
}

/* Difference of two angles brought to (-pi, pi]. */
DEVICE real angle_difference(real a, real b)
{
  const real pi = (real)3.14159265358979323846;
  real d = a - b;
  if (d > pi) d -= (real)2 * pi;
  if (d <= -pi) d += (real)2 * pi;
  return d;
}

DEVICE hinge_angle load_hinge(hinge_rest r, GLOBAL const dvec3 *position)
{
  dvec3 x0 = position[r.node[0]];
  return measure_hinge(to_vec3(dsub(position[r.node[1]], x0)), to_vec3(dsub(position[r.node[2]], x0)),
                       to_vec3(dsub(position[r.node[3]], x0)));
}

/* Forces [4 n] and matrix factors [n] of all hinges. */
KERNEL evaluate_hinges(int n, GLOBAL const hinge_rest *rest, GLOBAL const bending_stiffness *table,
                       GLOBAL const real *material_scale, int convention, GLOBAL const dvec3 *position,
                       GLOBAL hinge_factor *factor, GLOBAL vec3 *force)
{
  FOR_EACH(i, n) {
    hinge_rest r = rest[i];
    hinge_angle h = load_hinge(r, position);
    real half_c = (real)0.5 * hinge_coefficient(r, hinge_stiffness(table + r.material, r, h.angle, convention));
    real moment = -half_c * angle_difference(h.angle, r.rest_angle);
    hinge_factor f;
    int a;
    for (a = 0; a < 4; ++a) {
      f.gradient[a] = h.gradient[a];
      force[4 * i + a] = scale(moment, h.gradient[a]);
    }
    f.coefficient = half_c * material_scale[r.material];
    factor[i] = f;
  }
}

/* Energy [n] of all hinges, J. */
KERNEL measure_hinges(int n, GLOBAL const hinge_rest *rest, GLOBAL const bending_stiffness *table, int convention,
                      GLOBAL const dvec3 *position, GLOBAL double *energy)
{
  FOR_EACH(i, n) {
    hinge_rest r = rest[i];
    hinge_angle h = load_hinge(r, position);
    real c = hinge_coefficient(r, hinge_stiffness(table + r.material, r, h.angle, convention));
    real d = angle_difference(h.angle, r.rest_angle);
    energy[i] = (double)((real)0.25 * c * d * d);
  }
}

/* Block (a, b) of the scaled stiffness of one hinge. */
DEVICE mat3 hinge_block(hinge_factor f, int a, int b)
{
  return mat3_add_outer(mat3_zero(), f.coefficient, f.gradient[a], f.gradient[b]);
}

#endif
