// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "run/pipeline.hpp"
#include "stages/gap_bounds.hpp"
#include "stages/listed_pairs.hpp"

namespace cama {

/// Makes contacts of candidate pairs that are closer than their thickness, or will be (discrete detection, Figure 7).
class FindContacts final : public StageOn<const Options, StepReport, const MeshState, const BoundsState, ContactState> {
public:
  FindContacts(Backend &backend, ListedPairs &listed, GapBounds &bounds)
      : listed_(listed), bounds_(bounds), nearest_(backend)
  {}
  std::string_view name() const override { return "contacts"; }
  std::string reason() const override { return "contact"; }
  void run_on(const Rooms &state) override;

private:
  ListedPairs &listed_;
  GapBounds &bounds_;
  Stream<int> nearest_;
};

}  // namespace cama
