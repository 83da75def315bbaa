// SPDX-License-Identifier: Apache-2.0
#include "model/mesh_state.hpp"

#include <algorithm>

namespace cama {

int MeshState::object_of(int vertex) const
{
  const auto above = std::upper_bound(object_first.begin(), object_first.end(), vertex);
  return static_cast<int>(above - object_first.begin()) - 1;
}

std::string MeshState::describe(int vertex) const
{
  const std::size_t object = static_cast<std::size_t>(object_of(vertex));
  return object_name[object] + ", vertex " + std::to_string(vertex - object_first[object]);
}

}  // namespace cama
