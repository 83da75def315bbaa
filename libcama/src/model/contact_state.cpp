// SPDX-License-Identifier: Apache-2.0
#include "model/contact_state.hpp"

namespace cama {

void ContactState::forget() noexcept
{
  contacts = 0;
  if (contact.backend()) contact.resize(0);
  for (PairList *list : {&vertex_face, &edge_edge}) {
    if (!list->pairs.backend()) continue;
    list->pairs.resize(0);
    list->direction.resize(0);
    list->gap_bound.resize(0);
  }
}

}  // namespace cama
