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

void Impulses::add(double share, const Impulses &other)
{
  Backend &b = *linear.backend();
  CAMA_LAUNCH(b, add_impulses, linear.size(), share, other.linear, linear);
  CAMA_LAUNCH(b, add_impulses, angular.size(), share, other.angular, angular);
}

void ReactionState::set_up(Backend &b, int vertices, int cloth_vertices, bool carried)
{
  measured = true;
  carries = carried;
  std::vector<Impulses *> all = {&step, &pieces, &piece, &interval, &push};
  if (carried) all.insert(all.end(), {&smooth, &smooth_next});
  for (Impulses *i : all) {
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

void ReactionState::carry_on(double memory)
{
  if (!carries) return;
  if (memory > 0) piece.add(memory, smooth);
  for (auto part : {&Impulses::linear, &Impulses::angular}) (smooth_next.*part).copy_from(piece.*part);
}

void ReactionState::accept_piece() { pieces.add(1, piece); }

void ReactionState::accept_step(double time_step)
{
  if (!measured) return;
  step.swap(pieces);
  if (carries) smooth.swap(smooth_next);
  interval.add(1, step);
  interval_time += time_step;
}

}  // namespace cama
