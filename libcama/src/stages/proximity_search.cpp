// SPDX-License-Identifier: Apache-2.0
#include "stages/proximity_search.hpp"

#include "device/launch.hpp"

namespace cama {
void ProximitySearch::run_on(const Rooms &state)
{
  CAMA_LAUNCH(*state.backend, predict_positions, state.mesh.vertices, state.mesh.fixed, state.mesh.position,
              state.mesh.velocity, state.elements.gravity, state.mesh.position_next, state.time.step,
              state.bounds.predicted, state.bounds.uncertain);
  search_.run(state, state.mesh.position, state.bounds.predicted);
}

}  // namespace cama
