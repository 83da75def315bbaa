// SPDX-License-Identifier: Apache-2.0
#include "stages/find_contacts.hpp"

#include "device/launch.hpp"

namespace cama {

void FindContacts::run_on(const Rooms &state)
{
  Backend &b = *state.backend;
  // The paper's proximity is a distance alone; by default contacts also act on pairs that would close within the step.
  const double anticipate = state.options.paper.anticipate_contacts ? 20 * state.contact.settings.thickness : 0.0;
  PairList &vertex_face = state.contact.vertex_face, &edge_edge = state.contact.edge_edge;
  const int first = vertex_face.pairs.size();
  const Stream<int> &listed = bounds_.near_pairs;
  bounds_.find(state, state.mesh.position, state.bounds.predicted);
  CAMA_LAUNCH_TEAMS(void, b, find_contacts, PAIR_TEAM, flagged_.list_teams(), first, flagged_.list, listed,
                    vertex_face.pairs, edge_edge.pairs, state.mesh.face, state.mesh.edge, state.mesh.edge_wing,
                    state.mesh.position, state.bounds.predicted, bounds_.swept_vertices, bounds_.rounding_margin,
                    state.contact.vertex_contact, anticipate, flagged_.flag, vertex_face.direction,
                    vertex_face.gap_bound, edge_edge.direction, edge_edge.gap_bound);
  if (anticipate > 0) {
    nearest_.resize(SIDES * state.mesh.cloth_vertices);
    b.fill(nearest_.buffer(), 0x7f, nearest_.bytes());  // each a float of 3e38
    CAMA_LAUNCH_TEAMS(void, b, nearest_contacts, PAIR_TEAM, flagged_.list_teams(), first, flagged_.list, listed,
                      vertex_face.pairs, edge_edge.pairs, state.mesh.face, state.mesh.edge, state.mesh.position,
                      state.contact.vertex_contact, state.mesh.cloth_vertices, flagged_.flag, nearest_);
    CAMA_LAUNCH_TEAMS(void, b, drop_hidden_contacts, PAIR_TEAM, flagged_.list_teams(), first, flagged_.list, listed,
                      vertex_face.pairs, edge_edge.pairs, state.mesh.face, state.mesh.edge, state.mesh.position,
                      state.contact.vertex_contact, state.mesh.cloth_vertices, nearest_, flagged_.flag);
  }
  state.contact.contacts = flagged_.compact(state);
  state.contact.contact.resize(state.contact.contacts);
  CAMA_LAUNCH(b, fill_contacts, state.contact.contacts, first, flagged_.index, vertex_face.pairs, edge_edge.pairs,
              state.mesh.face, state.mesh.edge, state.mesh.edge_wing, state.mesh.position, state.bounds.predicted,
              state.contact.vertex_contact, anticipate, state.contact.contact);
  if (state.contact.kept.key.backend()) flagged_.copy_keys(*state.backend, state.contact.kept_next.key);
  state.report.contacts = state.contact.contacts;
}

}  // namespace cama
