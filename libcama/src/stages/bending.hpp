// SPDX-License-Identifier: Apache-2.0
// Forces and energy of all hinges, by themselves or as a plate's.
#pragma once
#include "model/state.hpp"

namespace cama {

/// Stiffness damping of triangles [3 triangles] and hinges [4 hinges] at these velocities. onto: added to what the
/// forces are.
template <class Real> struct Damping {
  Real step;
  const Stream<dvec3> &velocity;
  bool onto;
  Stream<typename Types<Real>::vec3> &triangle_force, &hinge_force;
};

// Forces and matrix factors of the hinges, in three parts, of which the first two may run beside those of the
// triangles.
/// Matrix factors at these positions, and forces of hinges that bend by themselves.
template <class Real>
void find_angles(Backend &b, const Options &options, System<Real> &s, int hinges, const Stream<dvec3> &position);
/// Rates of the angles, or for hinges that bend by themselves their damping.
template <class Real> void find_rates(Backend &b, System<Real> &s, int hinges, const Damping<Real> &damping);
/// Forces of a plate, and of its damping, if there is any.
template <class Real> void bend(Backend &b, System<Real> &s, int hinges, const Damping<Real> *damping);

/// Scaled angles, their scales and the moments of the plate at these positions; overwrites the matrix factors.
template <class Real> void find_plate_moments(Backend &b, System<Real> &s, int hinges, const Stream<dvec3> &position);

/// Energy [hinges] at these positions, J.
template <class Real>
void measure_bending(Backend &b, const Options &options, System<Real> &s, int hinges, const Stream<dvec3> &position,
                     Stream<double> &energy);

}  // namespace cama
