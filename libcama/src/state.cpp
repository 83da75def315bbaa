// SPDX-License-Identifier: Apache-2.0
#include "state.hpp"

#include <algorithm>

namespace cama {

int State::object_of(int vertex) const
{
  return static_cast<int>(std::upper_bound(object_first.begin(), object_first.end(), vertex) - object_first.begin()) - 1;
}

std::string State::describe(int vertex) const
{
  const std::size_t object = static_cast<std::size_t>(object_of(vertex));
  return object_name[object] + ", vertex " + std::to_string(vertex - object_first[object]);
}

}  // namespace cama
