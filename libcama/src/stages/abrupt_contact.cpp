// SPDX-License-Identifier: Apache-2.0
#include "stages/abrupt_contact.hpp"

#include "device/launch.hpp"

namespace cama {

template <class Real> void SplitContact<Real>::run_on(const Rooms &state)
{
  Backend &b = *state.backend;
  System<Real> &s = state.system.template of<Real>();
  MeshState &mesh = state.mesh;
  const Incidence &incidence = state.system.term_incidence;
  const int rows = mesh.cloth_vertices, contacts = state.time.multistep ? state.contact.contacts : 0;
  // A single solve has friction of pinned vertices in the blocks of a matrix that is not gathered.
  const bool rough = state.contact.friction &&
                     (state.options.newton_iterations > 1 || state.options.paper.assembly == Assembly::gather);
  Stream<dvec3> &abrupt = state.contact.abrupt;
  abrupt.resize(contacts);
  mesh.abrupt_change.resize(contacts ? rows : 0);
  if (contacts == 0) return;
  push_.resize(contacts);
  load_.resize(rows);
  CAMA_LAUNCH_REAL(Real, b, contact_pushes, contacts, state.options.newton_iterations > 1 ? 1 : 0, s.term, s.solution,
                   push_);
  CAMA_LAUNCH_REAL(Real, b, push_loads, rows, contacts, incidence.row, incidence.entry, s.term, push_, load_);
  CAMA_LAUNCH_REAL(Real, b, abrupt_impulses, contacts, state.time.implicit_step / state.time.step, rows, rough ? 1 : 0,
                   state.rigid.vertex, state.contact.contact, mesh.inverse_mass, push_, load_, mesh.velocity,
                   mesh.velocity_next, s.term, s.hold, abrupt);
  CAMA_LAUNCH_REAL(Real, b, abrupt_changes, rows, contacts, incidence.row, incidence.entry, s.term, mesh.inverse_mass,
                   abrupt, mesh.abrupt_change);
}

template class SplitContact<double>;
template class SplitContact<float>;

}  // namespace cama
