// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "model/access.hpp"

namespace cama {

/// Rigid impact zones (Provot 1997; Bridson et al. 2002, section 7.4), the last resort where the projection of impacts
/// finds pairs again and again. A zone is what repeated impacts connect; all of it moves by one rigid motion,
/// so that nothing within it can meet: interpolation between a configuration and its rigid image is affine. The motion
/// is the one that fits best the way from `from` to `wanted`, of the obstacles and pins that the zone touches if there
/// are any, else of its own vertices by mass. Sets `positions`, and 1 in `moved`, of its cloth vertices. Works on the
/// host: few steps need it, and few vertices.
void move_rigid_zones(const Access<const MeshState, const ContactState> &state, const Stream<dvec3> &from,
                      const Stream<dvec3> &wanted, Stream<dvec3> &positions, Stream<int> &moved);

}  // namespace cama
