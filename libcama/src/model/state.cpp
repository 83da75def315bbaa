// SPDX-License-Identifier: Apache-2.0
#include "model/state.hpp"

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

void ContactState::forget() noexcept
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

void SystemState::scale_materials(double h, const std::vector<double> &damping)
{
  if (h == scaled_step) return;
  const auto scale = [&](auto &system) {
    using Real = typename std::decay_t<decltype(system.material_scale)>::value_type;
    std::vector<Real> values;
    for (double c : damping) values.push_back(static_cast<Real>(h * (h + c)));
    system.material_scale.assign(values);
  };
  if (f64)
    scale(*f64);
  else
    scale(*f32);
  scaled_step = h;
}

std::vector<double> SystemState::masses() const
{
  if (f64) return f64->mass.download();
  const std::vector<float> single = f32->mass.download();
  return {single.begin(), single.end()};
}

}  // namespace cama
