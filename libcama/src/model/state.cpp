// SPDX-License-Identifier: Apache-2.0
#include "model/state.hpp"

#include <algorithm>

namespace cama {

int State::object_of(int vertex) const
{
  return static_cast<int>(std::upper_bound(object_first.begin(), object_first.end(), vertex) - object_first.begin()) -
         1;
}

void State::set_implicit_step(double step)
{
  implicit_step = step;
  if (step == scaled_step) return;
  const auto scale = [&](auto &system) {
    using Real = typename std::decay_t<decltype(system.material_scale)>::value_type;
    std::vector<Real> values;
    for (double c : damping) values.push_back(static_cast<Real>(step * (step + c)));
    system.material_scale.assign(values);
  };
  if (system64)
    scale(*system64);
  else
    scale(*system32);
  scaled_step = step;
}

void State::forget_contacts() noexcept
{
  contacts = 0;
  if (contact.backend()) contact.resize(0);
  for (PairList *list : {&vertex_face, &edge_edge}) {
    if (!list->pairs.backend()) continue;
    list->pairs.resize(0);
    list->direction.resize(0);
    list->gap_bound.resize(0);
  }
}

std::string State::describe(int vertex) const
{
  const std::size_t object = static_cast<std::size_t>(object_of(vertex));
  return object_name[object] + ", vertex " + std::to_string(vertex - object_first[object]);
}

}  // namespace cama
