// SPDX-License-Identifier: Apache-2.0
#include "stages/contact_terms.hpp"

#include "device/launch.hpp"

namespace cama {
template <class Real> void EvaluateTerms<Real>::expect_friction(const Rooms &state)
{
  Backend &b = *state.backend;
  System<Real> &s = state.system.template of<Real>();
  const int contacts = state.contact.contacts;
  const double carry = state.time.multistep ? state.time.ratio / state.time.memory : 0;  // v* - v to the next change
  KeptFriction &kept = state.contact.kept, &next = state.contact.kept_next;
  next.force.resize(contacts);
  push_.resize(state.mesh.cloth_vertices);
  CAMA_LAUNCH(b, vertex_pushes, state.mesh.cloth_vertices, contacts, state.system.term_incidence.row,
              state.system.term_incidence.entry, state.contact.contact, push_);
  if (state.elements.stitches) s.hold.fill_zero();
  CAMA_LAUNCH_REAL(Real, b, recall_friction, contacts, kept.key.size(), state.mesh.face, next.key, kept.key, kept.force,
                   next.force);
  CAMA_LAUNCH_REAL(Real, b, expect_friction, contacts, state.options.newton_iterations > 1 ? 1 : 0,
                   state.contact.contact, state.mesh.inverse_mass, state.mesh.velocity,
                   state.mesh.base_velocity(state.time), carry, free_velocity_, load_, push_, next.force,
                   static_cast<Real>(state.time.implicit_step), s.term, s.hold);
}

template <class Real> void EvaluateTerms<Real>::run_on(const Rooms &state)
{
  Backend &b = *state.backend;
  System<Real> &s = state.system.template of<Real>();
  const Real dt = static_cast<Real>(state.time.implicit_step);
  state.system.terms = state.contact.contacts + state.elements.stitches;
  s.term.resize(state.system.terms);
  if (s.hold.backend()) s.hold.resize(state.contact.contacts ? state.system.terms : 0);
  state.system.term_nodes.resize(state.system.terms);
  if (state.system.terms == 0) return;
  // Of the predicted state the forces between stiff neighbours would tell what presses and what slides.
  const auto &force = state.time.predicted ? s.start_force : s.force;
  CAMA_LAUNCH(b, contact_nodes, state.contact.contacts, state.contact.contact, state.system.term_nodes);
  CAMA_LAUNCH(b, stitch_nodes, state.elements.stitches, state.elements.stitch, state.contact.contacts,
              state.system.term_nodes);
  count_.resize(state.mesh.cloth_vertices);
  state.system.term_incidence.rebuild(b, state.system.term_nodes, state.system.terms, count_);
  if (state.options.paper.contact_form == ContactForm::rank_one)
    CAMA_LAUNCH_REAL(Real, b, stiffen_contacts, state.contact.contacts, state.mesh.cloth_vertices,
                     state.mesh.inverse_mass, force, state.contact.contact);
  const bool remembers = state.contact.kept.key.backend();
  if (!state.contact.friction || remembers)
    CAMA_LAUNCH_REAL(Real, b, make_frictionless_terms, state.contact.contacts, state.contact.contact, dt, s.term);
  if (state.contact.friction && state.contact.contacts) {
    load_.resize(state.mesh.cloth_vertices);
    CAMA_LAUNCH(b, vertex_loads, state.mesh.cloth_vertices, state.contact.contacts, state.system.term_incidence.row,
                state.system.term_incidence.entry, state.contact.contact, load_);
    free_velocity_.resize(state.mesh.vertices);
    CAMA_LAUNCH_REAL(Real, b, free_velocities, state.mesh.vertices, state.mesh.cloth_vertices, dt, s.mass,
                     state.mesh.fixed, state.mesh.base_velocity(state.time), state.mesh.velocity_next, force,
                     free_velocity_);
    if (remembers)
      expect_friction(state);
    else
      CAMA_LAUNCH_REAL(Real, b, make_contact_terms, state.contact.contacts, state.contact.contact,
                       state.mesh.inverse_mass, free_velocity_, load_, dt, s.term);
  }
  const Stream<dvec3> &at = state.mesh.linearised_position(state.time);
  if (state.time.predicted)
    CAMA_LAUNCH_REAL(Real, b, update_contact_terms, state.contact.contacts, 1, 0, 1, state.contact.contact,
                     state.mesh.position, at, state.mesh.velocity_next, state.mesh.inverse_mass,
                     state.contact.vertex_contact, dt, s.term);
  CAMA_LAUNCH_REAL(Real, b, make_stitch_terms, state.elements.stitches, state.elements.stitch, at, dt,
                   state.contact.contacts, s.term);
}

template class EvaluateTerms<double>;
template class EvaluateTerms<float>;

}  // namespace cama
