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
// runs of pairs nearby, whose boxes cost more than one pass over all pairs.
constexpr int first_pass_of_runs = 3;
constexpr double few_truncated = 1. / 128;
constexpr double cell_size = 8;  // of the cells that truncated vertices mark, in distances of vertices
constexpr int least_cells = 64;

float as_fraction(int bits)
{
  float value;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}

}  // namespace

CertifiedCommit::CertifiedCommit(Backend &b, ListedPairs &listed)
    : listed_(listed), committed_(b), fraction_(b), fraction_before_(b), vertex_changed_(b), cell_marked_(b), runs_(b),
      marked_(b), loss_(b), outcome_(b, COMMIT_OUTCOMES)
{}

bool CertifiedCommit::complete(const Rooms &state, CandidateSearch &search, const Stream<dvec3> &from)
{
  Backend &b = *state.backend;
  const PairList &vertex_face = state.contact.vertex_face, &edge_edge = state.contact.edge_edge;
  const int faces = vertex_face.pairs.size(), edges = edge_edge.pairs.size();
  committed_.resize(state.mesh.vertices);
  CAMA_LAUNCH(b, commit_ends, state.mesh.vertices, from, state.mesh.position_next, fraction_, committed_);
  listed_.keep();   // a search overwrites the flags
  const bool more = search.complete(state, from, committed_, certified_distance * state.contact.largest_thickness);
  listed_.resize(state);
  CAMA_LAUNCH(b, commit_extend, listed_.flag.size(), vertex_face.pairs.size(), faces, edges, listed_.spare,
              listed_.flag, listed_.list, outcome_);
  return more;
}

void CertifiedCommit::recheck(const Rooms &state, const Stream<dvec3> &from, int pass, int truncated)
{
  Backend &b = *state.backend;
  const MeshState &mesh = state.mesh;
  const Stream<kernels::pair> &vertex_face = state.contact.vertex_face.pairs,
                              &edge_edge = state.contact.edge_edge.pairs;
  if (pass >= first_pass_of_runs && truncated <= few_truncated * mesh.vertices) {
    runs_.list_marked(state, from, cell_size * state.bounds.spacing, cell_marked_, pass, COMMIT_RUNS, outcome_);
    CAMA_LAUNCH_TEAMS(void, b, commit_recheck_runs, PAIR_TEAM, std::min(runs_.list.size(), LIST_TEAMS),
                      vertex_face.size(), edge_edge.size(), runs_.list, vertex_face, edge_edge, mesh.face, mesh.edge,
                      vertex_changed_, listed_.flag, listed_.list, outcome_);
    return;
  }
  marked_.resize(static_cast<long long>(mesh.vertices) + mesh.faces + mesh.edges);
  CAMA_LAUNCH(b, commit_disturb, marked_.size(), mesh.vertices, mesh.faces, mesh.face, mesh.edge, vertex_changed_,
              marked_);
  CAMA_LAUNCH_TEAMS(void, b, commit_recheck, PAIR_TEAM, listed_.teams(), listed_.flag.size(), vertex_face.size(),
                    mesh.vertices, mesh.faces, vertex_face, edge_edge, marked_, listed_.flag, listed_.list, outcome_);
}

double CertifiedCommit::run(const Rooms &state, CandidateSearch &search, const Stream<dvec3> &from, bool certified,
                            const Stream<float> *errors)
{
  Backend &b = *state.backend;
  const MeshState &mesh = state.mesh;
  for (Stream<int> *stream : {&fraction_, &fraction_before_, &vertex_changed_}) stream->resize(mesh.vertices);
  int cells = least_cells;
  while (cells < mesh.vertices / 4) cells *= 2;
  cell_marked_.resize(cells);
  runs_.forget();
  CAMA_LAUNCH(b, commit_begin, std::max(mesh.vertices, cells), mesh.vertices, cells, fraction_, fraction_before_,
              cell_marked_, outcome_);
  const PairList &vertex_face = state.contact.vertex_face, &edge_edge = state.contact.edge_edge;
  Stream<int> &accepted = listed_.flag, &list = listed_.list;
  listed_.resize(state);
  CAMA_LAUNCH_TEAMS(void, b, commit_screen, PAIR_TEAM, listed_.teams(), accepted.size(), vertex_face.pairs.size(),
                    mesh.vertices, mesh.faces, certified ? 1 : 0, vertex_face.pairs, edge_edge.pairs, mesh.face,
                    mesh.edge, from, mesh.position_next, vertex_face.direction, edge_edge.direction,
                    state.contact.vertex_contact, errors ? vertex_face.gap_bound.size() : 0, vertex_face.gap_bound,
                    errors ? edge_edge.gap_bound.size() : 0, edge_edge.gap_bound, errors ? *errors : no_errors_,
                    certified_distance, state.contact.largest_thickness, accepted, list, outcome_);
  std::vector<int> outcome(COMMIT_OUTCOMES, 0);
  bool completed = false;  // the list has the pairs that were appended
  int completed_at = 0;    // changes when they were
  int truncated = 0;  // by the last pass
  for (int pass = 0;; ++pass) {
    const int first = vertex_face.pairs.size(), changes = outcome[COMMIT_CHANGES];
    if (pass > 0 && !completed) recheck(state, from, pass, truncated);
    const auto decide = [&](auto &&...arguments) {
      if (listed_.many())
        CAMA_LAUNCH_TEAMS(void, b, commit_many_pairs, PAIR_TEAM, listed_.list_teams(), arguments...);
      else
        CAMA_LAUNCH_TEAMS(void, b, commit_pairs, PAIR_TEAM, listed_.list_teams(), arguments...);
    };
    decide(first, pass, list, vertex_face.pairs, edge_edge.pairs, mesh.face, mesh.edge, from, mesh.position_next,
           mesh.inverse_mass, state.contact.vertex_contact, certified_distance, 0, accepted, fraction_before_,
           fraction_, outcome_);
    CAMA_LAUNCH(b, commit_changes, mesh.vertices, fraction_, from, state.bounds.box_origin(),
                cell_size * state.bounds.spacing, cells - 1, pass + 1, fraction_before_, vertex_changed_, cell_marked_,
                outcome_);
    outcome = outcome_.download();
    truncated = outcome[COMMIT_CHANGES] - changes;
    completed = false;
    if (truncated > 0) continue;
    if (changes == completed_at || search.end_boxes().size() == 0) break;
    completed = complete(state, search, from);
    if (!completed) break;
    completed_at = changes;
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
  const std::vector<int> accepted = listed_.flag.download();
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
