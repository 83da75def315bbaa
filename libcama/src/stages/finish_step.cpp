// SPDX-License-Identifier: Apache-2.0
#include "stages/finish_step.hpp"

#include "device/launch.hpp"

namespace cama {

void AdvancePositions::run(State &state)
{
  CAMA_LAUNCH(*state.backend, advance, state.cloth_vertices, state.implicit_step, state.fixed, state.velocity_next,
              state.base_position(), state.position_next);
}

void FinishStep::run(State &state)
{
  bad_.fill_zero();
  CAMA_LAUNCH(*state.backend, find_nonfinite, state.vertices, state.position_next, state.velocity_next, bad_);
  if (const int bad = bad_.at(0))
    throw SolverError(
        "step " + std::to_string(state.report.step) + ": the position or velocity of vertex " +
        std::to_string(bad - 1) +
        " is not finite; the state before this step is kept. Take a smaller time step or softer material");
  state.position.swap(state.position_next);
  state.velocity.swap(state.velocity_next);
  if (!state.position_before.backend()) return;
  state.position_next.swap(state.position_before);
  state.velocity_next.swap(state.velocity_before);
  const StepReport &r = state.report;   // a velocity that jumped would be extrapolated to one that rebounds
  state.history = r.impact_passes == 0 && r.truncated == 0 && r.substeps == 1;
}

void Extrapolate::run(State &state)
{
  state.multistep = state.history;
  state.set_implicit_step(state.multistep ? 2.0 / 3.0 * state.time_step : state.time_step);
  if (!state.multistep) return;
  CAMA_LAUNCH(*state.backend, extrapolate_states, state.vertices, state.position, state.position_before,
              state.position_base);
  CAMA_LAUNCH(*state.backend, extrapolate_states, state.vertices, state.velocity, state.velocity_before,
              state.velocity_base);
}

void ForgetSeparated::run(State &state)
{
  if (state.exemptions.temporary() == 0) return;
  if (face_.empty()) {
    std::vector<Triangle> faces;
    for (const kernels::face_nodes &f : state.face.download()) faces.push_back({f.node[0], f.node[1], f.node[2]});
    face_.swap(faces);
  }
  if (state.exemptions.forget_separated(state.position.download(), face_, state.cloth_vertices))
    state.exemptions.upload();
  state.report.exempt = state.exemptions.temporary();
}

}  // namespace cama
