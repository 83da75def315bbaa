// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "run/pipeline.hpp"

namespace cama {

/// Ends the exemption of pairs that have separated. On the host, and only while there are such pairs.
class ForgetSeparated final : public StageOn<StepReport, const MeshState, Exemptions> {
public:
  std::string_view name() const override { return "exemptions"; }
  std::string reason() const override { return "tangled starts or released cloth"; }
  void run_on(const Rooms &state) override;

private:
  std::vector<Triangle> face_;
};

}  // namespace cama
