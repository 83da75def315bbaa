// SPDX-License-Identifier: Apache-2.0
#include "model/setup_parts.hpp"

#include "model/features.hpp"
#include "model/plate.hpp"

namespace cama {
namespace {

template <class Real>
void set_up_plasticity(State &state, System<Real> &s, const Scene &scene, const Topology &t, const Plate &plate)
{
  using T = Types<Real>;
  Backend &b = *state.backend;
  std::vector<typename T::plastic_material> materials;
  for (const Cloth &c : scene.cloths) materials.push_back({c.material.yield_curvature, c.material.hardening});
  const PlasticPlate plastic = plastic_plate(scene, t, plate);
  std::vector<typename T::plastic_triangle> triangles;
  for (std::size_t f = 0; f < t.triangle.size(); ++f) {
    typename T::plastic_triangle e{};
    e.material = t.triangle[f].material;
    for (int k = 0; k < 3; ++k) {
      e.hinge[k] = plastic.triangle[f].hinge[k];
      for (int c = 0; c < 3; ++c) e.curvature[k][c] = plastic.triangle[f].curvature[k][c];
    }
    triangles.push_back(e);
  }
  std::vector<typename T::plastic_hinge> hinges;
  for (std::size_t i = 0; i < t.hinge.size(); ++i) {
    typename T::plastic_hinge e{};
    e.rest_angle = t.hinge[i].rest_angle;
    for (int k = 0; k < 2; ++k) {
      e.triangle[k] = t.hinge[i].triangle[k];
      for (int c = 0; c < 3; ++c) e.angle[k][c] = plastic.hinge[i].angle[k][c];
    }
    hinges.push_back(e);
  }
  s.plastic_material = Stream<typename T::plastic_material>(b, materials);
  s.plastic_triangle = Stream<typename T::plastic_triangle>(b, triangles);
  s.plastic_hinge = Stream<typename T::plastic_hinge>(b, hinges);
  for (Stream<dvec3> *curvature : {&state.elements.plastic_curvature, &state.elements.plastic_curvature_next}) {
    *curvature = Stream<dvec3>(b, state.mesh.triangles);
    curvature->fill_zero();
  }
}

}  // namespace

template <class Real> void set_up_plate(State &state, System<Real> &s, const Scene &scene, const Topology &t)
{
  using coupling = typename Types<Real>::hinge_coupling;
  Backend &b = *state.backend;
  const Plate plate = couple_hinges(scene, t);
  std::vector<coupling> couplings;
  for (const HingeCoupling &h : plate.hinge) {
    coupling c;
    for (int k = 0; k < 4; ++k) {
      c.neighbour[k] = h.neighbour[k];
      c.coupling[k] = static_cast<Real>(h.coupling[k]);
    }
    c.cloth = h.cloth;
    c.scale = static_cast<Real>(h.scale);
    c.bound = static_cast<Real>(h.bound);
    c.reference = static_cast<Real>(h.reference);
    couplings.push_back(c);
  }
  std::vector<typename Types<Real>::moment_step> steps;
  for (const auto &row : moment_steps(plate.iteration)) {
    for (const MomentStep &step : row)
      steps.push_back({static_cast<Real>(step.momentum), static_cast<Real>(step.share)});
    ++s.moment_iterations;
  }
  --s.moment_iterations;
  s.moment_step = Stream<typename Types<Real>::moment_step>(b, steps);
  s.hinge_coupling = Stream<coupling>(b, couplings);
  for (Stream<Real> *values : {&s.angle_scale, &s.scaled_angle, &s.moment, &s.moment_before})
    *values = Stream<Real>(b, state.mesh.hinges);
  for (Stream<Real> &values : s.moment_next) values = Stream<Real>(b);
  const bool of_rates = state.options.integrator == Integrator::bdf2 || state.options.newton_iterations > 1;
  if (of_rates && has_damping(scene))
    for (Stream<Real> *values : {&s.scaled_rate, &s.rate_moment, &s.rate_moment_before})
      *values = Stream<Real>(b, state.mesh.hinges);
  if (has_yield(scene)) set_up_plasticity(state, s, scene, t, plate);
}

template void set_up_plate<double>(State &, System<double> &, const Scene &, const Topology &);
template void set_up_plate<float>(State &, System<float> &, const Scene &, const Topology &);

}  // namespace cama
