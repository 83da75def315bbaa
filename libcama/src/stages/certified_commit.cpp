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
    : flagged_(flagged), committed_(b), fraction_(b), fraction_before_(b), sigma_(b, 1), counter_(b, 2)
{}

double CertifiedCommit::run(const Rooms &state, const Stream<dvec3> &from, bool certified)
{
  Backend &b = *state.backend;
  fraction_.resize(state.mesh.vertices);
  fraction_before_.resize(state.mesh.vertices);
  CAMA_LAUNCH(b, commit_begin, state.mesh.vertices, fraction_, sigma_, counter_);
  const PairList *lists[2] = {&state.contact.vertex_face, &state.contact.edge_edge};
  const int first[2] = {0, lists[0]->pairs.size()};
  Stream<int> &accepted = flagged_.flag;
  flagged_.resize(state);
  int settled = -1;
  for (int kind = 0; kind < 2; ++kind) {
    CAMA_LAUNCH(b, commit_screen, lists[kind]->pairs.size(), kind, first[kind], certified ? 1 : 0, lists[kind]->pairs,
                state.mesh.face, state.mesh.edge, from, state.mesh.position_next, lists[kind]->direction,
                state.contact.vertex_contact, lists[kind]->gap_bound, certified_distance, accepted);
  }
  for (int pass = 0;; ++pass) {
    if (pass > 0) fraction_before_.copy_from(fraction_);
    for (int kind = 0; kind < 2; ++kind)
      CAMA_LAUNCH(b, commit_pairs, lists[kind]->pairs.size(), kind, first[kind], pass, lists[kind]->pairs,
                  state.mesh.face, state.mesh.edge, from, state.mesh.position_next, state.mesh.inverse_mass,
                  state.contact.vertex_contact, certified_distance, 0, accepted, fraction_before_, fraction_, sigma_,
                  counter_);
    const int now = counter_.at(0);
    if (now == settled) break;
    settled = now;
  }
  const double sigma = as_fraction(sigma_.at(0));
  committed_.resize(state.mesh.vertices);
  CAMA_LAUNCH(b, commit_apply, state.mesh.vertices, from, state.mesh.position_next, fraction_, sigma_, committed_);
  const std::vector<int> fraction = fraction_.download();
  double lost = 0;
  for (int i = 0; i < state.mesh.cloth_vertices; ++i)
    if (fraction[i] != COMMIT_WHOLE) {
      ++state.report.truncated;
      lost += 1 - as_fraction(fraction[i]);
    }
  state.report.lost_motion += lost / state.mesh.cloth_vertices;
  return sigma;
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
