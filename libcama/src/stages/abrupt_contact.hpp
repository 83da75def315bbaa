// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "run/pipeline.hpp"

namespace cama {

/// Finds what contact stopped abruptly in a step of BDF2 (abrupt.h), which would rebound otherwise.
template <class Real>
class SplitContact final
    : public StageOn<const Options, const Clock, MeshState, ContactState, SystemState, const RigidState> {
public:
  explicit SplitContact(Backend &backend) : push_(backend), load_(backend) {}
  std::string_view name() const override { return "abrupt contact"; }
  std::string reason() const override { return "bdf2 with contact"; }
  void run_on(const Rooms &state) override;

private:
  Stream<double> push_, load_;  // [contacts], [cloth vertices] N s
};

extern template class SplitContact<double>;
extern template class SplitContact<float>;

}  // namespace cama
