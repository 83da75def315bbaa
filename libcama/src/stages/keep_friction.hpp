// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "run/pipeline.hpp"

namespace cama {

/// Keeps the friction of contacts, from which the next step starts.
template <class Real>
class KeepFriction final : public StageOn<const Clock, const MeshState, ContactState, SystemState> {
public:
  std::string_view name() const override { return "keep friction"; }
  std::string reason() const override { return "friction and newton_iterations above 1"; }
  void run_on(const Rooms &state) override;
};

extern template class KeepFriction<double>;
extern template class KeepFriction<float>;

}  // namespace cama
