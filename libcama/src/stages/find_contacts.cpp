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
  bounds_.find(state, state.mesh.position, state.bounds.predicted, true);
  listed_.spare.resize(listed_.list.size());
  Stream<int> &found = bounds_.found, *code = &listed_.spare;
  int count = NEAR_CONTACTS;
  CAMA_LAUNCH_TEAMS(void, b, find_contacts, PAIR_TEAM, listed_.list_teams(), vertex_face.pairs.size(), found,
                    vertex_face.pairs, edge_edge.pairs, state.mesh.face, state.mesh.edge, state.mesh.edge_wing,
                    state.mesh.position, state.bounds.predicted, bounds_.swept_vertices, bounds_.rounding_margin,
                    state.contact.vertex_contact, anticipate, vertex_face.direction, vertex_face.gap_bound,
                    edge_edge.direction, edge_edge.gap_bound, listed_.list);
  CAMA_LAUNCH_TEAMS(void, b, collect_contacts, PAIR_TEAM, listed_.list_teams(), listed_.list, *code, found);
  if (anticipate > 0) {
    nearest_.resize(SIDES * state.mesh.cloth_vertices);
    b.fill(nearest_.buffer(), 0x7f, nearest_.bytes());  // each a float of 3e38
    CAMA_LAUNCH_TEAMS(void, b, nearest_contacts, PAIR_TEAM, listed_.list_teams(), *code, found, vertex_face.pairs,
                      edge_edge.pairs, state.mesh.face, state.mesh.edge, state.mesh.position,
                      state.contact.vertex_contact, state.mesh.cloth_vertices, nearest_);
    CAMA_LAUNCH_TEAMS(void, b, drop_hidden_contacts, PAIR_TEAM, listed_.list_teams(), *code, vertex_face.pairs,
                      edge_edge.pairs, state.mesh.face, state.mesh.edge, state.mesh.position,
                      state.contact.vertex_contact, state.mesh.cloth_vertices, nearest_, listed_.list, found);
    code = &listed_.list;
    count = NEAR_KEPT;
  }
  state.contact.contacts = found.at(count);
  listed_.order(state, *code, state.contact.contacts);
  state.contact.contact.resize(state.contact.contacts);
  CAMA_LAUNCH(b, fill_contacts, state.contact.contacts, listed_.index, vertex_face.pairs, edge_edge.pairs,
              state.mesh.face, state.mesh.edge, state.mesh.edge_wing, state.mesh.position, state.bounds.predicted,
              state.contact.vertex_contact, anticipate, state.contact.contact);
  if (state.contact.kept.key.backend()) listed_.copy_keys(*state.backend, state.contact.kept_next.key);
  state.report.contacts = state.contact.contacts;
}

}  // namespace cama
