// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "run/pipeline.hpp"
#include "stages/flagged_pairs.hpp"
#include "stages/gap_bounds.hpp"

namespace cama {

/// Makes contacts of candidate pairs that are closer than their thickness, or will be (discrete detection, Figure 7).
class FindContacts final : public StageOn<const Options, StepReport, const MeshState, const BoundsState, ContactState> {
public:
  FindContacts(Backend &backend, FlaggedPairs &flagged, GapBounds &bounds)
      : flagged_(flagged), bounds_(bounds), nearest_(backend)
  {}
  std::string_view name() const override { return "contacts"; }
  std::string reason() const override { return "contact"; }
  void run_on(const Rooms &state) override;

private:
  FlaggedPairs &flagged_;
  GapBounds &bounds_;
  Stream<int> nearest_;
};

}  // namespace cama
