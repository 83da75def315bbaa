// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cmath>

#include "cama/types.hpp"

namespace cama {

using Quaternion = std::array<double, 4>;   ///< (w, x, y, z), unit length

inline Quaternion multiply(const Quaternion &a, const Quaternion &b)
{
  return {a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3], a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
          a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1], a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]};
}

inline Quaternion normalized(const Quaternion &q)
{
  const double l = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  return l > 0 ? Quaternion{q[0] / l, q[1] / l, q[2] / l, q[3] / l} : Quaternion{1, 0, 0, 0};
}

inline dvec3 rotate(const Quaternion &q, const dvec3 &x)
{
  const dvec3 v{q[1], q[2], q[3]}, t = kernels::dscale(2, kernels::dcross(v, x));
  return kernels::dadd(kernels::daxpy(x, q[0], t), kernels::dcross(v, t));
}

/// Rotation about an axis of any length by an angle in radians; a zero axis gives the identity.
inline Quaternion axis_angle(const dvec3 &axis, double angle)
{
  const dvec3 n = kernels::dnormalize(axis);
  if (kernels::dnorm(axis) == 0) return {1, 0, 0, 0};
  const double s = std::sin(0.5 * angle);
  return {std::cos(0.5 * angle), s * n.x, s * n.y, s * n.z};
}

/// Spherical interpolation along the shorter arc.
inline Quaternion slerp(const Quaternion &a, Quaternion b, double t)
{
  double c = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
  if (c < 0) {
    c = -c;
    for (double &x : b) x = -x;
  }
  double wa = 1 - t, wb = t;
  if (c < 1 - 1e-9) {
    const double angle = std::acos(c), s = std::sin(angle);
    wa = std::sin((1 - t) * angle) / s;
    wb = std::sin(t * angle) / s;
  }
  return normalized({wa * a[0] + wb * b[0], wa * a[1] + wb * b[1], wa * a[2] + wb * b[2], wa * a[3] + wb * b[3]});
}

}  // namespace cama
