// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "run/pipeline.hpp"

namespace cama {

/// Sets the angles at rest to those of the plastic curvature at the start of the step.
template <class Real> class FollowCurvature final : public StageOn<const MeshState, const ElementState, SystemState> {
public:
  std::string_view name() const override { return "angles at rest"; }
  std::string reason() const override { return "yield_curvature"; }
  void run_on(const typename FollowCurvature::Rooms &state) override;
};

/// Finds the plastic curvature at the end of the step.
template <class Real> class YieldCurvature final : public StageOn<const MeshState, ElementState, SystemState> {
public:
  std::string_view name() const override { return "plastic bending"; }
  std::string reason() const override { return "yield_curvature"; }
  void run_on(const typename YieldCurvature::Rooms &state) override;
};

/// Sets the angles at rest of all hinges to those of a plastic curvature [triangles].
template <class Real> void set_rest_angles(Backend &backend, System<Real> &system, const Stream<dvec3> &curvature);

extern template class FollowCurvature<double>;
extern template class FollowCurvature<float>;
extern template class YieldCurvature<double>;
extern template class YieldCurvature<float>;

}  // namespace cama
