// SPDX-License-Identifier: Apache-2.0
#include "model/reaction_state.hpp"

#include <vector>

#include "device/launch.hpp"

namespace cama {

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
