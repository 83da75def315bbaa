// SPDX-License-Identifier: Apache-2.0
#include "stages/pair_runs.hpp"

#include "device/ceil_divide.hpp"
#include "device/launch.hpp"

namespace cama {

void PairRuns::bound(const Rooms &state, const Stream<dvec3> &position)
{
  Backend &b = *state.backend;
  const SideBySide side_by_side(b);
  for (int kind = 0; kind < 2; ++kind) {
    const Stream<kernels::pair> &pairs = (kind == 0 ? state.contact.vertex_face : state.contact.edge_edge).pairs;
    const int runs = ceil_divide(pairs.size(), RUN_PAIRS), first = bounded_[kind] / RUN_PAIRS;
    if (pairs.size() == bounded_[kind]) continue;
    box_[kind].grow(runs);
    CAMA_LAUNCH_TEAMS(void, b, bound_runs, PAIR_TEAM, runs - first, kind, first, pairs.size(), pairs, state.mesh.face,
                      state.mesh.edge, position, state.bounds.box_origin(), box_[kind]);
    bounded_[kind] = pairs.size();
  }
}

void PairRuns::list_marked(const Rooms &state, const Stream<dvec3> &position, double cell_size,
                           const Stream<int> &cell_marked, int mark, int counter, Stream<int> &found)
{
  bound(state, position);
  const int first = ceil_divide(state.contact.vertex_face.pairs.size(), RUN_PAIRS),
            runs = first + ceil_divide(state.contact.edge_edge.pairs.size(), RUN_PAIRS);
  list.resize(runs);
  CAMA_LAUNCH_TEAMS(void, *state.backend, list_marked_runs, PAIR_TEAM, ceil_divide(runs, PAIR_TEAM), runs, first,
                    box_[0], box_[1], cell_size, cell_marked.size() - 1, cell_marked, mark, list, counter, found);
}

}  // namespace cama
