/* SPDX-License-Identifier: Apache-2.0 */
/* Double-double numbers: unevaluated sums hi + lo with |lo| <= ulp(hi) / 2, about 106 bits (Dekker 1971; Hida, Li and
   Bailey 2001). */
#ifndef CAMA_KERNELS_DIALECT_DOUBLE_DOUBLE_H
#define CAMA_KERNELS_DIALECT_DOUBLE_DOUBLE_H
#include "dvec3.h"
#include "lang.h"

typedef struct {
  double hi, lo;
} double_double;
typedef struct {
  double_double x, y, z;
} double_double3;

/* |a| >= |b| */
DEVICE double_double dd_fast_sum(double a, double b)
{
  double_double r;
  r.hi = a + b;
  r.lo = b - (r.hi - a);
  return r;
}
DEVICE double_double dd_sum(double a, double b)   /* exact */
{
  double_double r;
  double t;
  r.hi = a + b;
  t = r.hi - a;
  r.lo = (a - (r.hi - t)) + (b - t);
  return r;
}
DEVICE double_double dd_make(double a)
{
  double_double r;
  r.hi = a;
  r.lo = 0.0;
  return r;
}
DEVICE double_double dd_add(double_double a, double_double b)
{
  double_double s = dd_sum(a.hi, b.hi), t = dd_sum(a.lo, b.lo);
  s = dd_fast_sum(s.hi, s.lo + t.hi);
  return dd_fast_sum(s.hi, s.lo + t.lo);
}
DEVICE double_double dd_negate(double_double a)
{
  a.hi = -a.hi;
  a.lo = -a.lo;
  return a;
}
DEVICE double_double dd_subtract(double_double a, double_double b) { return dd_add(a, dd_negate(b)); }
DEVICE double_double dd_multiply(double_double a, double_double b)
{
  double p = a.hi * b.hi, e = fma(a.hi, b.hi, -p);
  return dd_fast_sum(p, e + (a.hi * b.lo + a.lo * b.hi));
}
DEVICE int dd_less(double_double a, double_double b) { return a.hi < b.hi || (a.hi == b.hi && a.lo < b.lo); }

DEVICE double_double3 dd3_make(double_double x, double_double y, double_double z)
{
  double_double3 r;
  r.x = x;
  r.y = y;
  r.z = z;
  return r;
}
/* a - b, exact */
DEVICE double_double3 dd3_difference(dvec3 a, dvec3 b)
{
  return dd3_make(dd_sum(a.x, -b.x), dd_sum(a.y, -b.y), dd_sum(a.z, -b.z));
}
DEVICE double_double3 dd3_subtract(double_double3 a, double_double3 b)
{
  return dd3_make(dd_subtract(a.x, b.x), dd_subtract(a.y, b.y), dd_subtract(a.z, b.z));
}
/* a + s b */
DEVICE double_double3 dd3_axpy(double_double3 a, double_double s, double_double3 b)
{
  return dd3_make(dd_add(a.x, dd_multiply(s, b.x)), dd_add(a.y, dd_multiply(s, b.y)), dd_add(a.z, dd_multiply(s, b.z)));
}
DEVICE double_double dd3_dot(double_double3 a, double_double3 b)
{
  return dd_add(dd_add(dd_multiply(a.x, b.x), dd_multiply(a.y, b.y)), dd_multiply(a.z, b.z));
}
DEVICE double_double3 dd3_cross(double_double3 a, double_double3 b)
{
  return dd3_make(dd_subtract(dd_multiply(a.y, b.z), dd_multiply(a.z, b.y)),
                  dd_subtract(dd_multiply(a.z, b.x), dd_multiply(a.x, b.z)),
                  dd_subtract(dd_multiply(a.x, b.y), dd_multiply(a.y, b.x)));
}
DEVICE dvec3 dd3_rounded(double_double3 a) { return dvec3_make(a.x.hi, a.y.hi, a.z.hi); }

#endif
