// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "run/pipeline.hpp"

namespace cama {

constexpr double ERROR_FRAMES = 60;  // 1/s, rate of the frames that an error is asked for

/// With error control: estimates the local error of the step after it is finished, from the change of acceleration and,
/// where contact stopped motion abruptly, from the change of velocity. The first is per step what it is per time; of
/// the second a frame has few, so that a step's share of a frame's error is not asked of it. Counts the edges that the
/// step stretches too much as well: a step that is short enough for the motion as a whole may be too long for a fine
/// mesh in contact. And it says how many candidates fast cloth has, which a shorter step has fewer of.
class EstimateError final : public StageOn<const StepReport, const MeshState, Clock> {
public:
  /// masses: [cloth vertices], kg
  EstimateError(Backend &backend, const Scene &scene, const MeshState &mesh, const std::vector<double> &masses);
  std::string_view name() const override { return "error estimate"; }
  std::string reason() const override { return "error"; }
  void run_on(const Rooms &state) override;

private:
  double total_ = 0;  // kg
  Stream<double> mass_, square_, part_;
  Stream<float> rest_;  // [edges] lengths at rest, m
  Stream<int> edges_;  // [1] number of edges
};

}  // namespace cama
