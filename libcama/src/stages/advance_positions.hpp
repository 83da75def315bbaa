// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "run/pipeline.hpp"

namespace cama {

/// Projects positions along the solved velocities (Equation 1).
class AdvancePositions final : public StageOn<const Clock, MeshState> {
public:
  std::string_view name() const override { return "advance positions"; }
  void run_on(const Rooms &state) override;
};

}  // namespace cama
