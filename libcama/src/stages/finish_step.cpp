// SPDX-License-Identifier: Apache-2.0
#include "stages/finish_step.hpp"

#include "launch.hpp"

namespace cama {

void AdvancePositions::run(State &state)
{
  CAMA_LAUNCH(*state.backend, advance, state.cloth_vertices, state.time_step, state.fixed, state.velocity_next, state.position,
              state.position_next);
}

void FinishStep::run(State &state)
{
  bad_.fill_zero();
  CAMA_LAUNCH(*state.backend, find_nonfinite, state.vertices, state.position_next, state.velocity_next, bad_);
  if (const int bad = bad_.at(0))
    throw SolverError("step " + std::to_string(state.report.step) + ": the position or velocity of vertex " + std::to_string(bad - 1) +
                      " is not finite; the state before this step is kept. Take a smaller time step or softer material");
  state.position.swap(state.position_next);
  state.velocity.swap(state.velocity_next);
}

void ForgetSeparated::run(State &state)
{
  if (state.exemptions.temporary() == 0) return;
  if (face_.empty()) {
    std::vector<Triangle> faces;
    for (const kernels::face_nodes &f : state.face.download()) faces.push_back({f.node[0], f.node[1], f.node[2]});
    face_.swap(faces);
  }
  if (state.exemptions.forget_separated(state.position.download(), face_, state.cloth_vertices)) state.exemptions.upload();
  state.report.exempt = state.exemptions.temporary();
}

}  // namespace cama
