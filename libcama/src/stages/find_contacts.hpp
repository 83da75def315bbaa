// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "run/pipeline.hpp"
#include "stages/flagged_pairs.hpp"

namespace cama {

/// Makes contacts of candidate pairs that are closer than their thickness, or will be (discrete detection, Figure 7).
class FindContacts final : public StageOn<const Options, StepReport, const MeshState, const BoundsState, ContactState> {
public:
  FindContacts(Backend &backend, FlaggedPairs &flagged)
      : flagged_(flagged), nearest_(backend), swept_vertices_(backend), rounding_margin_(backend, 1),
        listed_(backend, 1)
  {}
  std::string_view name() const override { return "contacts"; }
  std::string reason() const override { return "contact"; }
  void run_on(const Rooms &state) override;

private:
  FlaggedPairs &flagged_;
  Stream<int> nearest_;
  Stream<kernels::swept_vertex> swept_vertices_;
  Stream<float> rounding_margin_;
  Stream<int> listed_;  // the length of flagged_.list
};

}  // namespace cama
