// SPDX-License-Identifier: Apache-2.0
#include "stages/certified_commit.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <tuple>

#include "device/ceil_divide.hpp"
#include "device/launch.hpp"

namespace cama {
namespace {

// From this pass on, where the one before has truncated no more than this share of the vertices, passes look at the
// pairs nearby, which are gathered at the cost of a pass over all.
constexpr int first_gathering = 3;
constexpr double few_truncated = 1. / 128;
// A neighbourhood is to hold this share of the vertices, in cells of so many distances of vertices.
constexpr double share_nearby = 1. / 2, least_cell = 2, largest_cell = 64;
constexpr int cells_beside = 8;  // that each truncated vertex marks

float as_fraction(int bits)
{
  float value;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}

}  // namespace

CertifiedCommit::CertifiedCommit(Backend &b, FlaggedPairs &flagged)
    : flagged_(flagged), committed_(b), fraction_(b), fraction_before_(b), vertex_changed_(b), cell_marked_(b),
      neighbourhood_(b), marked_(b), loss_(b), outcome_(b, COMMIT_OUTCOMES)
{}

void CertifiedCommit::find_neighbourhood(const Rooms &state, const Stream<dvec3> &from, int truncated)
{
  Backend &b = *state.backend;
  const int vertices = state.mesh.vertices;
  int cells = 64;
  while (cells < vertices / 4) cells *= 2;
  const double in_cell = share_nearby * vertices / (cells_beside * static_cast<double>(std::max(truncated, 1))),
               size = state.bounds.spacing * std::clamp(std::sqrt(in_cell), least_cell, largest_cell);
  cell_marked_.resize(cells);
  cell_marked_.fill_zero();
  CAMA_LAUNCH(b, commit_mark_cells, vertices, from, vertex_changed_, size, cells - 1, cell_marked_);
  CAMA_LAUNCH(b, commit_neighbourhood, vertices, from, vertex_changed_, size, cells - 1, cell_marked_, neighbourhood_);
}

bool CertifiedCommit::complete(const Rooms &state, CandidateSearch &search, const Stream<dvec3> &from)
{
  Backend &b = *state.backend;
  const PairList &vertex_face = state.contact.vertex_face, &edge_edge = state.contact.edge_edge;
  const int faces = vertex_face.pairs.size(), edges = edge_edge.pairs.size();
  committed_.resize(state.mesh.vertices);
  CAMA_LAUNCH(b, commit_ends, state.mesh.vertices, from, state.mesh.position_next, fraction_, committed_);
  flagged_.keep();   // a search overwrites the flags
  const bool more = search.complete(state, from, committed_, certified_distance * state.contact.largest_thickness);
  flagged_.resize(state);
  CAMA_LAUNCH(b, commit_extend, flagged_.flag.size(), vertex_face.pairs.size(), faces, edges, flagged_.before(),
              flagged_.flag, flagged_.list, outcome_);
  return more;
}

void CertifiedCommit::recheck(const Rooms &state, int pairs, int of, int to, int counter)
{
  const MeshState &mesh = state.mesh;
  const PairList &vertex_face = state.contact.vertex_face, &edge_edge = state.contact.edge_edge;
  Stream<int> &list = flagged_.list;
  CAMA_LAUNCH(*state.backend, commit_disturb, marked_.size(), mesh.vertices, mesh.faces, mesh.face, mesh.edge,
              counter == COMMIT_LISTED ? vertex_changed_ : neighbourhood_, marked_);
  CAMA_LAUNCH_TEAMS(void, *state.backend, commit_recheck, PAIR_TEAM, ceil_divide(pairs, RUN_PAIRS), pairs, of,
                    vertex_face.pairs.size(), mesh.vertices, mesh.faces, vertex_face.pairs, edge_edge.pairs, marked_,
                    flagged_.flag, to, list.size() - to, list, counter, outcome_);
}

double CertifiedCommit::run(const Rooms &state, CandidateSearch &search, const Stream<dvec3> &from, bool certified,
                            const Stream<float> *errors)
{
  Backend &b = *state.backend;
  const MeshState &mesh = state.mesh;
  for (Stream<int> *stream : {&fraction_, &fraction_before_, &vertex_changed_, &neighbourhood_})
    stream->resize(mesh.vertices);
  marked_.resize(static_cast<long long>(mesh.vertices) + mesh.faces + mesh.edges);
  neighbourhood_.fill_zero();
  CAMA_LAUNCH(b, commit_begin, mesh.vertices, fraction_, fraction_before_, outcome_);
  const PairList &vertex_face = state.contact.vertex_face, &edge_edge = state.contact.edge_edge;
  Stream<int> &accepted = flagged_.flag, &list = flagged_.list;
  flagged_.resize(state);
  CAMA_LAUNCH_TEAMS(void, b, commit_screen, PAIR_TEAM, flagged_.teams(), accepted.size(), vertex_face.pairs.size(),
                    mesh.vertices, mesh.faces, certified ? 1 : 0, vertex_face.pairs, edge_edge.pairs, mesh.face,
                    mesh.edge, from, mesh.position_next, vertex_face.direction, edge_edge.direction,
                    state.contact.vertex_contact, errors ? vertex_face.gap_bound.size() : 0, vertex_face.gap_bound,
                    errors ? edge_edge.gap_bound.size() : 0, edge_edge.gap_bound, errors ? *errors : no_errors_,
                    certified_distance, state.contact.largest_thickness, accepted, list, outcome_);
  std::vector<int> outcome(COMMIT_OUTCOMES, 0);
  bool completed = false;  // the list has the pairs that were appended
  int completed_at = 0;    // changes when they were
  int truncated = mesh.vertices, nearby = -1;  // of the last pass; pairs of the neighbourhood, -1: all
  for (int pass = 0;; ++pass) {
    const int first = vertex_face.pairs.size(), changes = outcome[COMMIT_CHANGES], outside = outcome[COMMIT_OUTSIDE];
    // The second half of the list has the pairs nearby.
    const int pairs = accepted.size(), half = pairs - pairs / 2;
    if (pass > 0 && !completed) {
      if (nearby < 0 && pass >= first_gathering && truncated <= few_truncated * mesh.vertices) {
        find_neighbourhood(state, from, truncated);
        recheck(state, pairs, -1, half, COMMIT_NEARBY);
        nearby = outcome_.at(COMMIT_NEARBY);
        if (nearby > pairs - half) nearby = -1;
      }
      recheck(state, nearby < 0 ? pairs : nearby, nearby < 0 ? -1 : half, 0, COMMIT_LISTED);
    }
    CAMA_LAUNCH_TEAMS(void, b, commit_pairs, PAIR_TEAM, flagged_.list_teams(), first, pass, list, vertex_face.pairs,
                      edge_edge.pairs, mesh.face, mesh.edge, from, mesh.position_next, mesh.inverse_mass,
                      state.contact.vertex_contact, certified_distance, 0, accepted, fraction_before_, fraction_,
                      outcome_);
    CAMA_LAUNCH(b, commit_changes, mesh.vertices, fraction_, neighbourhood_, fraction_before_, vertex_changed_,
                outcome_);
    outcome = outcome_.download();
    truncated = outcome[COMMIT_CHANGES] - changes;
    completed = false;
    if (outcome[COMMIT_OUTSIDE] > outside) nearby = -1;
    if (truncated > 0) continue;
    if (changes == completed_at || search.end_boxes().size() == 0) break;
    completed = complete(state, search, from);
    if (!completed) break;
    completed_at = changes;
    nearby = -1;  // the places of pairs have changed
  }
  committed_.resize(mesh.vertices);
  CAMA_LAUNCH(b, commit_apply, mesh.vertices, from, mesh.position_next, fraction_, outcome_, committed_);
  if (outcome[COMMIT_CHANGES] > 0) {
    loss_.resize(ceil_divide(mesh.cloth_vertices, LOST_VERTICES));
    CAMA_LAUNCH(b, commit_losses, loss_.size(), mesh.cloth_vertices, fraction_, loss_);
    double lost = 0;
    for (const kernels::commit_loss &loss : loss_.download()) {
      state.report.truncated += loss.vertices;
      lost += loss.motion;
    }
    state.report.lost_motion += lost / mesh.cloth_vertices;
  }
  return as_fraction(outcome[COMMIT_SIGMA]);
}

std::vector<std::pair<int, kernels::pair>> CertifiedCommit::pausing_pairs(const Rooms &state)
{
  std::vector<std::pair<int, kernels::pair>> pausing;
  const std::vector<int> accepted = flagged_.flag.download();
  std::size_t at = 0;
  for (int kind = 0; kind < 2; ++kind)
    for (const kernels::pair &p : (kind == 0 ? state.contact.vertex_face : state.contact.edge_edge).pairs.download())
      if (accepted[at++] == COMMIT_PAUSING) pausing.emplace_back(kind, p);
  std::sort(pausing.begin(), pausing.end(), [](const auto &p, const auto &q) {
    return std::tie(p.first, p.second.a, p.second.b) < std::tie(q.first, q.second.a, q.second.b);
  });
  return pausing;
}

}  // namespace cama
