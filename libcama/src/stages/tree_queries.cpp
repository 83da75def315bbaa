// SPDX-License-Identifier: Apache-2.0
// What features meet in trees: the queries of TreeSearch.
#include <algorithm>
#include <iterator>
#include <optional>
#include <utility>

#include "device/ceil_divide.hpp"
#include "device/launch.hpp"
#include "stages/tree_search.hpp"

namespace cama {
namespace {
constexpr int items_per_pool = 4096; // of blocks of hits
// A few vertices query a tree in parts of so many groups of level 0: the sphere around the centre of an exact obstacle
// may hold most of the cloth, which is too much for one thread.
constexpr int few_vertices = 64, part_groups = 8;
constexpr int many_items = 32768;  // of which devices without wide workers copy the hits side by side
constexpr int many_walks = 65536;  // from which on such devices let neighbouring items walk a tree together
constexpr int many_changed = 16384;  // the same for edges that have changed
}  // namespace

long long TreeSearch::most_hit_blocks(int items)
{
  return std::max(0LL, (Stream<int>::most - static_cast<long long>(HIT_ROW) * items) / HIT_BLOCK);
}

long long TreeSearch::blocks_wanted() const
{
  const long long own = blocks_[static_cast<int>(motion_)];
  return own > 0 ? own : *std::max_element(std::begin(blocks_), std::end(blocks_));
}

// In an update a team walks for each item, if the device has as many work-items: there are few, which meet many leaves.
TreeSearch::Walk TreeSearch::walk_of(int mode, int items, bool in_order) const
{
  if (batch_ > 1) return mode == QUERY_CHANGED ? Walk::alone : Walk::batch;
  if (in_order && items > (mode == QUERY_CHANGED ? many_changed : many_walks)) return Walk::together;
  const bool update = mode == QUERY_CHANGED || mode == QUERY_UNCHANGED;
  return update && items <= workers_ ? Walk::team : Walk::alone;
}

// Items share only where they would leave most of the device idle: shares take memory for their hits.
int TreeSearch::shares_of(int items) const { return items <= workers_ / (GROUP * GROUP) ? GROUP : 1; }

int TreeSearch::vertex_shares_of(int vertices) const { return vertices > few_vertices ? shares_of(vertices) : 1; }

TreeSearch::Walk TreeSearch::walk_of(const FaceQuery &q) const
{
  const bool in_order = q.mode != QUERY_CHANGED;
  return in_parts(q) || q.shares > 1 ? Walk::alone : walk_of(q.mode, items_of(q), in_order);
}

TreeSearch::Walk TreeSearch::walk_of(const EdgeQuery &q) const
{
  return q.shares > 1 ? Walk::alone : walk_of(q.mode, items_of(q), true);
}

bool TreeSearch::in_parts(const FaceQuery &q) const
{
  const int n = q.items->size();
  return n <= few_vertices && (q.mode != QUERY_CHANGED || walk_of(q.mode, n, false) != Walk::team);
}

/// Groups of level 0 in a part of the tree.
int TreeSearch::part_of(const FaceQuery &q) const
{
  return in_parts(q) ? part_groups : kernels::group_level_size(q.leaves, 0);
}

int TreeSearch::items_of(const FaceQuery &q) const
{
  return q.items->size() * kernels::tree_parts(q.leaves, part_of(q)) * q.shares;
}

int TreeSearch::items_of(const EdgeQuery &q) { return q.items->size() * q.shares; }

/// Counts the candidates of the query vertices and edges and appends them to the lists, with one wait for all.
void TreeSearch::query(const SearchRooms &state, const std::vector<FaceQuery> &faces,
                       const std::vector<EdgeQuery> &edges)
{
  Backend &b = *state.backend;
  const int self = self_ ? 1 : 0;
  int vertex_items = 0, edge_items = 0;
  for (const FaceQuery &q : faces) vertex_items += items_of(q);
  for (const EdgeQuery &q : edges) edge_items += items_of(q);
  const int items = vertex_items + edge_items;
  ++state.report.searches;
  if (items == 0) return;
  const long long blocks_at = static_cast<long long>(HIT_ROW) * items;
  const int pools = std::clamp(items / items_per_pool, 1, MOST_POOLS),
            pool_blocks = static_cast<int>(std::clamp(blocks_wanted(), 0LL, most_hit_blocks(items)) / pools);
  hit_.resize(blocks_at + static_cast<long long>(HIT_BLOCK) * pool_blocks * pools);
  const int first_block = static_cast<int>(blocks_at);
  count_.resize(items);
  offset_.resize(items + 1);
  int at = 0;
  std::optional<Fork> fork;
  if (meanwhile) fork.emplace(b);
  std::optional<SideBySide> side_by_side(b);
  for (const FaceQuery &q : faces) {
    const int n = items_of(q);
    const Walk walk = walk_of(q);
    const auto teams_walk = [&](auto &&...arguments) {
      if (walk == Walk::team)
        CAMA_LAUNCH_TEAMS(void, b, item_query_vertex_face, ITEM_TEAM, n, arguments...);
      else
        CAMA_LAUNCH_TEAMS(void, b, team_query_vertex_face, QUERY_TEAM, ceil_divide(n, QUERY_TEAM), n, arguments...);
    };
    if (walk == Walk::team || walk == Walk::together) {
      teams_walk(*q.items, state.bounds.vertex_box, q.leaves, *q.order, *q.leaf_face, *q.tree,
                 state.mesh.cloth_vertices, self, q.mode, changed_, before_, end_boxes(), end_boxes_before_, at,
                 first_block, pools, pool_blocks, hit_, taken_, count_);
    } else {
      const int batch = walk == Walk::batch ? batch_ : 1;
      CAMA_LAUNCH(b, query_vertex_face_count, ceil_divide(n, batch), n, batch, part_of(q), q.shares, *q.items,
                  state.bounds.vertex_box, q.leaves, *q.order, *q.leaf_face, *q.tree, state.mesh.cloth_vertices, self,
                  q.mode, changed_, before_, end_boxes(), end_boxes_before_, at, first_block, pools, pool_blocks, hit_,
                  taken_, count_);
    }
    at += n;
  }
  for (const EdgeQuery &q : edges) {
    const int n = items_of(q);
    const Walk walk = walk_of(q);
    const auto teams_walk = [&](auto &&...arguments) {
      if (walk == Walk::team)
        CAMA_LAUNCH_TEAMS(void, b, item_query_edge_edge, ITEM_TEAM, n, arguments...);
      else
        CAMA_LAUNCH_TEAMS(void, b, team_query_edge_edge, QUERY_TEAM, ceil_divide(n, QUERY_TEAM), n, arguments...);
    };
    if (walk == Walk::team || walk == Walk::together) {
      teams_walk(*q.items, *q.item_edge, state.bounds.vertex_box, q.group->edge.size(), q.group->trees->edge_order,
                 q.group->leaf_edge, q.group->trees->edge_bvh, state.mesh.cloth_vertices, self, q.mode, changed_,
                 before_, end_boxes(), end_boxes_before_, at, first_block, pools, pool_blocks, hit_, taken_, count_);
    } else {
      const int batch = walk == Walk::batch ? batch_ : 1;
      CAMA_LAUNCH(b, query_edge_edge_count, ceil_divide(n, batch), n, batch, q.shares, *q.items, *q.item_edge,
                  state.bounds.vertex_box, q.group->edge.size(), q.group->trees->edge_order, q.group->leaf_edge,
                  q.group->trees->edge_bvh, state.mesh.cloth_vertices, self, q.mode, changed_, before_, end_boxes(),
                  end_boxes_before_, at, first_block, pools, pool_blocks, hit_, taken_, count_);
    }
    at += n;
  }
  side_by_side.reset();
  b.scan(count_.buffer(), offset_.buffer(), items);
  CAMA_LAUNCH(b, query_totals, pools, vertex_items, items, offset_, taken_, found_totals_);
  if (fork) std::exchange(meanwhile, nullptr)(*fork);
  const std::vector<int> totals = found_totals_.download();
  const int found_faces = totals[0], found_edges = totals[1];
  const int first_face = state.contact.vertex_face.pairs.size(), first_edge = state.contact.edge_edge.pairs.size();
  const auto grow = [](PairList &list, int more) {
    list.pairs.grow(static_cast<long long>(list.pairs.size()) + more);
    list.gap_bound.grow(list.pairs.size());
  };
  grow(state.contact.vertex_face, found_faces);
  grow(state.contact.edge_edge, found_edges);
  at = 0;
  const auto copy = [&](int n, int shares, int parts, bool of_edges, const Stream<int> &owner, int first,
                        PairList &list) {
    if (batch_ > 1 || shares > 1 || n <= many_items) return 0;
    CAMA_LAUNCH_TEAMS(void, b, copy_hits, HIT_TEAM, ceil_divide(n, HIT_TEAM), n, parts, of_edges ? 1 : 0, owner, at,
                      first_block, hit_, count_, offset_, first, list.pairs, list.gap_bound);
    return 1;
  };
  side_by_side.emplace(b);
  for (const FaceQuery &q : faces) {
    const int n = items_of(q), copied = copy(n, q.shares, kernels::tree_parts(q.leaves, part_of(q)), false, *q.items,
                                             first_face, state.contact.vertex_face);
    CAMA_LAUNCH(b, query_vertex_face_fill, n, copied, part_of(q), q.shares, *q.items, state.bounds.vertex_box, q.leaves,
                *q.order, *q.leaf_face, *q.tree, state.mesh.cloth_vertices, self, q.mode, before_, end_boxes(),
                end_boxes_before_, at, first_block, hit_, count_, offset_, first_face, state.contact.vertex_face.pairs,
                state.contact.vertex_face.gap_bound);
    at += n;
  }
  for (const EdgeQuery &q : edges) {
    const int n = items_of(q),
              copied = copy(n, q.shares, 1, true, *q.items, first_edge - found_faces, state.contact.edge_edge);
    CAMA_LAUNCH(b, query_edge_edge_fill, n, copied, q.shares, *q.items, *q.item_edge, state.bounds.vertex_box,
                q.group->edge.size(), q.group->trees->edge_order, q.group->leaf_edge, q.group->trees->edge_bvh,
                state.mesh.cloth_vertices, self, q.mode, changed_, before_, end_boxes(), end_boxes_before_, at,
                first_block, hit_, count_, offset_, first_edge - found_faces, state.contact.edge_edge.pairs,
                state.contact.edge_edge.gap_bound);
    at += n;
  }
  side_by_side.reset();
  drop_exempt(state, 0, first_face);
  drop_exempt(state, 1, first_edge);
  state.report.candidates = state.contact.vertex_face.pairs.size() + state.contact.edge_edge.pairs.size();
  if (first_face + first_edge > 0) return;  // not a search of everything
  const long long most = *std::max_element(totals.begin() + 2, totals.begin() + 2 + pools);
  blocks_[static_cast<int>(motion_)] = pools * (most + most / 4 + 1);
}

}  // namespace cama
