// SPDX-License-Identifier: Apache-2.0
#include "stages/gap_bounds.hpp"

#include "device/launch.hpp"

namespace cama {

void GapBounds::find(const Rooms &state, const Stream<dvec3> &from, const Stream<dvec3> &to, bool contacts)
{
  Backend &b = *state.backend;
  PairList &vertex_face = state.contact.vertex_face, &edge_edge = state.contact.edge_edge;
  const int first = vertex_face.pairs.size(), n = first + edge_edge.pairs.size();
  swept_vertices.resize(state.mesh.vertices);
  listed_.resize(state);
  for (PairList *list : {&vertex_face, &edge_edge}) list->direction.resize(list->pairs.size());
  CAMA_LAUNCH(b, make_swept_vertices, state.mesh.vertices, from, to, state.bounds.bounds, state.contact.vertex_contact,
              swept_vertices, rounding_margin, found);
  {
    const SideBySide side_by_side(b);
    CAMA_LAUNCH(b, cull_separated_pairs, first, 0, contacts ? 1 : 0, vertex_face.pairs, state.mesh.face,
                state.mesh.edge, swept_vertices, rounding_margin, vertex_face.direction, vertex_face.gap_bound);
    CAMA_LAUNCH(b, cull_separated_pairs, n - first, 1, contacts ? 1 : 0, edge_edge.pairs, state.mesh.face,
                state.mesh.edge, swept_vertices, rounding_margin, edge_edge.direction, edge_edge.gap_bound);
  }
  CAMA_LAUNCH_TEAMS(void, b, list_near_pairs, PAIR_TEAM, listed_.teams(), n, first, vertex_face.gap_bound,
                    edge_edge.gap_bound, listed_.list, found);
}

void GapBounds::find_all(const Rooms &state, const Stream<dvec3> &from, const Stream<dvec3> &to)
{
  find(state, from, to, false);
  PairList &vertex_face = state.contact.vertex_face, &edge_edge = state.contact.edge_edge;
  CAMA_LAUNCH_TEAMS(void, *state.backend, bound_near_pairs, PAIR_TEAM, listed_.list_teams(), vertex_face.pairs.size(),
                    listed_.list, found, vertex_face.pairs, edge_edge.pairs, state.mesh.face, state.mesh.edge, from,
                    swept_vertices, rounding_margin, state.contact.vertex_contact, vertex_face.direction,
                    vertex_face.gap_bound, edge_edge.direction, edge_edge.gap_bound);
}

}  // namespace cama
