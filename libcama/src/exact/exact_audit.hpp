// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "model/topology.hpp"

namespace cama {

/// A cloth face that reaches into a sphere or capsule, or a cloth vertex at or below a plane.
struct Intrusion {
  int feature;   ///< face or vertex of the cloth
  int vertex;    ///< first vertex of the obstacle
};
std::vector<Intrusion> intrusions(const std::vector<dvec3> &position, const Topology &topology);

}  // namespace cama
