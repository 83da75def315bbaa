// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "run/pipeline.hpp"

namespace cama {

/// Keeps what BDF2 needs of this step, rejects results that are not finite, then makes the updated streams the current
/// ones.
class FinishStep final : public StageOn<const StepReport, Clock, MeshState, ElementState, ContactState> {
public:
  explicit FinishStep(Backend &backend) : bad_(backend, 1) {}
  std::string_view name() const override { return "finish step"; }
  void run_on(const Rooms &state) override;

private:
  Stream<int> bad_;
};

}  // namespace cama
