/* SPDX-License-Identifier: Apache-2.0 */
/* Vectors of three doubles: state, collision and certificates are always in double. */
#ifndef CAMA_KERNELS_DIALECT_DVEC3_H
#define CAMA_KERNELS_DIALECT_DVEC3_H
#include "lang.h"

typedef struct {
  double x, y, z;
} dvec3;

DEVICE dvec3 dvec3_make(double x, double y, double z)
{
  dvec3 r;
  r.x = x;
  r.y = y;
  r.z = z;
  return r;
}
DEVICE dvec3 dadd(dvec3 a, dvec3 b) { return dvec3_make(a.x + b.x, a.y + b.y, a.z + b.z); }
DEVICE dvec3 dsub(dvec3 a, dvec3 b) { return dvec3_make(a.x - b.x, a.y - b.y, a.z - b.z); }
DEVICE dvec3 dscale(double s, dvec3 a) { return dvec3_make(s * a.x, s * a.y, s * a.z); }
/* a + s b */
DEVICE dvec3 daxpy(dvec3 a, double s, dvec3 b) { return dvec3_make(a.x + s * b.x, a.y + s * b.y, a.z + s * b.z); }
DEVICE double ddot(dvec3 a, dvec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
DEVICE dvec3 dcross(dvec3 a, dvec3 b)
{
  return dvec3_make(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
DEVICE double dnorm(dvec3 a) { return sqrt(ddot(a, a)); }
/* a / |a|, or zero for the zero vector */
DEVICE dvec3 dnormalize(dvec3 a)
{
  double l = dnorm(a);
  return l > 0.0 ? dscale(1.0 / l, a) : dvec3_make(0.0, 0.0, 0.0);
}
DEVICE dvec3 dlerp(dvec3 a, dvec3 b, double t) { return daxpy(a, t, dsub(b, a)); }
DEVICE double dcomponent(dvec3 a, int axis) { return axis == 0 ? a.x : (axis == 1 ? a.y : a.z); }

#endif
