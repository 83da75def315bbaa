// SPDX-License-Identifier: Apache-2.0
#include "stages/estimate_error.hpp"

#include <algorithm>
#include <cmath>

#include "device/ceil_divide.hpp"
#include "device/launch.hpp"

namespace cama {

EstimateError::EstimateError(Backend &backend, const std::vector<double> &masses)
    : mass_(backend, masses), square_(backend), part_(backend)
{
  for (double m : masses) total_ += m;
}

void EstimateError::run_on(const Rooms &state)
{
  Backend &b = *state.backend;
  const MeshState &mesh = state.mesh;
  Clock &time = state.time;
  const double ratio = time.multistep ? time.ratio : 0, scale = time.implicit_step / (time.multistep ? 3 : 2),
               jump = time.implicit_step / 3 * std::min(time.step * ERROR_FRAMES, 1.0);
  square_.resize(mesh.cloth_vertices);
  // Finishing the step has left the velocities at its start in velocity_next, and those before it in velocity_base.
  CAMA_LAUNCH(b, local_errors, mesh.cloth_vertices, scale, ratio, jump, mesh.fixed, mass_, mesh.velocity,
              time.predicted ? mesh.velocity_before : mesh.velocity_next, mesh.velocity_next,
              time.predicted ? mesh.velocity_base : mesh.velocity_next, square_);
  for (int n = mesh.cloth_vertices; n > 1;) {
    const int parts = ceil_divide(n, PARTIAL_CHUNK);
    part_.resize(parts);
    CAMA_LAUNCH(b, reduce_partials, parts, n, square_, part_);
    square_.swap(part_);
    n = parts;
  }
  time.step_error = mesh.cloth_vertices ? std::sqrt(square_.at(0) / total_) : 0;
}

}  // namespace cama
