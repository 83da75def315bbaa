// SPDX-License-Identifier: Apache-2.0
#include "stages/find_contacts.hpp"

#include "launch.hpp"

namespace cama {

void FindContacts::run(State &state)
{
  Backend &b = *state.backend;
  // The paper's proximity is a distance alone; by default contacts also act on pairs that would close within the step.
  const double anticipate = state.options.anticipate_contacts ? 20 * state.contact_settings.thickness : 0.0;
  const auto count = [&](int kind, PairList &list, FlaggedPairs &flagged) {
    flagged.resize(list.pairs.size());
    CAMA_LAUNCH(b, find_contacts, list.pairs.size(), kind, list.pairs, state.face, state.edge, state.position, state.predicted,
                state.vertex_contact, anticipate, flagged.flag, list.direction);
    return flagged.compact(b, list);
  };
  const int faces = count(0, state.vertex_face, vertex_face_);
  const int edges = count(1, state.edge_edge, edge_edge_);
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
