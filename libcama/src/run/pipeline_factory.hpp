// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>

#include "run/pipeline.hpp"

namespace cama {

/// The step of Figure 3 with the stages this scene needs, and nothing else.
template <class Real> std::unique_ptr<Pipeline> make_pipeline(const Scene &scene, State &state);

extern template std::unique_ptr<Pipeline> make_pipeline<double>(const Scene &, State &);
extern template std::unique_ptr<Pipeline> make_pipeline<float>(const Scene &, State &);

}  // namespace cama
