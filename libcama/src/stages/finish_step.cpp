// SPDX-License-Identifier: Apache-2.0
#include "stages/finish_step.hpp"

#include <cmath>
#include <cstdio>
#include <string>

#include "cama/error.hpp"
#include "device/launch.hpp"

namespace cama {
void FinishStep::run_on(const Rooms &state)
{
  bad_.fill_zero();
  CAMA_LAUNCH(*state.backend, find_nonfinite, state.mesh.vertices, state.mesh.position_next, state.mesh.velocity_next,
              bad_);
  if (const int bad = bad_.at(0)) {
    const double speed = kernels::dnorm(state.mesh.velocity_next.at(bad - 1));
    const std::string vertex = "step " + std::to_string(state.report.step) + ": " + state.mesh.describe(bad - 1);
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
  state.mesh.position.swap(state.mesh.position_next);
  state.mesh.velocity.swap(state.mesh.velocity_next);
  if (!state.mesh.position_before.backend()) return;
  state.mesh.position_next.swap(state.mesh.position_before);
  state.mesh.velocity_next.swap(state.mesh.velocity_before);
  // Extrapolation of a velocity that jumped would make it rebound.
  const StepReport &r = state.report;
  state.time.history = r.impact_passes == 0 && r.truncated == 0 && r.substeps == 1;
}

}  // namespace cama
