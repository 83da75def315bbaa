// SPDX-License-Identifier: Apache-2.0
#include "device/launch.hpp"
#include "model/setup.hpp"
#include "stages/matrix_assembly.hpp"

namespace cama {

template <class Real>
EvaluateElements<Real>::EvaluateElements(const Scene &scene)
    : windy_(has_wind(scene)), air_density_(scene.wind ? scene.wind->density : 0),
      drag_(scene.wind ? scene.wind->drag : 0)
{}

template <class Real> void EvaluateElements<Real>::run(State &state) { evaluate(state, state.base_position(), true); }

template <class Real>
void EvaluateElements<Real>::add_wind(State &state, const Stream<dvec3> &position, const Stream<dvec3> &velocity,
                                      Stream<vec3> &force)
{
  CAMA_LAUNCH_REAL(Real, *state.backend, add_wind, state.triangles, state.system<Real>().triangle_rest, position,
                   velocity, state.wind, state.areal_density, static_cast<Real>(air_density_), static_cast<Real>(drag_),
                   state.options.arcsim_conventions ? 1 : 0, static_cast<Real>(state.implicit_step), force);
}

template <class Real> void EvaluateElements<Real>::evaluate(State &state, const Stream<dvec3> &position, bool with_wind)
{
  Backend &b = *state.backend;
  System<Real> &s = state.system<Real>();
  CAMA_LAUNCH_REAL(Real, b, evaluate_triangles, state.triangles, s.triangle_rest, s.stretching_table,
                   s.stretching_start, s.material_scale, position, s.triangle_factor, s.triangle_force);
  if (windy_ && with_wind) add_wind(state, position, state.base_velocity(), s.triangle_force);
  if (state.hinges)
    CAMA_LAUNCH_REAL(Real, b, evaluate_hinges, state.hinges, s.hinge_rest, s.bending_table, s.material_scale,
                     state.options.arcsim_conventions ? 1 : 0, position, s.hinge_factor, s.hinge_force);
  CAMA_LAUNCH_REAL(Real, b, gather_forces, state.cloth_vertices, state.triangle_incidence.row,
                   state.triangle_incidence.entry, s.triangle_force, state.hinge_incidence.row,
                   state.hinge_incidence.entry, s.hinge_force, state.hinges, s.mass, state.gravity, s.force);
}

template <class Real> void EvaluateTerms<Real>::run(State &state)
{
  Backend &b = *state.backend;
  System<Real> &s = state.system<Real>();
  const Real dt = static_cast<Real>(state.implicit_step);
  state.terms = state.contacts + state.stitches;
  s.term.resize(state.terms);
  state.term_nodes.resize(state.terms);
  if (state.terms == 0) return;
  CAMA_LAUNCH(b, contact_nodes, state.contacts, state.contact, state.term_nodes);
  CAMA_LAUNCH(b, stitch_nodes, state.stitches, state.stitch, state.contacts, state.term_nodes);
  count_.resize(state.cloth_vertices);
  state.term_incidence.rebuild(b, state.term_nodes, state.terms, count_);
  if (state.options.contact_form == ContactForm::rank_one)
    CAMA_LAUNCH_REAL(Real, b, stiffen_contacts, state.contacts, state.cloth_vertices, state.inverse_mass, s.force,
                     state.contact);
  if (!state.friction) {
    CAMA_LAUNCH_REAL(Real, b, make_frictionless_terms, state.contacts, state.contact, dt, s.term);
  } else if (state.contacts) {
    load_.resize(state.cloth_vertices);
    CAMA_LAUNCH(b, vertex_loads, state.cloth_vertices, state.contacts, state.term_incidence.row,
                state.term_incidence.entry, state.contact, load_);
    free_velocity_.resize(state.vertices);
    CAMA_LAUNCH_REAL(Real, b, free_velocities, state.vertices, state.cloth_vertices, dt, s.mass, state.fixed,
                     state.base_velocity(), state.velocity_next, s.force, free_velocity_);
    CAMA_LAUNCH_REAL(Real, b, make_contact_terms, state.contacts, state.contact, state.inverse_mass, free_velocity_,
                     load_, dt, s.term);
    if (state.multistep)
      CAMA_LAUNCH_REAL(Real, b, shift_contact_terms, state.contacts, state.contact, state.position, state.position_base,
                       dt, s.term);
  }
  CAMA_LAUNCH_REAL(Real, b, make_stitch_terms, state.stitches, state.stitch, state.base_position(), dt, state.contacts,
                   s.term);
}

template class EvaluateElements<double>;
template class EvaluateElements<float>;
template class EvaluateTerms<double>;
template class EvaluateTerms<float>;

}  // namespace cama
