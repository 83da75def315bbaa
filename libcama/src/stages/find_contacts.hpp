// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "pipeline.hpp"

namespace cama {

/// Candidate pairs that are closer than their thickness, or will be, become contacts (discrete detection, Figure 7).
class FindContacts final : public Stage {
public:
  explicit FindContacts(Backend &backend) : flag_(backend), vertex_face_place_(backend), edge_edge_place_(backend) {}
  std::string_view name() const override { return "contacts"; }
  std::string reason() const override { return "contact"; }
  void run(State &state) override;

private:
  Stream<int> flag_, vertex_face_place_, edge_edge_place_;
};

}  // namespace cama
