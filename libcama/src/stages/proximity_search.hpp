// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "stages/candidate_search.hpp"

namespace cama {

/// The search of the step, for the ballistic motion.
class ProximitySearch final : public StageOn<const Options, StepReport, const Clock, const MeshState,
                                             const ElementState, ContactState, const Exemptions, BoundsState> {
public:
  explicit ProximitySearch(CandidateSearch &search) : search_(search) {}
  std::string_view name() const override { return "candidate search"; }
  std::string reason() const override { return "contact"; }
  void run_on(const Rooms &state) override;

private:
  CandidateSearch &search_;
};

}  // namespace cama
