// SPDX-License-Identifier: Apache-2.0
#include "stages/front_search.hpp"

#include <algorithm>
#include <array>
#include <numeric>

#include "device/ceil_divide.hpp"
#include "device/launch.hpp"

namespace cama {
namespace {
constexpr int morton_bits = 63;
// of the inner boxes' surface relative to that of the leaves, before trees are rebuilt
constexpr double worst_growth = 1.5;
constexpr double max_escaped = 0.3;  // of the vertices, for a localized update
// vertices with more faces do not make them adjacent, which bounds the number of orphans
constexpr int max_adjacent = 24;
constexpr long long max_pairs = 1024;  // pairs of triangles per face; more mean that the cloth has blown up
using kernels::pair;

}  // namespace

FrontSearch::FrontSearch(const SearchRooms &s)
    : CandidateSearch(*s.backend), cloth_{0,
                                          s.mesh.triangles,
                                          kernels::tree_root_level(s.mesh.triangles),
                                          fronts_.face_order,
                                          fronts_.face_tree,
                                          cloth_dirty_},
      obstacles_{s.mesh.triangles,
                 s.mesh.faces - s.mesh.triangles,
                 kernels::tree_root_level(std::max(1, s.mesh.faces - s.mesh.triangles)),
                 fronts_.obstacle_order,
                 fronts_.obstacle_tree,
                 obstacle_dirty_}
{
  Backend &b = *s.backend;
  if (s.mesh.faces >= 1 << FRONT_BITS)
    throw MemoryError("paper.search: fronts hold at most 2^26 faces; set it to tree");
  for (Stream<int> *stream : {&outcome_, &count_, &offset_, &mask_, &found_[0], &found_[1], &place_[0], &place_[1],
                              &cloth_dirty_, &obstacle_dirty_, &fronts_.obstacle_order})
    *stream = Stream<int>(b);
  for (Stream<pair> *stream : {&kept_[0], &kept_[1], &open_, &child_, &fronts_.front, &fronts_.self_front,
                               &fronts_.triangle_pairs, &fronts_.orphan_vertex_face, &fronts_.orphan_edge_edge})
    *stream = Stream<pair>(b);
  key_ = Stream<key64>(b);
  partial_ = Stream<double>(b);
  total_ = Stream<double>(b, 2);
  fronts_.face_order = Stream<int>(b);
  fronts_.face_box = Stream<kernels::box>(b, s.mesh.faces);
  fronts_.edge_box = Stream<kernels::box>(b, s.mesh.edges);
  fronts_.face_tree = Stream<kernels::box>(b);
  fronts_.obstacle_tree = Stream<kernels::box>(b);
  // Kernels have these arguments always, but use them in localized updates only.
  const int one = s.options.paper.localized_search ? 0 : 1;
  vertex_dirty_ = Stream<int>(b, s.mesh.vertices);
  face_dirty_ = Stream<int>(b, one ? 1 : s.mesh.faces);
  edge_dirty_ = Stream<int>(b, one ? 1 : s.mesh.edges);
  dirty_count_ = Stream<int>(b, 1);
  vertex_before_ = Stream<kernels::box>(b, one ? 1 : s.mesh.vertices);
  face_before_ = Stream<kernels::box>(b, one ? 1 : s.mesh.faces);
  edge_before_ = Stream<kernels::box>(b, one ? 1 : s.mesh.edges);
  find_features(s);
}

/// Finds the owners of vertices and edges, in each case the face with the lowest number, and the orphans.
void FrontSearch::find_features(const SearchRooms &s)
{
  Backend &b = *s.backend;
  const std::vector<kernels::face_nodes> face = s.mesh.face.download();
  const std::vector<kernels::edge_nodes> edge = s.mesh.edge.download();
  std::vector<std::pair<std::array<int, 2>, int>> number;
  for (std::size_t e = 0; e < edge.size(); ++e)
    number.push_back({{std::min(edge[e].node[0], edge[e].node[1]), std::max(edge[e].node[0], edge[e].node[1])},
                      static_cast<int>(e)});
  std::sort(number.begin(), number.end());
  std::vector<kernels::face_features> features(face.size());
  std::vector<char> vertex_owned(static_cast<std::size_t>(s.mesh.vertices), 0), edge_owned(edge.size(), 0);
  std::vector<int> row(static_cast<std::size_t>(s.mesh.vertices) + 1, 0), around;
  for (const auto &f : face)
    for (int v : f.node) ++row[static_cast<std::size_t>(v) + 1];
  std::partial_sum(row.begin(), row.end(), row.begin());
  around.resize(static_cast<std::size_t>(row.back()));
  std::vector<int> next(row.begin(), row.end() - 1);
  for (std::size_t f = 0; f < face.size(); ++f)
    for (int k = 0; k < 3; ++k) {
      const int v = face[f].node[k], w = face[f].node[(k + 1) % 3];
      around[static_cast<std::size_t>(next[v]++)] = static_cast<int>(f);
      const auto found = std::lower_bound(number.begin(), number.end(),
                                          std::pair<std::array<int, 2>, int>{{std::min(v, w), std::max(v, w)}, -1});
      features[f].edge[k] = found->second;
      if (!std::exchange(vertex_owned[v], 1)) features[f].owned |= 1 << k;
      if (!std::exchange(edge_owned[found->second], 1)) features[f].owned |= 1 << (3 + k);
      if (row[v + 1] - row[v] > max_adjacent) features[f].owned |= 1 << (6 + k);
    }
  fronts_.face_features = Stream<kernels::face_features>(b, features);
  if (!s.contact.settings.self) return;

  std::vector<pair> points, lines;
  std::vector<int> neighbours;
  const auto owns = [&](int f, int bit) { return (features[f].owned >> bit) & 1; };
  const auto add_points = [&](int f, int g) {
    for (int k = 0; k < 3; ++k)
      if (owns(f, k) && !kernels::face_has(face[g], face[f].node[k])) points.push_back({face[f].node[k], g});
  };
  for (int f = 0; f < s.mesh.triangles; ++f) {
    neighbours.clear();
    for (int k = 0; k < 3; ++k)
      if (!owns(f, 6 + k))
        for (int i = row[face[f].node[k]]; i < row[face[f].node[k] + 1]; ++i)
          if (around[i] > f) neighbours.push_back(around[i]);
    std::sort(neighbours.begin(), neighbours.end());
    neighbours.erase(std::unique(neighbours.begin(), neighbours.end()), neighbours.end());
    for (int g : neighbours) {
      add_points(f, g);
      add_points(g, f);
      for (int k = 0; k < 9; ++k) {
        const int d = features[f].edge[k / 3], e = features[g].edge[k % 3];
        if (owns(f, 3 + k / 3) && owns(g, 3 + k % 3) && !kernels::edges_meet(edge[d], edge[e]))
          lines.push_back(kernels::ordered_pair(d, e));
      }
    }
  }
  fronts_.orphan_vertex_face = Stream<pair>(b, points);
  fronts_.orphan_edge_edge = Stream<pair>(b, lines);
}

void FrontSearch::sort_leaves(const SearchRooms &state, Tree &tree)
{
  Backend &b = *state.backend;
  key_.resize(tree.leaves);
  tree.order.resize(tree.leaves);
  tree.node.resize(kernels::tree_size(tree.leaves));
  tree.dirty.resize(tree.node.size());
  CAMA_LAUNCH(b, face_codes, tree.leaves, tree.first, fronts_.face_box, state.bounds.bounds, key_, tree.order);
  b.sort(key_.buffer(), tree.order.buffer(), tree.leaves, morton_bits);
}

/// Calls launch(nodes, level, steps) for a few levels at a time, and for the small top at once.
template <class Level> void FrontSearch::for_each_level(const Tree &tree, Level &&launch)
{
  for (int level = 0; level < tree.root;) {
    const int steps =
        kernels::tree_level_size(tree.leaves, level) <= 256 ? tree.root - level : std::min(3, tree.root - level);
    level += steps;
    launch(kernels::tree_level_size(tree.leaves, level), level, steps);
  }
}

void FrontSearch::refit(const SearchRooms &state, Tree &tree)
{
  Backend &b = *state.backend;
  CAMA_LAUNCH(b, tree_leaves, tree.leaves, tree.order, fronts_.face_box, tree.node);
  for_each_level(
      tree, [&](int n, int level, int steps) { CAMA_LAUNCH(b, tree_levels, n, tree.leaves, level, steps, tree.node); });
}

/// Surface of the inner boxes relative to that of the leaves.
double FrontSearch::surface(const SearchRooms &state, const Tree &tree)
{
  Backend &b = *state.backend;
  const auto sum = [&](int first, int end, int at) {
    const int n = ceil_divide(end - first, DOT_CHUNK);
    partial_.resize(n);
    CAMA_LAUNCH(b, tree_surface, n, first, end, tree.node, partial_);
    CAMA_LAUNCH(b, finish_surface, 1, n, at, partial_, total_);
  };
  sum(0, tree.leaves, 0);
  sum(tree.leaves, tree.node.size(), 1);
  const double leaves = total_.at(0);
  return leaves > 0 ? total_.at(1) / leaves : leaves;
}

/// Called when `outcome_` of `pairs` is known: appends to `kept` (if not null) and to the triangle pairs, and fills
/// open_; returns the number of open pairs.
int FrontSearch::partition(const SearchRooms &state, int size, const Stream<pair> &pairs, const Tree &a, const Tree &b,
                           Stream<pair> *kept)
{
  Backend &device = *state.backend;
  const int n = ceil_divide(size, FRONT_CHUNK);
  count_.resize(3 * n);
  offset_.resize(3 * n + 1);
  CAMA_LAUNCH(device, count_front, n, size, outcome_, count_);
  device.scan(count_.buffer(), offset_.buffer(), 3 * n);
  const int stay = offset_.at(n), touching = offset_.at(2 * n) - stay, open = offset_.at(3 * n) - stay - touching;
  const int first_kept = kept ? kept->size() : 0, first_triangle = fronts_.triangle_pairs.size();
  if (kept) kept->grow(static_cast<long long>(first_kept) + stay);
  const long long pairs_now = static_cast<long long>(first_triangle) + touching;
  if (pairs_now > max_pairs * state.mesh.faces)
    throw SolverError(
        "step " + std::to_string(state.report.step) + ": the motion of this step brings " + std::to_string(pairs_now) +
        " pairs of triangles near each other: the simulation is unstable; take a smaller time step, or the "
        "level production, which keeps cloth free of intersections");
  fronts_.triangle_pairs.grow(pairs_now);
  open_.resize(open);
  CAMA_LAUNCH(device, fill_front, n, size, kept ? 1 : 0, pairs, outcome_, offset_, first_kept, first_triangle, a.order,
              b.order, kept ? *kept : kept_[0], fronts_.triangle_pairs, open_);
  return open;
}

/// Opens pairs, level by level, until all are separated, leaves or, without `kept`, clean.
void FrontSearch::traverse(const SearchRooms &state, const Tree &a, const Tree &b, int open, Stream<pair> *kept)
{
  Backend &device = *state.backend;
  const int self = &a == &b ? 1 : 0;
  while (open > 0) {
    child_.resize(4ll * open);
    const int size = child_.size();
    outcome_.resize(size);
    CAMA_LAUNCH(device, open_pairs, size, self, a.leaves, a.root, b.leaves, b.root, open_, child_);
    if (kept)
      CAMA_LAUNCH(device, test_front, size, 0, self, a.leaves, a.root, a.node, a.order, b.leaves, b.root, b.node,
                  b.order, state.mesh.face, fronts_.face_features, child_, outcome_);
    else
      CAMA_LAUNCH(device, test_dirty_front, size, 1, self, a.leaves, a.root, a.node, a.dirty, a.order, b.leaves, b.root,
                  b.node, b.dirty, b.order, state.mesh.face, fronts_.face_features, child_, outcome_);
    open = partition(state, size, child_, a, b, kept);
  }
}

void FrontSearch::update_front(const SearchRooms &state, const Tree &a, const Tree &b, Stream<pair> &front,
                               bool restart)
{
  Backend &device = *state.backend;
  if (restart) front.assign({kernels::front_pack({std::max(a.root, b.root), 0, 0})});
  const int size = front.size();
  outcome_.resize(size);
  Stream<pair> &kept = kept_[&a == &b ? 0 : 1];
  kept.resize(0);
  CAMA_LAUNCH(device, test_front, size, restart ? 0 : 1, &a == &b ? 1 : 0, a.leaves, a.root, a.node, a.order, b.leaves,
              b.root, b.node, b.order, state.mesh.face, fronts_.face_features, front, outcome_);
  kept.reserve(front.capacity());
  const int open = partition(state, size, front, a, b, &kept);
  traverse(state, a, b, open, &kept);
  front.swap(kept);
}

/// Triangle pairs below front pairs with a dirty node. The front does not change: it remains a cut, and the next full
/// search opens pairs that overlap.
void FrontSearch::follow_dirty(const SearchRooms &state, const Tree &a, const Tree &b, const Stream<pair> &front)
{
  const int size = front.size();
  outcome_.resize(size);
  CAMA_LAUNCH(*state.backend, test_dirty_front, size, 0, &a == &b ? 1 : 0, a.leaves, a.root, a.node, a.dirty, a.order,
              b.leaves, b.root, b.node, b.dirty, b.order, state.mesh.face, fronts_.face_features, front, outcome_);
  const int open = partition(state, size, front, a, b, nullptr);
  traverse(state, a, b, open, nullptr);
}

/// Appends the feature pairs of the triangle pairs and the orphans.
void FrontSearch::collect_features(const SearchRooms &s, bool only_new)
{
  Backend &b = *s.backend;
  const int n = fronts_.triangle_pairs.size(), fresh = only_new ? 1 : 0;
  const Stream<pair> *orphan[2] = {&fronts_.orphan_vertex_face, &fronts_.orphan_edge_edge};
  PairList *list[2] = {&s.contact.vertex_face, &s.contact.edge_edge};
  mask_.resize(n);
  for (int kind = 0; kind < 2; ++kind) {
    found_[kind].resize(static_cast<long long>(n) + orphan[kind]->size());
    place_[kind].resize(found_[kind].size() + 1);
  }
  CAMA_LAUNCH(b, test_features, n, fresh, fronts_.triangle_pairs, s.mesh.face, s.mesh.edge, fronts_.face_features,
              s.bounds.vertex_box, vertex_dirty_, vertex_before_, fronts_.face_box, face_dirty_, face_before_,
              fronts_.edge_box, edge_dirty_, edge_before_, mask_, found_[0], found_[1]);
  CAMA_LAUNCH(b, test_orphans, orphan[0]->size(), fresh, *orphan[0], s.bounds.vertex_box, vertex_dirty_, vertex_before_,
              fronts_.face_box, face_dirty_, face_before_, n, found_[0]);
  CAMA_LAUNCH(b, test_orphans, orphan[1]->size(), fresh, *orphan[1], fronts_.edge_box, edge_dirty_, edge_before_,
              fronts_.edge_box, edge_dirty_, edge_before_, n, found_[1]);
  int first[2];
  for (int kind = 0; kind < 2; ++kind) {
    first[kind] = list[kind]->pairs.size();
    b.scan(found_[kind].buffer(), place_[kind].buffer(), found_[kind].size());
    const long long size = static_cast<long long>(first[kind]) + place_[kind].at(found_[kind].size());
    list[kind]->pairs.grow(size);
    list[kind]->direction.grow(size);
    list[kind]->gap_bound.grow(size);
  }
  CAMA_LAUNCH(b, fill_features, n, fronts_.triangle_pairs, s.mesh.face, fronts_.face_features, mask_, first[0],
              place_[0], s.contact.vertex_face.pairs, s.contact.vertex_face.gap_bound, first[1], place_[1],
              s.contact.edge_edge.pairs, s.contact.edge_edge.gap_bound);
  for (int kind = 0; kind < 2; ++kind)
    CAMA_LAUNCH(b, fill_orphans, orphan[kind]->size(), *orphan[kind], n, found_[kind], place_[kind], first[kind],
                list[kind]->pairs, list[kind]->gap_bound);
  for (int kind = 0; kind < 2; ++kind) drop_exempt(s, kind, first[kind]);
  s.report.candidates = s.contact.vertex_face.pairs.size() + s.contact.edge_edge.pairs.size();
  ++s.report.searches;
}

void FrontSearch::run(const SearchRooms &s, const Stream<dvec3> &from, const Stream<dvec3> &to)
{
  Backend &b = *s.backend;
  // built_ remains false if anything below throws.
  const bool was_built = std::exchange(built_, false), obstacles = obstacles_.leaves > 0;
  find_bounds(s, from, to);
  CAMA_LAUNCH(b, vertex_boxes, s.mesh.vertices, from, to, s.bounds.margin, s.bounds.bounds, s.bounds.vertex_box);
  CAMA_LAUNCH(b, face_boxes, s.mesh.faces, s.mesh.face, s.bounds.vertex_box, fronts_.face_box);
  CAMA_LAUNCH(b, edge_boxes, s.mesh.edges, s.mesh.edge, s.bounds.vertex_box, fronts_.edge_box);
  bool restart = !was_built;
  if (was_built) {
    refit(s, cloth_);
    restart = !(surface(s, cloth_) <= worst_growth * built_cloth_);
    if (obstacles) {
      refit(s, obstacles_);
      restart |= !(surface(s, obstacles_) <= worst_growth * built_obstacles_);
    }
  }
  if (restart) {
    sort_leaves(s, cloth_);
    refit(s, cloth_);
    built_cloth_ = surface(s, cloth_);
    if (obstacles) {
      sort_leaves(s, obstacles_);
      refit(s, obstacles_);
      built_obstacles_ = surface(s, obstacles_);
    }
    ++rebuilds_;
  }
  fronts_.triangle_pairs.resize(0);
  if (s.contact.settings.self) update_front(s, cloth_, cloth_, fronts_.self_front, restart);
  if (obstacles) update_front(s, cloth_, obstacles_, fronts_.front, restart);
  for (PairList *list : {&s.contact.vertex_face, &s.contact.edge_edge}) {
    list->pairs.resize(0);
    list->direction.resize(0);
    list->gap_bound.resize(0);
  }
  collect_features(s, false);
  for (PairList *list : {&s.contact.vertex_face, &s.contact.edge_edge})
    list->direction.fill_zero();  // a zero direction certifies nothing
  built_ = true;
}

CandidateSearch::Change FrontSearch::update(const SearchRooms &s, const Stream<dvec3> &from, const Stream<dvec3> &to,
                                            double margin)
{
  Backend &b = *s.backend;
  dirty_count_.fill_zero();
  CAMA_LAUNCH(b, mark_escaped, s.mesh.vertices, from, to, s.bounds.vertex_box, s.bounds.bounds, margin, vertex_dirty_,
              dirty_count_);
  const int escaped = dirty_count_.at(0);
  if (escaped == 0) return Change::none;
  if (!built_ || !s.options.paper.localized_search || escaped > max_escaped * s.mesh.vertices) {
    run(s, from, to);
    return Change::renewed;
  }
  CAMA_LAUNCH(b, grow_vertex_boxes, s.mesh.vertices, from, to, s.bounds.margin, s.bounds.bounds, vertex_dirty_,
              s.bounds.vertex_box, vertex_before_);
  CAMA_LAUNCH(b, grow_face_boxes, s.mesh.faces, s.mesh.face, s.bounds.vertex_box, vertex_dirty_, face_dirty_,
              fronts_.face_box, face_before_);
  CAMA_LAUNCH(b, grow_edge_boxes, s.mesh.edges, s.mesh.edge, s.bounds.vertex_box, vertex_dirty_, edge_dirty_,
              fronts_.edge_box, edge_before_);
  const bool obstacles = obstacles_.leaves > 0;
  for (Tree *tree : {&cloth_, &obstacles_}) {
    if (tree->leaves == 0) continue;
    CAMA_LAUNCH(b, grow_leaves, tree->leaves, tree->order, face_dirty_, fronts_.face_box, tree->dirty, tree->node);
    for_each_level(*tree, [&](int n, int level, int steps) {
      CAMA_LAUNCH(b, grow_levels, n, tree->leaves, level, steps, tree->dirty, tree->node);
    });
  }
  fronts_.triangle_pairs.resize(0);
  if (s.contact.settings.self) follow_dirty(s, cloth_, cloth_, fronts_.self_front);
  if (obstacles) follow_dirty(s, cloth_, obstacles_, fronts_.front);
  const int first_vertex_face = s.contact.vertex_face.pairs.size(), first_edge_edge = s.contact.edge_edge.pairs.size();
  collect_features(s, true);
  find_directions(s, from, first_vertex_face, first_edge_edge);
  ++localized_;
  return Change::grown;
}

}  // namespace cama
