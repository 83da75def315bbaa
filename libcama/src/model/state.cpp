// SPDX-License-Identifier: Apache-2.0
#include "model/state.hpp"

#include <algorithm>

#include "device/launch.hpp"

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

void Impulses::fill_zero()
{
  linear.fill_zero();
  angular.fill_zero();
}

void Impulses::swap(Impulses &other) noexcept
{
  linear.swap(other.linear);
  angular.swap(other.angular);
}

void Impulses::add(double kept, const Impulses &before, const Impulses &own)
{
  Backend &b = *linear.backend();
  CAMA_LAUNCH(b, add_impulses, linear.size(), kept, before.linear, own.linear, linear);
  CAMA_LAUNCH(b, add_impulses, angular.size(), kept, before.angular, own.angular, angular);
}

void ReactionState::set_up(Backend &b, int vertices, int cloth_vertices)
{
  measured = true;
  for (Impulses *i : {&step, &pieces, &piece, &interval, &push}) {
    i->linear = Stream<dvec3>(b, vertices);
    i->angular = Stream<dvec3>(b, vertices);
    i->fill_zero();
  }
  solved_velocity = Stream<dvec3>(b, cloth_vertices);
  solved_velocity.fill_zero();
  contact = Stream<dvec3>(b);
}

void ReactionState::begin_interval()
{
  if (!measured) return;
  interval.fill_zero();
  interval_time = 0;
}

void ReactionState::begin_step()
{
  if (measured) pieces.fill_zero();
}

void ReactionState::accept_piece(double kept) { pieces.add(kept, step, piece); }

void ReactionState::accept_step(double time_step)
{
  if (!measured) return;
  step.swap(pieces);
  interval.add(0, step, step);
  interval_time += time_step;
}

}  // namespace cama
