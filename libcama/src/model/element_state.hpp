// SPDX-License-Identifier: Apache-2.0
// Room of the state: what acts on cloth without contact.
#pragma once
#include <vector>

#include "cama/stream.hpp"
#include "device/kernels.hpp"
#include "model/incidence.hpp"
#include "model/life.hpp"

namespace cama {

/// What acts on cloth without contact: elasticity, stitches, gravity, wind.
struct ElementState {
  Stream<kernels::element_nodes> triangle_nodes, hinge_nodes;
  Incidence triangle_incidence, hinge_incidence;
  int stitches = 0;
  Stream<kernels::stitch> stitch;
  Stream<dvec3> gravity, wind;  // [1] m/s^2, m/s; wind: with wind or mass damping, the velocity of the air
  Stream<double> areal_density;  // [cloths] kg/m^2, with wind
  Stream<double> pressure;  // [cloths] Pa, where the scene or a driver gives one
  Stream<dvec3> driven_force;  // [cloth vertices] N, once a driver has set one
  std::vector<double> damping;  // [cloths], s
  // [triangles] (11, 22, 2 12) 1/m, with a yield curvature: at the start of the step and at its end
  Stream<dvec3> plastic_curvature, plastic_curvature_next;

  template <class F> void visit(F &&f)
  {
    f("triangle_nodes", Life::scene, triangle_nodes);
    f("hinge_nodes", Life::scene, hinge_nodes);
    f("triangle_incidence.row", Life::scene, triangle_incidence.row);
    f("triangle_incidence.entry", Life::scene, triangle_incidence.entry);
    f("hinge_incidence.row", Life::scene, hinge_incidence.row);
    f("hinge_incidence.entry", Life::scene, hinge_incidence.entry);
    f("stitch", Life::scene, stitch);
    f("gravity", Life::scene, gravity);
    f("wind", Life::scene, wind);
    f("areal_density", Life::scene, areal_density);
    f("pressure", Life::scene, pressure);
    f("driven_force", Life::scene, driven_force);
    f("plastic_curvature", Life::run, plastic_curvature);
    f("plastic_curvature_next", Life::step, plastic_curvature_next);
  }
};

}  // namespace cama
