// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <vector>

#include "cama/rigid.hpp"
#include "cama/stream.hpp"

namespace cama {

/// A body as contacts see it: how its motion changes with impulses.
struct MovableBody {
  double inverse_mass;  // 1/kg
  SymmetricMatrix inverse_inertia;  // 1/(kg m^2)
  dvec3 velocity{0, 0, 0}, spin{0, 0, 0};  // change by the impulses, m/s and rad/s
};

/// A point at which two bodies touch; one of them may be prescribed, with index -1.
struct ContactPoint {
  int a, b;
  dvec3 normal;  // unit, from b to a
  dvec3 lever_a, lever_b;  // from the centres of mass, m
  double friction, static_friction;
  double approach;  // by which the sides may approach each other before impulses act, m/s: above 0 they are apart
  dvec3 slip;  // velocity of a relative to b across the normal before impulses act, m/s

  double press = 0;  // N s along the normal
  dvec3 rub{0, 0, 0};  // N s across it, on a
  bool slides = false;  // friction is that of sliding

  dvec3 impulse() const;  // on a
};

/// Finds the impulses of all points by sweeps (projected Gauss-Seidel), beginning with those that they have: no
/// approach, and Coulomb friction. The changes of the bodies' motion are those of all impulses. `slow`: a speed, m/s,
/// whose millionth does not matter.
void solve_contacts(std::vector<MovableBody> &bodies, std::vector<ContactPoint> &points, double slow);

}  // namespace cama
