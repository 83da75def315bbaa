// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>

#include "run/pipeline.hpp"

namespace cama {

/// Whether the scene has pins or moving obstacles.
bool needs_motion(const Scene &scene);

/// The step of Figure 3 with only the stages that this scene needs.
template <class Real> std::unique_ptr<Pipeline> make_pipeline(const Scene &scene, State &state);

extern template std::unique_ptr<Pipeline> make_pipeline<double>(const Scene &, State &);
extern template std::unique_ptr<Pipeline> make_pipeline<float>(const Scene &, State &);

}  // namespace cama
