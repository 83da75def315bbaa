// SPDX-License-Identifier: Apache-2.0
#include "stages/extrapolate.hpp"

#include "device/launch.hpp"

namespace cama {
namespace {
constexpr double longest_ratio = 2;  // of one step to the one before; the formula is stable below 1 + sqrt(2)
constexpr double roughest_motion = 0.05;  // of neighbours against each other, of their distance
constexpr int smoothing_sweeps = 60;  // an even number
}  // namespace

void Extrapolate::run_on(const Rooms &state)
{
  Clock &time = state.time;
  const double ratio = time.ratio = time.step / time.step_before;
  time.multistep = time.history && ratio <= longest_ratio;
  time.memory = time.multistep ? ratio * ratio / (1 + 2 * ratio) : 0;
  time.implicit_step = time.multistep ? (1 + ratio) / (1 + 2 * ratio) * time.step : time.step;
  state.system.scale_materials(time.implicit_step, state.elements.damping);
  if (!time.multistep) return;
  CAMA_LAUNCH(*state.backend, extrapolate_states, state.mesh.vertices, time.memory, state.mesh.position,
              state.mesh.position_before, state.mesh.position_base);
  CAMA_LAUNCH(*state.backend, extrapolate_states, state.mesh.vertices, time.memory, state.mesh.velocity,
              state.mesh.velocity_before, state.mesh.velocity_base);
}

void PredictState::run_on(const Rooms &state)
{
  const MeshState &mesh = state.mesh;
  CAMA_LAUNCH(*state.backend, predict_states, mesh.cloth_vertices, state.time.implicit_step, mesh.fixed, mesh.velocity,
              mesh.base_position(state.time), state.mesh.velocity_next, state.mesh.position_next);
  if (state.time.smoothed_steps > 0) smooth(state);
}

void PredictState::smooth(const Rooms &state)
{
  Backend &b = *state.backend;
  const MeshState &mesh = state.mesh;
  const Incidence &incidence = state.elements.triangle_incidence;
  const int n = mesh.cloth_vertices;
  for (Stream<dvec3> &motion : motion_) motion.resize(n);
  CAMA_LAUNCH(b, predicted_motions, n, mesh.position, mesh.position_next, motion_[0]);
  for (int sweep = 0; sweep < smoothing_sweeps; ++sweep)
    CAMA_LAUNCH(b, smooth_motions, n, roughest_motion, mesh.fixed, state.elements.triangle_nodes, incidence.row,
                incidence.entry, mesh.position, motion_[sweep % 2], motion_[1 - sweep % 2]);
  CAMA_LAUNCH(b, follow_motions, n, state.time.implicit_step, mesh.fixed, mesh.position, mesh.base_position(state.time),
              motion_[0], state.mesh.velocity_next, state.mesh.position_next);
}

}  // namespace cama
