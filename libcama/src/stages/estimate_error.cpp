// SPDX-License-Identifier: Apache-2.0
#include "stages/estimate_error.hpp"

#include <algorithm>
#include <cmath>

#include "device/ceil_divide.hpp"
#include "device/launch.hpp"
#include "model/topology.hpp"

namespace cama {
namespace {
// Candidates for each vertex of cloth beyond which longer steps do not pay.
constexpr double many_candidates = 400;
}  // namespace

EstimateError::EstimateError(Backend &backend, const Scene &scene, const MeshState &mesh,
                             const std::vector<double> &masses)
    : mass_(backend, masses), square_(backend), part_(backend),
      rest_(backend, lengths_at_rest(scene, mesh.edge.download())), edges_(backend, 1)
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
  // Finishing the step has left its start in position_next and velocity_next, and the velocities before in
  // velocity_base.
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
  time.stretched = 0;
  time.crowding = 0;
  if (const int edges = mesh.edge.size()) {   // which contact knows
    edges_.fill_zero();
    CAMA_LAUNCH(b, count_stretched, edges, mesh.cloth_vertices, mesh.edge, rest_, mesh.position_next, mesh.position,
                edges_);
    time.stretched = edges_.at(0);
    const double crowding = state.report.candidates / (many_candidates * mesh.cloth_vertices);
    if (crowding > 0.25) {   // a step of twice the length may have four times as many
      edges_.fill_zero();
      CAMA_LAUNCH(b, count_far_moved, edges, mesh.cloth_vertices, mesh.edge, mesh.position_next, mesh.position, edges_);
      if (edges_.at(0) > mesh.cloth_vertices) time.crowding = crowding;   // a third of the edges
    }
  }
  time.step_error = mesh.cloth_vertices ? std::sqrt(square_.at(0) / total_) : 0;
}

}  // namespace cama
