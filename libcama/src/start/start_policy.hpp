// SPDX-License-Identifier: Apache-2.0
// What to do with positions in which cloth intersects something, from which no step could guarantee anything.
#pragma once
#include <vector>

#include "cama/options.hpp"
#include "cama/untangle.hpp"
#include "model/topology.hpp"

namespace cama {

/// Applies the option `intersections` to the start; may move topology.position. Throws CollisionError if cloth
/// intersects itself, another cloth or an obstacle and the option does not allow that.
UntangleReport treat_start(const Scene &scene, StartPolicy policy, Topology &topology);

/// Throws CollisionError if cloth intersects an obstacle at these positions, [all vertices]; with self also if it
/// intersects cloth.
void check_positions(const std::vector<dvec3> &position, const Topology &topology, bool self);

}  // namespace cama
