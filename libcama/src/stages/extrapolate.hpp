// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "run/pipeline.hpp"

namespace cama {

/// Base of a step by the second-order backward differentiation formula: x* = (4 x_n - x_{n-1}) / 3, v* likewise, h =
/// 2/3 dt. Backward Euler, whose base is x_n, v_n, if there is no history: in the first step, and after a step whose
/// motion penetration handling changed, or that was divided or replaced.
class Extrapolate final : public StageOn<Clock, MeshState, const ElementState, SystemState> {
public:
  std::string_view name() const override { return "extrapolation"; }
  std::string reason() const override { return "integrator bdf2"; }
  void run_on(const Rooms &state) override;
};

/// State at which a step of BDF2 is linearised: the velocity extrapolated to the end of the step, and the position that
/// it leads to.
class PredictState final : public StageOn<const Clock, MeshState> {
public:
  std::string_view name() const override { return "prediction"; }
  std::string reason() const override { return "integrator bdf2"; }
  void run_on(const Rooms &state) override;
};

}  // namespace cama
