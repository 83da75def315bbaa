// SPDX-License-Identifier: Apache-2.0
#include "stages/element_forces.hpp"

#include "device/launch.hpp"
#include "model/setup.hpp"
#include "stages/bending.hpp"

namespace cama {

void find_gas(Backend &b, EnclosedGas &gas, const Stream<kernels::element_nodes> &triangles,
              const Stream<dvec3> &position, double time_step)
{
  CAMA_LAUNCH_TEAMS(void, b, measure_volumes, GAS_TEAM, gas.triangle_part.size(), gas.triangle_part, gas.gas, triangles,
                    position, gas.volume);
  CAMA_LAUNCH_TEAMS(void, b, gas_pressures, GAS_TEAM, gas.gas.size(), gas.gas, gas.volume, time_step, gas.state);
}

template <class Real>
EvaluateElements<Real>::EvaluateElements(const Scene &scene)
    : windy_(has_wind(scene)), damped_(has_damping(scene)), mass_damped_(has_mass_damping(scene)),
      air_density_(scene.wind ? scene.wind->density : 0), drag_(scene.wind ? scene.wind->drag : 0)
{}

template <class Real> void EvaluateElements<Real>::run_on(const Rooms &state)
{
  if (state.contact.contacts > 0 && state.time.predicted) begin(state);
  finish(state);
}

template <class Real> void EvaluateElements<Real>::begin(const Rooms &state)
{
  System<Real> &s = state.system.template of<Real>();
  evaluate_linearised(state, state.mesh.position);
  s.start_force.copy_from(s.force);
}

template <class Real> void EvaluateElements<Real>::finish(const Rooms &state)
{
  evaluate_linearised(state, state.mesh.linearised_position(state.time));
}

template <class Real>
void EvaluateElements<Real>::add_wind(const Rooms &state, const Stream<dvec3> &position, const Stream<dvec3> &velocity,
                                      bool limited, Stream<vec3> &force)
{
  CAMA_LAUNCH_REAL(Real, *state.backend, add_wind, state.mesh.triangles, state.system.template of<Real>().triangle_rest,
                   position, velocity, state.elements.wind, state.elements.areal_density,
                   static_cast<Real>(air_density_), static_cast<Real>(drag_), state.options.arcsim_conventions ? 1 : 0,
                   limited ? 1 : 0, static_cast<Real>(state.time.implicit_step), force);
}

template <class Real>
void EvaluateElements<Real>::add_pressure(const Rooms &state, const Stream<dvec3> &position, Stream<vec3> &force)
{
  CAMA_LAUNCH_REAL(Real, *state.backend, add_pressure, state.mesh.triangles,
                   state.system.template of<Real>().triangle_rest, position, state.elements.pressure, force);
}

template <class Real>
void EvaluateElements<Real>::add_gas(const Rooms &state, const Stream<dvec3> &position, Stream<vec3> &force)
{
  System<Real> &s = state.system.template of<Real>();
  find_gas(*state.backend, state.system.gas, state.elements.triangle_nodes, position, state.time.implicit_step);
  CAMA_LAUNCH_REAL(Real, *state.backend, add_gas_pressure, state.mesh.cloth_vertices,
                   state.elements.triangle_incidence.row, state.elements.triangle_incidence.entry, s.triangle_rest,
                   state.system.gas.gas_of, state.system.gas.state, position, s.gas_gradient, force);
}

template <class Real>
void EvaluateElements<Real>::add_mass_damping(const Rooms &state, const Stream<dvec3> &velocity, bool solved,
                                              Stream<vec3> &force)
{
  CAMA_LAUNCH_REAL(Real, *state.backend, damp_vertices, state.mesh.cloth_vertices, solved ? 0 : 1,
                   state.system.template of<Real>().mass_damping, velocity, state.elements.wind, force);
}

template <class Real>
void EvaluateElements<Real>::find_drag(const Rooms &state, const Stream<dvec3> &position, const Stream<dvec3> &velocity,
                                       bool wind)
{
  System<Real> &s = state.system.template of<Real>();
  const Real h = static_cast<Real>(state.time.implicit_step);
  s.drag.resize(wind || mass_damped_ ? state.mesh.cloth_vertices : 0);
  if (wind)
    CAMA_LAUNCH_REAL(Real, *state.backend, wind_drag, state.mesh.cloth_vertices, state.elements.triangle_incidence.row,
                     state.elements.triangle_incidence.entry, s.triangle_rest, position, velocity, state.elements.wind,
                     static_cast<Real>(air_density_), static_cast<Real>(drag_),
                     state.options.arcsim_conventions ? 1 : 0, h, s.drag);
  if (mass_damped_)
    CAMA_LAUNCH_REAL(Real, *state.backend, mass_damping_drag, state.mesh.cloth_vertices, wind ? 1 : 0, h,
                     s.mass_damping, s.drag);
}

template <class Real>
void EvaluateElements<Real>::evaluate_elements(const Rooms &state, const Stream<dvec3> &position,
                                               const Damping<Real> *damping)
{
  Backend &b = *state.backend;
  System<Real> &s = state.system.template of<Real>();
  const Real h = static_cast<Real>(state.time.implicit_step);
  const int hinges = state.mesh.hinges;
  {
    const SideBySide side_by_side(b);
    CAMA_LAUNCH_REAL(Real, b, evaluate_triangles, state.mesh.triangles, s.triangle_rest, s.stretching_table,
                     s.stretching_start, s.material_scale, h, position, s.triangle_factor, s.triangle_force);
    if (hinges) find_angles(b, state.options, s, hinges, position);
  }
  if (s.strain_limit.size())
    CAMA_LAUNCH_REAL(Real, b, limit_strain, state.mesh.triangles, s.triangle_rest, s.stretching_table,
                     s.stretching_start, s.strain_limit, s.material_scale, h, position, s.triangle_factor,
                     s.triangle_force);
  if (damping) {
    const SideBySide side_by_side(b);
    CAMA_LAUNCH_REAL(Real, b, damp_triangles, state.mesh.triangles, s.triangle_rest, s.triangle_factor,
                     s.material_scale, damping->step, damping->velocity, damping->onto ? 1 : 0,
                     damping->triangle_force);
    if (hinges) find_rates(b, s, hinges, *damping);
  }
  if (hinges) bend(b, s, hinges, damping);
}

template <class Real> void EvaluateElements<Real>::gather(const Rooms &state, Outer *outer)
{
  System<Real> &s = state.system.template of<Real>();
  const bool driven = state.elements.driven_force.size() > 0,
             together = outer && !driven && !inflated(state) && !mass_damped_;
  Stream<vec3> none;
  CAMA_LAUNCH_REAL(Real, *state.backend, gather_forces, state.mesh.cloth_vertices,
                   state.elements.triangle_incidence.row, state.elements.triangle_incidence.entry, s.triangle_force,
                   state.elements.hinge_incidence.row, state.elements.hinge_incidence.entry, s.hinge_force,
                   state.mesh.hinges, s.mass, state.elements.gravity, s.force, together ? 1 : 0,
                   outer ? outer->triangle : none, outer ? outer->hinge : none, outer ? outer->force : none);
  if (driven)
    CAMA_LAUNCH_REAL(Real, *state.backend, add_driven_forces, state.mesh.cloth_vertices, state.elements.driven_force,
                     s.force);
}

template <class Real>
void EvaluateElements<Real>::evaluate(const Rooms &state, const Stream<dvec3> &position, const Stream<dvec3> &velocity,
                                      Outer &outer)
{
  System<Real> &s = state.system.template of<Real>();
  const bool pushed = this->pushed(state);
  if (pushed) {
    outer.triangle.resize(3 * state.mesh.triangles);
    outer.hinge.resize(4 * state.mesh.hinges);
    outer.force.resize(state.mesh.cloth_vertices);
    if (!damped_) {
      outer.triangle.fill_zero();
      outer.hinge.fill_zero();
    }
  }
  const Damping<Real> damping{static_cast<Real>(state.time.implicit_step), velocity, false, outer.triangle,
                              outer.hinge};
  evaluate_elements(state, position, damped_ ? &damping : nullptr);
  if (windy_) add_wind(state, position, velocity, false, outer.triangle);
  if (pressed(state)) add_pressure(state, position, outer.triangle);
  gather(state, pushed ? &outer : nullptr);
  if (!pushed) return;
  if (inflated(state)) add_gas(state, position, outer.force);
  if (mass_damped_) add_mass_damping(state, velocity, false, outer.force);
  if (inflated(state) || mass_damped_ || state.elements.driven_force.size() > 0)
    CAMA_LAUNCH_REAL(Real, *state.backend, add_forces, state.mesh.cloth_vertices, outer.force, s.force);
}

template <class Real>
void EvaluateElements<Real>::evaluate_linearised(const Rooms &state, const Stream<dvec3> &position)
{
  System<Real> &s = state.system.template of<Real>();
  const bool predicted = state.time.predicted;
  const Stream<dvec3> &velocity = predicted ? state.mesh.velocity_next : state.mesh.base_velocity(state.time);
  const Damping<Real> damping{static_cast<Real>(state.time.implicit_step), velocity, true, s.triangle_force,
                              s.hinge_force};
  evaluate_elements(state, position, damped_ && predicted ? &damping : nullptr);
  if (windy_) add_wind(state, position, velocity, !predicted, s.triangle_force);
  if (pressed(state)) add_pressure(state, position, s.triangle_force);
  if (windy_ || mass_damped_) find_drag(state, position, velocity, windy_ && predicted);
  gather(state, nullptr);
  if (inflated(state)) add_gas(state, position, s.force);
  if (mass_damped_) add_mass_damping(state, velocity, !predicted, s.force);
}

template class EvaluateElements<double>;
template class EvaluateElements<float>;

}  // namespace cama
