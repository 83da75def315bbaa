// SPDX-License-Identifier: Apache-2.0
#include "stages/impact_projection.hpp"

#include <algorithm>

#include "device/ceil_divide.hpp"
#include "device/launch.hpp"

namespace cama {
namespace {
constexpr int active_set_rounds = 4, max_iterations = 200;
constexpr int iterations_per_check = 8;      // even, since two sets of scalars alternate
constexpr double impulse_tolerance = 1e-4;   // relative residual of the linear system
constexpr double regularisation = 1e-6;      // relative to the diagonal: duplicate impacts make the system singular
constexpr double pushing_tolerance = 1e-3;   // relative change of impulses; the result is certified afterwards

int chunks(int n) { return ceil_divide(n, DOT_CHUNK); }
}  // namespace

ImpactProjection::ImpactProjection(Backend &b)
    : nodes_(b), count_(b), active_(b), dropped_(b, 1), moved_(b), constraint_(b), diagonal_(b), majorant_(b),
      lambda_(b), r_(b), z_(b), p_(b), q_(b), partial_(b), scalar_(b, SCALAR_COUNT), y_(b), wanted_(b), length_(b),
      longest_(b), longer_(b), largest_(b)
{}

void ImpactProjection::spread(const Rooms &state, const Stream<double> &lambda)
{
  CAMA_LAUNCH(*state.backend, spread_impulses, state.mesh.cloth_vertices, incidence_.row, incidence_.entry,
              state.contact.impact, state.mesh.inverse_mass, lambda, y_);
}

void ImpactProjection::multiply(const Rooms &state, double regularisation, const Stream<double> &x, Stream<double> &q)
{
  spread(state, x);
  CAMA_LAUNCH(*state.backend, gather_impulses, state.contact.impact.size(), state.mesh.cloth_vertices, regularisation,
              state.contact.impact, active_, y_, diagonal_, x, q);
}

void ImpactProjection::solve_linear_system(const Rooms &state)
{
  Backend &b = *state.backend;
  const int n = state.contact.impact.size();
  const auto dot = [&](const Stream<double> &x, const Stream<double> &y) {
    CAMA_LAUNCH(b, dot_scalars, chunks(n), n, x, y, partial_);
  };
  for (int round = 0; round < active_set_rounds; ++round) {
    CAMA_LAUNCH(b, start_impulses, n, active_, constraint_, diagonal_, lambda_, r_, z_, p_);
    dot(r_, z_);
    CAMA_LAUNCH(b, finish_beta, 1, chunks(n), 1, partial_, scalar_);
    const double start = scalar_.at(SCALAR_RZ);
    for (int i = 0; i < max_iterations; ++i) {
      if (i % 4 == 0 && scalar_.at(SCALAR_RZ) <= impulse_tolerance * impulse_tolerance * start) break;
      multiply(state, regularisation, p_, q_);
      dot(p_, q_);
      CAMA_LAUNCH(b, finish_alpha, 1, chunks(n), partial_, scalar_);
      CAMA_LAUNCH(b, update_impulses, n, scalar_, active_, diagonal_, p_, q_, lambda_, r_, z_);
      dot(r_, z_);
      CAMA_LAUNCH(b, finish_beta, 1, chunks(n), 0, partial_, scalar_);
      CAMA_LAUNCH(b, update_impulse_direction, n, scalar_, z_, p_);
    }
    dropped_.fill_zero();
    CAMA_LAUNCH(b, drop_pulling, n, lambda_, active_, dropped_);
    if (dropped_.at(0) == 0) break;
  }
  CAMA_LAUNCH(b, clamp_impulses, n, active_, lambda_);
}

void ImpactProjection::solve_pushing(const Rooms &state)
{
  Backend &b = *state.backend;
  const int n = state.contact.impact.size(), teams = ceil_divide(n, PUSH_IMPACTS);
  partial_.resize(3 * teams);
  CAMA_LAUNCH(b, set_int, n, 0, 1, active_);
  CAMA_LAUNCH(b, set_double, n, 0.0, lambda_);
  CAMA_LAUNCH(b, set_double, n, 0.0, p_);
  CAMA_LAUNCH(b, start_momentum, PUSH_COUNT, scalar_);
  const auto iterate = [&] {
    for (int i = 0; i < iterations_per_check; ++i) {
      const int from = i % 2 * PUSH_COUNT, to = PUSH_COUNT - from;
      spread(state, p_);
      CAMA_LAUNCH_TEAMS(void, b, push_impulses, PUSH_TEAM, teams, n, state.mesh.cloth_vertices, state.contact.impact,
                        active_, y_, constraint_, majorant_, p_, lambda_, r_, partial_);
      CAMA_LAUNCH_TEAMS(void, b, extrapolate_impulses, PUSH_TEAM, teams, n, teams, partial_, from, to, scalar_, lambda_,
                        r_, p_);
    }
  };
  for (int i = 0; i < max_iterations; i += iterations_per_check) {
    b.repeat(1, iterate, i > 0);
    const std::vector<double> scalar = scalar_.download();
    if (scalar[PUSH_MOVED] <= pushing_tolerance * pushing_tolerance * scalar[PUSH_SIZE]) break;
  }
}

void ImpactProjection::start(const Rooms &state, const Stream<dvec3> &from, const Stream<dvec3> &wanted)
{
  Backend &b = *state.backend;
  if (largest_.size() == 0) {  // allocated last
    moved_.resize(state.mesh.vertices);
    moved_.fill_zero();
    length_.resize(state.mesh.vertices);
    largest_.resize(1);
  }
  wanted_.copy_from(wanted);
  CAMA_LAUNCH(b, motion_lengths, state.mesh.vertices, from, wanted, length_);
}

void ImpactProjection::run(const Rooms &state, Stream<dvec3> &positions)
{
  Backend &b = *state.backend;
  const int n = state.contact.impact.size();
  nodes_.resize(n);
  for (Stream<double> *s : {&constraint_, &diagonal_, &majorant_, &lambda_, &r_, &z_, &p_, &q_}) s->resize(n);
  active_.resize(n);
  partial_.resize(chunks(n));
  y_.resize(state.mesh.cloth_vertices);
  count_.resize(state.mesh.cloth_vertices);
  CAMA_LAUNCH(b, impact_nodes, n, state.contact.impact, nodes_);
  incidence_.reset(b, state.mesh.cloth_vertices);
  incidence_.build(b, nodes_, n, count_);
  CAMA_LAUNCH(b, start_impacts, n, state.mesh.cloth_vertices, state.contact.impact, positions, state.mesh.inverse_mass,
              incidence_.row, constraint_, diagonal_, majorant_, active_);
  if (state.options.paper.linear_impacts)
    solve_linear_system(state);
  else
    solve_pushing(state);
  spread(state, lambda_);
  const int first = std::clamp(n, 1, 4096), second = std::min(first, 64);
  longest_.resize(first);
  longer_.resize(second);
  CAMA_LAUNCH(b, farthest_pushes, first, n, state.contact.impact, length_, longest_);
  CAMA_LAUNCH(b, largest_of, second, first, longest_, longer_);
  CAMA_LAUNCH(b, largest_of, 1, second, longer_, largest_);
  CAMA_LAUNCH(b, apply_impulses, state.mesh.cloth_vertices, largest_, wanted_, y_, positions, moved_);
}

}  // namespace cama
