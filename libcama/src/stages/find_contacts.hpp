// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "run/pipeline.hpp"
#include "stages/flagged_pairs.hpp"

namespace cama {

/// Candidate pairs that are closer than their thickness, or will be, become contacts (discrete detection, Figure 7).
class FindContacts final : public Stage {
public:
  FindContacts(Backend &backend, FlaggedPairs &flagged)
      : flagged_(flagged), nearest_(backend), swept_vertices_(backend), rounding_margin_(backend, 1)
  {}
  std::string_view name() const override { return "contacts"; }
  std::string reason() const override { return "contact"; }
  void run(State &state) override;

private:
  FlaggedPairs &flagged_;
  Stream<int> nearest_;
  Stream<kernels::swept_vertex> swept_vertices_;
  Stream<float> rounding_margin_;
};

}  // namespace cama
