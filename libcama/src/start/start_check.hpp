// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "cama/geometry.hpp"
#include "cama/intersections.hpp"
#include "cama/untangle.hpp"
#include "model/topology.hpp"

namespace cama {

/// Intersections that contact has to prevent: cloth with obstacles, and cloth with cloth if contact.self is on.
std::vector<Intersection> forbidden_intersections(const std::vector<dvec3> &position, const Topology &topology,
                                                  bool self);

/// The same by pairs of objects, with names and places.
std::vector<ObjectIntersections> by_objects(const Scene &scene, const Topology &topology,
                                            const std::vector<dvec3> &position);

/// Moves `topology.position`; rest state, masses and thicknesses do not change.
UntangleReport untangle(const Scene &scene, Topology &topology, const UntangleOptions &options = {});

}  // namespace cama
