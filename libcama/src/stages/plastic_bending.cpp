// SPDX-License-Identifier: Apache-2.0
#include "stages/plastic_bending.hpp"

#include "device/launch.hpp"
#include "stages/bending.hpp"

namespace cama {

template <class Real> void set_rest_angles(Backend &b, System<Real> &s, const Stream<dvec3> &curvature)
{
  CAMA_LAUNCH_REAL(Real, b, set_rest_angles, s.plastic_hinge.size(), s.plastic_hinge, curvature, s.hinge_rest);
}

template <class Real> void FollowCurvature<Real>::run_on(const typename FollowCurvature::Rooms &state)
{
  set_rest_angles(*state.backend, state.system.template of<Real>(), state.elements.plastic_curvature);
}

template <class Real> void YieldCurvature<Real>::run_on(const typename YieldCurvature::Rooms &state)
{
  System<Real> &s = state.system.template of<Real>();
  find_plate_moments(*state.backend, s, state.mesh.hinges, state.mesh.position_next);
  CAMA_LAUNCH_REAL(Real, *state.backend, yield_triangles, state.mesh.triangles, s.plastic_triangle, s.plastic_material,
                   s.angle_scale, s.moment, state.elements.plastic_curvature, state.elements.plastic_curvature_next);
}

template void set_rest_angles(Backend &, System<double> &, const Stream<dvec3> &);
template void set_rest_angles(Backend &, System<float> &, const Stream<dvec3> &);
template class FollowCurvature<double>;
template class FollowCurvature<float>;
template class YieldCurvature<double>;
template class YieldCurvature<float>;

}  // namespace cama
