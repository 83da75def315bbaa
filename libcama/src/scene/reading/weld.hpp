// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

#include "cama/types.hpp"

namespace cama {

/// Merges vertices with bitwise equal positions (and equal tags, if given), in order of first appearance.
struct Weld {
  /// index: [old vertices] new vertex; first: [new vertices] first old vertex.
  std::vector<int> index, first;
};
Weld weld_equal(const std::vector<dvec3> &position, const std::vector<std::string> &tag);

}  // namespace cama
