// SPDX-License-Identifier: Apache-2.0
#include "stages/find_contacts.hpp"

#include "launch.hpp"

namespace cama {

void FindContacts::run(State &state)
{
  Backend &b = *state.backend;
  // The paper's proximity is a distance alone; by default contacts also act on pairs that would close within the step.
  const double anticipate = state.options.anticipate_contacts ? 20 * state.contact_settings.thickness : 0.0;
  PairList *lists[2] = {&state.vertex_face, &state.edge_edge};
  FlaggedPairs *flagged[2] = {&vertex_face_, &edge_edge_};
  for (int kind = 0; kind < 2; ++kind) {
    PairList &list = *lists[kind];
    flagged[kind]->resize(list.pairs.size());
    CAMA_LAUNCH(b, find_contacts, list.pairs.size(), kind, list.pairs, state.face, state.edge, state.position, state.predicted,
                state.vertex_contact, anticipate, flagged[kind]->flag, list.direction);
  }
  if (anticipate > 0) {
    nearest_.resize(SIDES * state.cloth_vertices);
    b.fill(nearest_.buffer(), 0x7f, nearest_.bytes());   // a float of 3e38
    for (int kind = 0; kind < 2; ++kind)
      CAMA_LAUNCH(b, nearest_contacts, lists[kind]->pairs.size(), kind, lists[kind]->pairs, state.face, state.edge, state.position,
                  state.vertex_contact, state.cloth_vertices, flagged[kind]->flag, nearest_);
    for (int kind = 0; kind < 2; ++kind)
      CAMA_LAUNCH(b, drop_hidden_contacts, lists[kind]->pairs.size(), kind, lists[kind]->pairs, state.face, state.edge, state.position,
                  state.vertex_contact, state.cloth_vertices, nearest_, flagged[kind]->flag);
  }
  const int faces = vertex_face_.compact(b, state.vertex_face), edges = edge_edge_.compact(b, state.edge_edge);
  state.contacts = faces + edges;
  state.contact.resize(state.contacts);
  const auto fill = [&](int kind, const PairList &list, const FlaggedPairs &flagged, int first) {
    CAMA_LAUNCH(b, fill_contacts, flagged.index.size(), kind, flagged.index, list.pairs, state.face, state.edge, state.position,
                state.predicted, state.vertex_contact, anticipate, first, state.contact);
  };
  fill(0, state.vertex_face, vertex_face_, 0);
  fill(1, state.edge_edge, edge_edge_, faces);
  state.report.contacts = state.contacts;
}

}  // namespace cama
