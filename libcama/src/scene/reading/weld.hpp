// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

#include "cama/types.hpp"

namespace cama {

/// Vertices with bitwise equal positions (and equal tags, where given) as one, in order of first appearance.
struct Weld {
  std::vector<int> index, first;
};   ///< [old vertices] new index; [new vertices] an old vertex
Weld weld_equal(const std::vector<dvec3> &position, const std::vector<std::string> &tag);

}  // namespace cama
