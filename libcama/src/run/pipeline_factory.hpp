// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>

#include "run/pipeline.hpp"
#include "stages/prescribed_motion.hpp"

namespace cama {

/// The step of Figure 3 with the stages this scene needs, and nothing else.
struct StepPipeline {
  std::unique_ptr<Pipeline> step;
  PrescribedMotion *motion = nullptr;   ///< inside `step`, or none
};
template <class Real> StepPipeline make_pipeline(const Scene &scene, State &state);

extern template StepPipeline make_pipeline<double>(const Scene &, State &);
extern template StepPipeline make_pipeline<float>(const Scene &, State &);

}  // namespace cama
