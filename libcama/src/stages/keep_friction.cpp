// SPDX-License-Identifier: Apache-2.0
#include "stages/keep_friction.hpp"

#include "device/launch.hpp"

namespace cama {

template <class Real> void KeepFriction<Real>::run_on(const Rooms &state)
{
  const System<Real> &s = state.system.template of<Real>();
  state.contact.kept_next.force.resize(state.contact.contacts);
  CAMA_LAUNCH_REAL(Real, *state.backend, keep_friction, state.contact.contacts, state.contact.contact, s.term, s.hold,
                   state.mesh.velocity_next, state.time.implicit_step, state.contact.kept_next.force);
}

template class KeepFriction<double>;
template class KeepFriction<float>;

}  // namespace cama
