// SPDX-License-Identifier: Apache-2.0
#include "stages/impact_projection.hpp"

#include <algorithm>

#include "device/ceil_divide.hpp"
#include "device/launch.hpp"

namespace cama {
namespace {
constexpr int max_iterations = 200, max_zone_iterations = 1000;
constexpr int iterations_per_check = 8;      // even, since two sets of scalars alternate
// Relative change of impulses. Without zones the result is certified afterwards; smaller ones only cost iterations.
constexpr double zone_tolerance = 1e-3, pushing_tolerance = 1e-2;
}  // namespace

ImpactProjection::ImpactProjection(Backend &b) : ImpactProjection(b, pushing_tolerance) {}

ImpactProjection::ImpactProjection(Backend &b, double tolerance)
    : tolerance_(tolerance), nodes_(b), count_(b), moved_(b), constraint_(b), majorant_(b), partial_(b),
      scalar_(b, 3 * PUSH_COUNT), impulse_(b), y_(b), from_(b), wanted_(b), head_(b), share_(b), length_(b),
      longest_(b), longer_(b), largest_(b)
{}

void ImpactProjection::solve(const Rooms &state)
{
  Backend &b = *state.backend;
  const bool zones = state.options.paper.impact_zones;
  const int most = zones ? max_zone_iterations : max_iterations;
  const double tolerance = zones ? zone_tolerance : tolerance_;
  const int n = state.contact.impact.size(), rows = state.mesh.cloth_vertices;
  if (n <= PUSH_IMPACTS) {  // the usual case
    CAMA_LAUNCH_TEAMS(void, b, solve_few_impacts, PUSH_TEAM, 1, n, rows, most, iterations_per_check, tolerance,
                      incidence_.row, incidence_.entry, state.contact.impact, state.mesh.inverse_mass, constraint_,
                      majorant_, y_, impulse_);
    return;
  }
  const int teams = ceil_divide(n, PUSH_TEAM), entries = 4 * n;
  head_.resize(entries);
  share_.resize(entries);
  CAMA_LAUNCH(b, list_shares, entries, rows, state.contact.impact, incidence_.row, incidence_.entry, head_, share_);
  partial_.resize(3 * teams);
  for (Stream<double> *s : {&partial_, &scalar_}) s->fill_zero();
  impulse_.fill_zero();
  constexpr int measured = 2 * PUSH_COUNT;
  const bool many = teams > SPREAD_TEAMS;
  const auto iterate = [&] {
    for (int i = 0; i < iterations_per_check; ++i) {
      const int from = i % 2 * PUSH_COUNT, to = PUSH_COUNT - from;
      if (many) CAMA_LAUNCH_TEAMS(void, b, find_momentum, PUSH_TEAM, 1, teams, partial_, from, to, scalar_);
      CAMA_LAUNCH_TEAMS(void, b, spread_extrapolated, PUSH_TEAM, ceil_divide(entries, PUSH_TEAM), many ? 0 : teams,
                        partial_, from, to, scalar_, rows, incidence_.row, incidence_.entry, head_, share_,
                        state.mesh.inverse_mass, impulse_, y_);
      CAMA_LAUNCH_TEAMS(void, b, push_impulses, PUSH_TEAM, teams, n, rows, state.contact.impact, y_, constraint_,
                        majorant_, to, scalar_, impulse_, partial_);
    }
    CAMA_LAUNCH_TEAMS(void, b, measure_step, PUSH_TEAM, 1, teams, partial_, measured, scalar_);
  };
  for (int i = 0; i < most; i += iterations_per_check) {
    b.repeat(1, iterate);
    const std::vector<double> scalar = scalar_.download();
    if (scalar[measured + PUSH_MOVED] <= tolerance * tolerance * scalar[measured + PUSH_SIZE]) break;
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
  if (state.options.paper.impact_zones) from_.copy_from(from);
  CAMA_LAUNCH(b, motion_lengths, state.mesh.vertices, from, wanted, length_);
}

void ImpactProjection::add_pushes(const Rooms &state, const Stream<dvec3> &positions)
{
  Backend &b = *state.backend;
  const int n = state.contact.impact.size();
  count_.resize(state.mesh.vertices);
  all_incidence_.reset(b, state.mesh.vertices);
  all_incidence_.rebuild(b, nodes_, n, count_);
  const double keep = state.options.paper.impact_zones ? 0 : 1;  // impact zones project anew about the solve
  CAMA_LAUNCH(b, impact_reactions, state.mesh.vertices, keep, all_incidence_.row, all_incidence_.entry,
              state.contact.impact, impulse_, positions, state.contact.vertex_contact, state.reactions.push.linear,
              state.reactions.push.angular);
}

void ImpactProjection::run(const Rooms &state, Stream<dvec3> &positions)
{
  Backend &b = *state.backend;
  const int n = state.contact.impact.size();
  nodes_.resize(n);
  for (Stream<double> *s : {&constraint_, &majorant_}) s->resize(n);
  impulse_.resize(n);
  y_.resize(state.mesh.cloth_vertices);
  count_.resize(state.mesh.cloth_vertices);
  CAMA_LAUNCH(b, impact_nodes, n, state.contact.impact, nodes_);
  incidence_.reset(b, state.mesh.cloth_vertices);
  incidence_.rebuild(b, nodes_, n, count_);
  const bool zones = state.options.paper.impact_zones;
  CAMA_LAUNCH(b, start_impacts, n, state.mesh.cloth_vertices, zones ? 1 : 0, state.contact.impact, from_,
              zones ? wanted_ : positions, state.mesh.inverse_mass, incidence_.row, constraint_, majorant_);
  solve(state);
  if (state.reactions.measured) add_pushes(state, positions);
  CAMA_LAUNCH(b, spread_impulses, state.mesh.cloth_vertices, incidence_.row, incidence_.entry, state.contact.impact,
              state.mesh.inverse_mass, impulse_, y_);
  const int first = std::clamp(n, 1, 4096), second = std::min(first, 64);
  longest_.resize(first);
  longer_.resize(second);
  CAMA_LAUNCH(b, farthest_pushes, first, n, state.contact.impact, length_, longest_);
  CAMA_LAUNCH(b, largest_of, second, first, longest_, longer_);
  CAMA_LAUNCH(b, largest_of, 1, second, longer_, largest_);
  CAMA_LAUNCH(b, apply_impulses, state.mesh.cloth_vertices, zones ? 1 : 0, largest_, wanted_, y_, positions, moved_);
}

}  // namespace cama
