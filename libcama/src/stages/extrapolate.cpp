// SPDX-License-Identifier: Apache-2.0
#include "stages/extrapolate.hpp"

#include "device/launch.hpp"

namespace cama {
void Extrapolate::run_on(const Rooms &state)
{
  state.time.multistep = state.time.history;
  state.time.implicit_step = state.time.multistep ? 2.0 / 3.0 * state.time.step : state.time.step;
  state.system.scale_materials(state.time.implicit_step, state.elements.damping);
  if (!state.time.multistep) return;
  CAMA_LAUNCH(*state.backend, extrapolate_states, state.mesh.vertices, state.mesh.position, state.mesh.position_before,
              state.mesh.position_base);
  CAMA_LAUNCH(*state.backend, extrapolate_states, state.mesh.vertices, state.mesh.velocity, state.mesh.velocity_before,
              state.mesh.velocity_base);
}

void PredictState::run_on(const Rooms &state)
{
  const MeshState &mesh = state.mesh;
  CAMA_LAUNCH(*state.backend, predict_states, mesh.cloth_vertices, state.time.multistep ? 1.0 : 0.0,
              state.time.implicit_step, mesh.fixed, mesh.velocity, mesh.velocity_before, mesh.base_position(state.time),
              state.mesh.velocity_next, state.mesh.position_next);
}

}  // namespace cama
