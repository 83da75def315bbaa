/* SPDX-License-Identifier: Apache-2.0 */
/* Planar elasticity after Wang, O'Brien and Ramamoorthi 2011 (paper, section 2): energy per area
   k0 E11^2/2 + k1 E11 E22 + k2 E22^2/2 + k3 E12^2 with Green strain E; stiffness sampled at the current strain. */
#ifndef CAMA_KERNELS_ELEMENTS_ELASTICITY_H
#define CAMA_KERNELS_ELEMENTS_ELASTICITY_H
#include "../dialect/dvec3.h"
#include "../dialect/lang.h"
#include "../dialect/vec3.h"

/* A table has this many samples along each of E11, E22, |E12|, at distances of 1/30 from -1/4, -1/4, 0. */
#define STRETCHING_CELLS 30

/* (k11, k12, k22, k33), N/m */
typedef struct {
  real k[4];
} stretching_stiffness;

/* Biphasic stiffness: beyond the Green strain `strain` along warp and weft, and in shear, stress grows up to `factor` +
   1 times as fast; up to LIMIT_RISE of the strain beyond it this rises. strain 0: none. */
#define LIMIT_RISE ((real)0.5)
typedef struct {
  real strain, factor;
} strain_limit;

typedef struct {
  int node[3];
  int material;
  real d[4]; /* inverse of the 2x2 matrix of rest edges, rows belong to nodes 1 and 2, 1/m */
  real area; /* at rest, m^2 */
} triangle_rest;

/* The part of one triangle in the matrix: block (a, b) is a combination of uu', ww', uw', wu' and I. */
typedef struct {
  vec3 u, w; /* columns of the deformation gradient */
  real d[4];
  real k[4]; /* area * scale * stiffness */
  real e0, e1; /* geometric terms: k0 s0 + k1 s1, k2 s1 + k1 s0 */
} triangle_factor;

typedef struct {
  vec3 u, w;
  real e00, e11, e01;
} green_strain;

DEVICE green_strain triangle_strain(triangle_rest rest, vec3 edge1, vec3 edge2)
{
  green_strain g;
  g.u = axpy(scale(rest.d[0], edge1), rest.d[2], edge2);
  g.w = axpy(scale(rest.d[1], edge1), rest.d[3], edge2);
  g.e00 = (real)0.5 * (dot(g.u, g.u) - (real)1);
  g.e11 = (real)0.5 * (dot(g.w, g.w) - (real)1);
  g.e01 = (real)0.5 * dot(g.u, g.w);
  return g;
}

/* Trilinear sample of a material's table, [30][30][30] over (E11, E22, |E12|). */
DEVICE stretching_stiffness sample_stretching(GLOBAL const stretching_stiffness *table, real e00, real e11, real e01)
{
  const int cells = STRETCHING_CELLS;
  const real top = (real)(STRETCHING_CELLS - 1 - 1e-5);
  real c[3], f[3];
  int i[3], p, m;
  stretching_stiffness k;
  c[0] = clamp_real((e00 + (real)0.25) * (real)STRETCHING_CELLS, (real)0, top);
  c[1] = clamp_real((e11 + (real)0.25) * (real)STRETCHING_CELLS, (real)0, top);
  c[2] = clamp_real((e01 < (real)0 ? -e01 : e01) * (real)STRETCHING_CELLS, (real)0, top);
  for (p = 0; p < 3; ++p) {
    i[p] = min_int((int)c[p], cells - 2);
    f[p] = c[p] - (real)i[p];
  }
  for (m = 0; m < 4; ++m) k.k[m] = (real)0;
  for (p = 0; p < 8; ++p) {
    int a = p & 1, b = (p >> 1) & 1, d = p >> 2;
    real weight = (a ? f[0] : (real)1 - f[0]) * (b ? f[1] : (real)1 - f[1]) * (d ? f[2] : (real)1 - f[2]);
    stretching_stiffness s = table[((i[0] + a) * cells + i[1] + b) * cells + i[2] + d];
    for (m = 0; m < 4; ++m) k.k[m] += weight * s.k[m];
  }
  return k;
}

/* Energy per rest area, J/m^2. */
DEVICE real stretching_energy(green_strain g, stretching_stiffness k)
{
  return (real)0.5 * (k.k[0] * g.e00 * g.e00 + k.k[2] * g.e11 * g.e11) + k.k[1] * g.e00 * g.e11 +
         k.k[3] * g.e01 * g.e01;
}

/* Forces on nodes 1 and 2 (node 0 takes the negative sum): the negative gradient of area * energy with constant
   stiffness. */
DEVICE void triangle_forces(triangle_rest rest, green_strain g, stretching_stiffness k, vec3 *f1, vec3 *f2)
{
  real s0 = -rest.area * (k.k[0] * g.e00 + k.k[1] * g.e11);
  real s1 = -rest.area * (k.k[2] * g.e11 + k.k[1] * g.e00);
  real s2 = -rest.area * k.k[3] * g.e01;
  vec3 pu = axpy(scale(s0, g.u), s2, g.w), pw = axpy(scale(s1, g.w), s2, g.u);
  *f1 = axpy(scale(rest.d[0], pu), rest.d[1], pw);
  *f2 = axpy(scale(rest.d[2], pu), rest.d[3], pw);
}

/* The positive semidefinite part of the Hessian: compression reduces the geometric terms to zero, that of shear is left
   out, and k12 is limited to sqrt(k11 k22). matrix_scale, geometric_scale: what multiplies the stiffness and its
   geometric terms in the system, s^2. */
DEVICE triangle_factor make_triangle_factor(triangle_rest rest, green_strain g, stretching_stiffness k,
                                            real matrix_scale, real geometric_scale)
{
  triangle_factor t;
  real s0 = max_real(g.e00, (real)0), s1 = max_real(g.e11, (real)0), scaled = rest.area * matrix_scale,
       geometric = geometric_scale / matrix_scale;
  real bound = (real)sqrt(max_real(k.k[0] * k.k[2], (real)0));
  int m;
  t.u = g.u;
  t.w = g.w;
  for (m = 0; m < 4; ++m) t.d[m] = rest.d[m];
  t.k[0] = scaled * k.k[0];
  t.k[1] = scaled * clamp_real(k.k[1], -bound, bound);
  t.k[2] = scaled * k.k[2];
  t.k[3] = scaled * k.k[3];
  t.e0 = geometric * max_real(t.k[0] * s0 + t.k[1] * s1, (real)0);
  t.e1 = geometric * max_real(t.k[2] * s1 + t.k[1] * s0, (real)0);
  return t;
}

/* Shape function gradients of node a: d[2 a - 2], d[2 a - 1]; node 0 has the negative sum. */
DEVICE real triangle_gradient(triangle_factor t, int a, int component)
{
  return a == 0 ? -(t.d[component] + t.d[2 + component]) : a == 1 ? t.d[component] : t.d[2 + component];
}

/* Block (a, b) of the scaled stiffness of one triangle. */
DEVICE mat3 triangle_block(triangle_factor t, int a, int b)
{
  real a0 = triangle_gradient(t, a, 0), a1 = triangle_gradient(t, a, 1);
  real b0 = triangle_gradient(t, b, 0), b1 = triangle_gradient(t, b, 1);
  real half_shear = (real)0.5 * t.k[3];
  real uu = t.k[0] * a0 * b0 + half_shear * a1 * b1, ww = t.k[2] * a1 * b1 + half_shear * a0 * b0;
  real uw = t.k[1] * a0 * b1 + half_shear * a1 * b0, wu = t.k[1] * a1 * b0 + half_shear * a0 * b1;
  vec3 ru = axpy(scale(uu, t.u), uw, t.w), rw = axpy(scale(wu, t.u), ww, t.w);
  mat3 m = mat3_diagonal(t.e0 * a0 * b0 + t.e1 * a1 * b1);
  m = mat3_add_outer(m, (real)1, t.u, ru);
  return mat3_add_outer(m, (real)1, t.w, rw);
}

DEVICE stretching_stiffness material_stretching(GLOBAL const stretching_stiffness *table, GLOBAL const int *table_start,
                                                triangle_rest rest, green_strain g)
{
  int start = table_start[rest.material]; /* < 0: the constant stiffness at -1 - start */
  if (start < 0) return table[-1 - start];
  return sample_stretching(table + start, g.e00, g.e11, g.e01);
}

/* Forces [3 n] and matrix factors [n] of all triangles. material_scale [materials] = step (step + damping), s^2.
   Geometric terms are not damped: they turn forces with the cloth, and their damping would brake its rotation. */
KERNEL evaluate_triangles(int n, GLOBAL const triangle_rest *rest, GLOBAL const stretching_stiffness *table,
                          GLOBAL const int *table_start, GLOBAL const real *material_scale, real step,
                          GLOBAL const dvec3 *position, GLOBAL triangle_factor *factor, GLOBAL vec3 *force)
{
  FOR_EACH(i, n) {
    triangle_rest r = rest[i];
    dvec3 x0 = position[r.node[0]];
    green_strain g = triangle_strain(r, to_vec3(dsub(position[r.node[1]], x0)), to_vec3(dsub(position[r.node[2]], x0)));
    stretching_stiffness k = material_stretching(table, table_start, r, g);
    vec3 f1, f2;
    triangle_forces(r, g, k, &f1, &f2);
    factor[i] = make_triangle_factor(r, g, k, material_scale[r.material], step * step);
    force[3 * i] = scale((real)-1, add(f1, f2));
    force[3 * i + 1] = f1;
    force[3 * i + 2] = f2;
  }
}

/* What the strain x beyond a limit adds, in parts of its stiffness: the slope rises from 0 at 0 to 1 at w, so that it
   has no jump. */
DEVICE real limit_slope(real x, real w) { return clamp_real(x / w, (real)0, (real)1); }
DEVICE real limit_stress(real x, real w)
{
  return x <= (real)0 ? (real)0 : x < w ? (real)0.5 * x * x / w : x - (real)0.5 * w;
}
DEVICE real limit_energy(real x, real w)
{
  const real y = x - (real)0.5 * w;
  return x <= (real)0 ? (real)0 : x < w ? x * x * x / ((real)6 * w) : (real)0.5 * y * y + w * w / (real)24;
}

/* Adds what triangles near or beyond the strain limit [materials] of their material have more of force [3 n] and of the
   matrix. The slope in the matrix is that of the strain plus the width of its rise: a step that ends beyond the limit
   must not be computed with the stiffness below it, or it swings across the limit for ever. Warp and weft have a limit
   where they are longer; the coupling of both has none. */
KERNEL limit_strain(int n, GLOBAL const triangle_rest *rest, GLOBAL const stretching_stiffness *table,
                    GLOBAL const int *table_start, GLOBAL const strain_limit *limit, GLOBAL const real *material_scale,
                    real step, GLOBAL const dvec3 *position, GLOBAL triangle_factor *factor, GLOBAL vec3 *force)
{
  FOR_EACH(i, n) {
    triangle_rest r = rest[i];
    strain_limit most = limit[r.material];
    dvec3 x0 = position[r.node[0]];
    green_strain g, more;
    stretching_stiffness k;
    triangle_factor t;
    real w, x[3], scaled, geometric;
    vec3 f1, f2;
    if (!(most.strain > (real)0)) continue;
    g = triangle_strain(r, to_vec3(dsub(position[r.node[1]], x0)), to_vec3(dsub(position[r.node[2]], x0)));
    w = LIMIT_RISE * most.strain;
    x[0] = g.e00 - most.strain;
    x[1] = g.e11 - most.strain;
    x[2] = (g.e01 < (real)0 ? -g.e01 : g.e01) - most.strain;
    if (x[0] <= -w && x[1] <= -w && x[2] <= -w) continue;
    k = material_stretching(table, table_start, r, g);
    k.k[0] *= most.factor;
    k.k[1] = (real)0;
    k.k[2] *= most.factor;
    k.k[3] *= most.factor;
    more = g;
    more.e00 = limit_stress(x[0], w);
    more.e11 = limit_stress(x[1], w);
    more.e01 = limit_stress(x[2], w) * (g.e01 < (real)0 ? (real)-1 : (real)1);
    triangle_forces(r, more, k, &f1, &f2);
    t = factor[i];
    scaled = r.area * material_scale[r.material];
    geometric = r.area * step * step;
    t.k[0] += scaled * k.k[0] * limit_slope(x[0] + w, w);
    t.k[2] += scaled * k.k[2] * limit_slope(x[1] + w, w);
    t.k[3] += scaled * k.k[3] * limit_slope(x[2] + w, w);
    t.e0 += geometric * k.k[0] * more.e00;
    t.e1 += geometric * k.k[2] * more.e11;
    factor[i] = t;
    force[3 * i] = axpy(force[3 * i], (real)-1, add(f1, f2));
    force[3 * i + 1] = add(force[3 * i + 1], f1);
    force[3 * i + 2] = add(force[3 * i + 2], f2);
  }
}

/* Adds the energy beyond the limits to that of all triangles [n], J. */
KERNEL measure_limits(int n, GLOBAL const triangle_rest *rest, GLOBAL const stretching_stiffness *table,
                      GLOBAL const int *table_start, GLOBAL const strain_limit *limit, GLOBAL const dvec3 *position,
                      GLOBAL double *energy)
{
  FOR_EACH(i, n) {
    triangle_rest r = rest[i];
    strain_limit most = limit[r.material];
    dvec3 x0 = position[r.node[0]];
    green_strain g;
    stretching_stiffness k;
    real w = LIMIT_RISE * most.strain;
    if (!(most.strain > (real)0)) continue;
    g = triangle_strain(r, to_vec3(dsub(position[r.node[1]], x0)), to_vec3(dsub(position[r.node[2]], x0)));
    k = material_stretching(table, table_start, r, g);
    energy[i] +=
        (double)(r.area * most.factor *
                 (k.k[0] * limit_energy(g.e00 - most.strain, w) + k.k[2] * limit_energy(g.e11 - most.strain, w) +
                  (real)2 * k.k[3] * limit_energy((g.e01 < (real)0 ? -g.e01 : g.e01) - most.strain, w)));
  }
}

/* Energy [n], J, and largest principal stretch minus one [n] of all triangles. */
KERNEL measure_triangles(int n, GLOBAL const triangle_rest *rest, GLOBAL const stretching_stiffness *table,
                         GLOBAL const int *table_start, GLOBAL const dvec3 *position, GLOBAL double *energy,
                         GLOBAL double *strain)
{
  FOR_EACH(i, n) {
    triangle_rest r = rest[i];
    dvec3 x0 = position[r.node[0]];
    green_strain g = triangle_strain(r, to_vec3(dsub(position[r.node[1]], x0)), to_vec3(dsub(position[r.node[2]], x0)));
    real half_sum = (real)0.5 * (g.e00 + g.e11), half_difference = (real)0.5 * (g.e00 - g.e11);
    real largest = half_sum + (real)sqrt(half_difference * half_difference + g.e01 * g.e01);
    energy[i] = (double)(r.area * stretching_energy(g, material_stretching(table, table_start, r, g)));
    strain[i] = sqrt(max_double((double)((real)2 * largest + (real)1), 0.0)) - 1.0;
  }
}

#endif
