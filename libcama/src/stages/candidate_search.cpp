// SPDX-License-Identifier: Apache-2.0
#include "stages/candidate_search.hpp"

#include <algorithm>

#include "device/ceil_divide.hpp"
#include "device/launch.hpp"

namespace cama {
namespace {
constexpr int most_teams = 256;  // that find the bounds of the scene
}
void CandidateSearch::drop_exempt(const SearchRooms &state, int kind, int first)
{
  if (!state.exemptions.any()) return;
  Backend &b = *state.backend;
  PairList &list = kind == 0 ? state.contact.vertex_face : state.contact.edge_edge;
  const int n = list.pairs.size() - first;
  wanted_.resize(n);
  place_.resize(n + 1);
  CAMA_LAUNCH(b, wanted_pairs, n, first, kind, state.mesh.vertices, list.pairs, state.mesh.face, state.mesh.edge,
              state.exemptions.row, state.exemptions.entry, state.exemptions.object, wanted_);
  b.scan(wanted_.buffer(), place_.buffer(), n);
  const int kept = place_.at(n);
  if (kept == n) return;
  kept_.resize(n);
  CAMA_LAUNCH(b, keep_pairs, n, first, place_, list.pairs, kept_);
  CAMA_LAUNCH(b, copy_pairs, kept, first, kept_, list.pairs);
  list.pairs.resize(first + kept);
  list.gap_bound.resize(first + kept);
}

void CandidateSearch::find_directions(const SearchRooms &state, const Stream<dvec3> &from, int first_vertex_face,
                                      int first_edge_edge)
{
  const auto direct = [&](int kind, PairList &list, int first) {
    first = std::min(first, list.direction.size());
    list.direction.grow(list.pairs.size());
    CAMA_LAUNCH(*state.backend, find_directions, list.pairs.size() - first, kind, first, list.pairs, state.mesh.face,
                state.mesh.edge, from, state.contact.vertex_contact, list.direction);
  };
  direct(0, state.contact.vertex_face, first_vertex_face);
  direct(1, state.contact.edge_edge, first_edge_edge);
}

void CandidateSearch::find_bounds(const SearchRooms &state, const Stream<dvec3> &from, const Stream<dvec3> &to)
{
  Backend &b = *state.backend;
  const int teams = std::min(ceil_divide(state.mesh.vertices, BOUNDS_TEAM), most_teams);
  corners_.resize(2 * teams);
  CAMA_LAUNCH_TEAMS(void, b, position_bounds, BOUNDS_TEAM, teams, state.mesh.vertices, from, to, corners_);
  CAMA_LAUNCH_TEAMS(void, b, reduce_bounds, BOUNDS_TEAM, 1, teams, corners_, state.bounds.bounds);
}

}  // namespace cama
