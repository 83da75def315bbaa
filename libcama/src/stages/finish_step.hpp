// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "run/pipeline.hpp"

namespace cama {

/// Base of a step by the second-order backward differentiation formula: x* = (4 x_n - x_{n-1}) / 3, v* uniform, h = 2/3
/// dt. Backward Euler, whose base is x_n, v_n, where there is no history: in the first step, and after one whose motion
/// was handled, divided or replaced.
class Extrapolate final : public Stage {
public:
  std::string_view name() const override { return "extrapolation"; }
  std::string reason() const override { return "integrator bdf2"; }
  void run(State &state) override;
};

/// Projects positions along the solved velocities (Equation 1).
class AdvancePositions final : public Stage {
public:
  std::string_view name() const override { return "advance positions"; }
  void run(State &state) override;
};

/// Refuses non-finite results, then makes the updated streams the current ones.
class FinishStep final : public Stage {
public:
  explicit FinishStep(Backend &backend) : bad_(backend, 1) {}
  std::string_view name() const override { return "finish step"; }
  void run(State &state) override;

private:
  Stream<int> bad_;
};

/// Exempt pairs that have come apart are contacts again. On the host, and only while there are any.
class ForgetSeparated final : public Stage {
public:
  std::string_view name() const override { return "exemptions"; }
  std::string reason() const override { return "tangled starts or released cloth"; }
  void run(State &state) override;

private:
  std::vector<Triangle> face_;
};

}  // namespace cama
