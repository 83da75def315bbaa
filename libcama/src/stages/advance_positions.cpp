// SPDX-License-Identifier: Apache-2.0
#include "stages/advance_positions.hpp"

#include "device/launch.hpp"

namespace cama {
void AdvancePositions::run_on(const Rooms &state)
{
  CAMA_LAUNCH(*state.backend, advance, state.mesh.cloth_vertices, state.time.implicit_step, state.mesh.fixed,
              state.mesh.velocity_next, state.mesh.base_position(state.time), state.mesh.position_next);
}

}  // namespace cama
