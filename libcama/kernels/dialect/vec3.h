/* SPDX-License-Identifier: Apache-2.0 */
/* Vectors and 3x3 matrices in the working precision. */
#ifndef CAMA_KERNELS_DIALECT_VEC3_H
#define CAMA_KERNELS_DIALECT_VEC3_H
#include "dvec3.h"
#include "lang.h"
#include "working_precision.h"

typedef struct {
  real x, y, z;
} vec3;
typedef struct {
  vec3 row[3];
} mat3;

DEVICE vec3 vec3_make(real x, real y, real z)
{
  vec3 r;
  r.x = x;
  r.y = y;
  r.z = z;
  return r;
}
DEVICE real component(vec3 a, int c) { return c == 0 ? a.x : c == 1 ? a.y : a.z; }
DEVICE vec3 to_vec3(dvec3 a) { return vec3_make((real)a.x, (real)a.y, (real)a.z); }
DEVICE dvec3 to_dvec3(vec3 a) { return dvec3_make((double)a.x, (double)a.y, (double)a.z); }
DEVICE vec3 add(vec3 a, vec3 b) { return vec3_make(a.x + b.x, a.y + b.y, a.z + b.z); }
DEVICE vec3 sub(vec3 a, vec3 b) { return vec3_make(a.x - b.x, a.y - b.y, a.z - b.z); }
DEVICE vec3 scale(real s, vec3 a) { return vec3_make(s * a.x, s * a.y, s * a.z); }
/* a + s b */
DEVICE vec3 axpy(vec3 a, real s, vec3 b) { return vec3_make(a.x + s * b.x, a.y + s * b.y, a.z + s * b.z); }
DEVICE real dot(vec3 a, vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
DEVICE vec3 cross(vec3 a, vec3 b)
{
  return vec3_make(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
DEVICE real norm(vec3 a) { return (real)sqrt(dot(a, a)); }
DEVICE real min_real(real a, real b) { return a < b ? a : b; }
DEVICE real max_real(real a, real b) { return a > b ? a : b; }
DEVICE real clamp_real(real x, real lo, real hi) { return min_real(max_real(x, lo), hi); }

DEVICE mat3 mat3_zero(void)
{
  mat3 m;
  m.row[0] = vec3_make((real)0, (real)0, (real)0);
  m.row[1] = m.row[0];
  m.row[2] = m.row[0];
  return m;
}
DEVICE mat3 mat3_diagonal(real d)
{
  mat3 m = mat3_zero();
  m.row[0].x = d;
  m.row[1].y = d;
  m.row[2].z = d;
  return m;
}
/* m + s a b' */
DEVICE mat3 mat3_add_outer(mat3 m, real s, vec3 a, vec3 b)
{
  m.row[0] = axpy(m.row[0], s * a.x, b);
  m.row[1] = axpy(m.row[1], s * a.y, b);
  m.row[2] = axpy(m.row[2], s * a.z, b);
  return m;
}
DEVICE mat3 mat3_add(mat3 a, mat3 b)
{
  a.row[0] = add(a.row[0], b.row[0]);
  a.row[1] = add(a.row[1], b.row[1]);
  a.row[2] = add(a.row[2], b.row[2]);
  return a;
}
DEVICE vec3 mat3_multiply(mat3 m, vec3 a) { return vec3_make(dot(m.row[0], a), dot(m.row[1], a), dot(m.row[2], a)); }
/* Inverse of a symmetric positive definite block: Cholesky of the diagonally scaled block, inverse as the Gram matrix
   of L^-1, which stays positive definite where cofactors would not. Pivots are kept above rounding. */
DEVICE mat3 mat3_inverse_spd(mat3 m)
{
  const real least = sizeof(real) == 8 ? (real)1e-14 : (real)1e-6;
  real sx = (real)1 / (real)sqrt(m.row[0].x), sy = (real)1 / (real)sqrt(m.row[1].y),
       sz = (real)1 / (real)sqrt(m.row[2].z);
  real xy = m.row[0].y * sx * sy, xz = m.row[0].z * sx * sz, yz = m.row[1].z * sy * sz;
  real l22 = (real)sqrt(max_real((real)1 - xy * xy, least)), l32 = (yz - xy * xz) / l22;
  real l33 = (real)sqrt(max_real((real)1 - xz * xz - l32 * l32, least));
  real g21 = -xy / l22, g22 = (real)1 / l22;
  real g31 = -(xz + l32 * g21) / l33, g32 = -l32 * g22 / l33, g33 = (real)1 / l33;
  real ixx = (real)1 + g21 * g21 + g31 * g31, iyy = g22 * g22 + g32 * g32, izz = g33 * g33;
  real ixy = g21 * g22 + g31 * g32, ixz = g31 * g33, iyz = g32 * g33;
  mat3 r;
  r.row[0] = vec3_make(sx * sx * ixx, sx * sy * ixy, sx * sz * ixz);
  r.row[1] = vec3_make(sx * sy * ixy, sy * sy * iyy, sy * sz * iyz);
  r.row[2] = vec3_make(sx * sz * ixz, sy * sz * iyz, sz * sz * izz);
  return r;
}

/* atan(x) for |x| <= tan(pi/16), Taylor series to x^21: error below 2e-18 */
DEVICE real atan_small(real x)
{
  real s = x * x, sum = (real)(1.0 / 21.0);
  sum = (real)(1.0 / 19.0) - s * sum;
  sum = (real)(1.0 / 17.0) - s * sum;
  sum = (real)(1.0 / 15.0) - s * sum;
  sum = (real)(1.0 / 13.0) - s * sum;
  sum = (real)(1.0 / 11.0) - s * sum;
  sum = (real)(1.0 / 9.0) - s * sum;
  sum = (real)(1.0 / 7.0) - s * sum;
  sum = (real)(1.0 / 5.0) - s * sum;
  sum = (real)(1.0 / 3.0) - s * sum;
  return x - x * s * sum;
}
/* Angle of (x, y) in [-pi, pi] in plain arithmetic, the same bits on every backend; atan2_plain(0, 0) = 0.
   The argument is halved twice: atan(q) = 2 atan(q / (1 + sqrt(1 + q^2))). */
DEVICE real atan2_plain(real y, real x)
{
  const real half_pi = (real)1.57079632679489661923, pi = (real)3.14159265358979323846;
  real ax = x < (real)0 ? -x : x, ay = y < (real)0 ? -y : y;
  real big = ax > ay ? ax : ay, small = ax > ay ? ay : ax, q, angle;
  if (!(big > (real)0)) return (real)0;
  q = small / big;
  q = q / ((real)1 + (real)sqrt((real)1 + q * q));
  q = q / ((real)1 + (real)sqrt((real)1 + q * q));
  angle = (real)4 * atan_small(q);
  if (ay > ax) angle = half_pi - angle;
  if (x < (real)0) angle = pi - angle;
  return y < (real)0 ? -angle : angle;
}

#endif
