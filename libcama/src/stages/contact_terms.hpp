// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "run/pipeline.hpp"

namespace cama {

/// Makes terms of the system from contacts, with friction, and from stitches.
template <class Real>
class EvaluateTerms final
    : public StageOn<const Options, const Clock, const MeshState, const ElementState, ContactState, SystemState> {
public:
  explicit EvaluateTerms(Backend &backend) : free_velocity_(backend), load_(backend), push_(backend), count_(backend) {}
  std::string_view name() const override { return "contact terms"; }
  std::string reason() const override { return "contact or stitches"; }
  void run_on(const Rooms &state) override;

private:
  void expect_friction(const Rooms &state);

  Stream<dvec3> free_velocity_;  // [vertices] m/s, with friction: after the step without contact
  Stream<double> load_;
  Stream<dvec3> push_;  // [cloth vertices] N, with friction and several solves: of all contacts of a vertex
  Stream<int> count_;
};

extern template class EvaluateTerms<double>;
extern template class EvaluateTerms<float>;

}  // namespace cama
