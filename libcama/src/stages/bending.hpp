// SPDX-License-Identifier: Apache-2.0
// Forces and energy of all hinges, by themselves or as a plate's.
#pragma once
#include "model/state.hpp"

namespace cama {

/// Forces and matrix factors of the hinges at these positions.
template <class Real>
void evaluate_bending(Backend &b, const Options &options, System<Real> &s, int hinges, const Stream<dvec3> &position);

/// Scaled angles, their scales and the moments of the plate at these positions; overwrites the matrix factors.
template <class Real> void find_plate_moments(Backend &b, System<Real> &s, int hinges, const Stream<dvec3> &position);

/// The stiffness damping [4 hinges] at these velocities, with the factors of the last evaluation. onto: added to what
/// `force` is.
template <class Real>
void damp_bending(Backend &b, System<Real> &s, int hinges, Real step, const Stream<dvec3> &velocity, bool onto,
                  Stream<typename Types<Real>::vec3> &force);

/// Energy [hinges] at these positions, J.
template <class Real>
void measure_bending(Backend &b, const Options &options, System<Real> &s, int hinges, const Stream<dvec3> &position,
                     Stream<double> &energy);

}  // namespace cama
