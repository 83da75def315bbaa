// SPDX-License-Identifier: Apache-2.0
#include "stages/finish_step.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "cama/error.hpp"
#include "device/launch.hpp"

namespace cama {
void FinishStep::run_on(const Rooms &state)
{
  MeshState &mesh = state.mesh;
  const Clock &time = state.time;
  if (time.predicted)
    CAMA_LAUNCH(*state.backend, keep_history, mesh.vertices, mesh.cloth_vertices, time.step, time.implicit_step,
                time.multistep ? 0.5 : 0.0, time.memory, mesh.fixed, state.elements.gravity, mesh.position,
                mesh.velocity, mesh.base_position(time), mesh.base_velocity(time),
                mesh.abrupt_change.size() > 0 ? 1 : 0, mesh.abrupt_change, mesh.position_next, mesh.velocity_next,
                mesh.position_base, mesh.velocity_base);
  bad_.fill_zero();
  CAMA_LAUNCH(*state.backend, find_nonfinite, mesh.vertices, mesh.position_next, mesh.velocity_next, bad_);
  if (const int bad = bad_.at(0)) {
    const double speed = kernels::dnorm(mesh.velocity_next.at(bad - 1));
    const std::string vertex = "step " + std::to_string(state.report.step) + ": " + mesh.describe(bad - 1);
    if (std::isfinite(speed) && speed > FASTEST) {
      char text[32];
      std::snprintf(text, sizeof text, "%.3g", speed);
      throw SolverError(vertex + " moves at " + text +
                        " m/s, faster than cloth can; the state before this step is kept. Lower velocities and forces, "
                        "or take a smaller time step");
    }
    throw SolverError(vertex +
                      ": its position or velocity is not finite; the state before this step is kept. Take a smaller "
                      "time step or softer material");
  }
  mesh.position.swap(mesh.position_next);
  mesh.velocity.swap(mesh.velocity_next);
  state.contact.kept.swap(state.contact.kept_next);
  state.elements.plastic_curvature.swap(state.elements.plastic_curvature_next);
  if (!time.predicted) return;
  mesh.position_before.swap(mesh.position_base);
  mesh.velocity_before.swap(mesh.velocity_base);
  state.time.step_before = time.step;
  state.time.smoothed_steps = std::max(0, time.smoothed_steps - 1);
  state.time.history = true;
}

}  // namespace cama
