// SPDX-License-Identifier: Apache-2.0
// What becomes of positions in which cloth intersects something: no step could promise anything from there.
#pragma once
#include <vector>

#include "cama/options.hpp"
#include "cama/untangle.hpp"
#include "model/topology.hpp"

namespace cama {

/// The start as the option `intersections` wants it; topology.position may move. Throws CollisionError where cloth
/// intersects itself, another cloth or an obstacle and the option does not allow that.
UntangleReport treat_start(const Scene &scene, StartPolicy policy, Topology &topology);

/// Throws CollisionError where cloth intersects anything at these positions, [all vertices]. self: also cloth.
void check_positions(const std::vector<dvec3> &position, const Topology &topology, bool self);

}  // namespace cama
