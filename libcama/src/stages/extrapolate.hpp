// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "run/pipeline.hpp"

namespace cama {

/// Base of a step by the second-order backward differentiation formula with variable steps: with the ratio r of this
/// step to the one before, x* = x_n + m (x_n - x_{n-1}), v* likewise, m = r^2 / (1 + 2 r), h = (1 + r) / (1 + 2 r) dt.
/// Backward Euler, whose base is x_n, v_n, if there is no history: in the first step, after a step that was divided,
/// after a state was set, and where the step is more than twice the one before.
class Extrapolate final : public StageOn<Clock, MeshState, const ElementState, SystemState> {
public:
  std::string_view name() const override { return "extrapolation"; }
  std::string reason() const override { return "integrator bdf2"; }
  void run_on(const Rooms &state) override;
};

/// State at which a step of BDF2 is linearised: the velocity at the start of the step, and the position that it leads
/// to. An extrapolated velocity would carry on what stiff modes do from step to step: fine meshes became unstable.
/// After a step in which Newton's method contracted slowly (Clock::smoothed_steps) the motion to that position is
/// smoothed where neighbours would move apart by much of their distance: there linearisation says nothing.
class PredictState final : public StageOn<const Clock, MeshState, const ElementState> {
public:
  explicit PredictState(Backend &backend) : motion_{Stream<dvec3>(backend), Stream<dvec3>(backend)} {}
  std::string_view name() const override { return "prediction"; }
  std::string reason() const override { return "integrator bdf2"; }
  void run_on(const Rooms &state) override;

private:
  void smooth(const Rooms &state);
  Stream<dvec3> motion_[2];
};

}  // namespace cama
