// SPDX-License-Identifier: Apache-2.0
#include "stages/certified_commit.hpp"

#include <algorithm>
#include <cstring>
#include <tuple>

#include "device/launch.hpp"

namespace cama {
namespace {

float as_fraction(int bits)
{
  float value;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}

}  // namespace

CertifiedCommit::CertifiedCommit(Backend &b, FlaggedPairs &flagged)
    : flagged_(flagged), committed_(b), fraction_(b), fraction_before_(b), vertex_changed_(b), face_changed_(b),
      edge_changed_(b), outcome_(b, COMMIT_OUTCOMES)
{}

double CertifiedCommit::run(const Rooms &state, const Stream<dvec3> &from, bool certified)
{
  Backend &b = *state.backend;
  const MeshState &mesh = state.mesh;
  for (Stream<int> *stream : {&fraction_, &fraction_before_, &vertex_changed_}) stream->resize(mesh.vertices);
  face_changed_.resize(mesh.faces);
  edge_changed_.resize(mesh.edges);
  CAMA_LAUNCH(b, commit_begin, mesh.vertices, fraction_, fraction_before_, outcome_);
  const PairList *lists[2] = {&state.contact.vertex_face, &state.contact.edge_edge};
  const int first[2] = {0, lists[0]->pairs.size()};
  Stream<int> &accepted = flagged_.flag;
  flagged_.resize(state);
  for (int kind = 0; kind < 2; ++kind) {
    CAMA_LAUNCH(b, commit_screen, lists[kind]->pairs.size(), kind, first[kind], certified ? 1 : 0, lists[kind]->pairs,
                mesh.face, mesh.edge, from, mesh.position_next, lists[kind]->direction, state.contact.vertex_contact,
                lists[kind]->gap_bound, certified_distance, accepted);
  }
  std::vector<int> outcome(COMMIT_OUTCOMES, 0);
  for (int pass = 0;; ++pass) {
    CAMA_LAUNCH_TEAMS(void, b, commit_pairs, PAIR_TEAM, flagged_.teams(), flagged_.runs(), accepted.size(), first[1],
                      pass, lists[0]->pairs, lists[1]->pairs, mesh.face, mesh.edge, from, mesh.position_next,
                      mesh.inverse_mass, state.contact.vertex_contact, certified_distance, 0, vertex_changed_,
                      face_changed_, edge_changed_, accepted, fraction_before_, fraction_, outcome_);
    CAMA_LAUNCH(b, commit_changes, mesh.vertices, fraction_, fraction_before_, vertex_changed_, outcome_);
    const int changes = outcome[COMMIT_CHANGES];
    outcome = outcome_.download();
    if (outcome[COMMIT_CHANGES] == changes) break;
    CAMA_LAUNCH(b, commit_disturb, mesh.faces + mesh.edges, mesh.faces, mesh.face, mesh.edge, vertex_changed_,
                face_changed_, edge_changed_);
  }
  committed_.resize(mesh.vertices);
  CAMA_LAUNCH(b, commit_apply, mesh.vertices, from, mesh.position_next, fraction_, outcome_, committed_);
  if (outcome[COMMIT_CHANGES] > 0) {
    const std::vector<int> fraction = fraction_.download();
    double lost = 0;
    for (int i = 0; i < mesh.cloth_vertices; ++i)
      if (fraction[i] != COMMIT_WHOLE) {
        ++state.report.truncated;
        lost += 1 - as_fraction(fraction[i]);
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
