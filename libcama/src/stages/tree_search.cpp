// SPDX-License-Identifier: Apache-2.0
#include "stages/tree_search.hpp"

#include <algorithm>
#include <numeric>

#include "device/launch.hpp"

namespace cama {
namespace {
constexpr int searches_per_sort = 16; // the order of leaves is kept between sorts; boxes are updated in every search
constexpr int sorts_per_placing = 64; // the origin of boxes is kept between placings of static obstacles
constexpr int morton_bits = 63;
constexpr double max_changed = 0.3;  // of the vertices: beyond it, a full search is cheaper
constexpr int many_vertices = 65536;  // of cloth, which is asked whether it moves far
}  // namespace

TreeSearch::TreeSearch(Backend &b, ListedPairs &listed)
    : CandidateSearch(b), batch_(b.wide_workers() ? GROUP : 1), workers_(b.workers()), cloth_(b), moving_(b),
      static_(b), key_(b), hit_(listed.flag), taken_(b, MOST_POOLS * POOL_STRIDE), count_(b), offset_(b), identity_(b),
      changed_leaf_face_(b), changed_leaf_edge_(b), found_totals_(b, 2 + MOST_POOLS), changed_(b), vertex_offsets_(b),
      flag_(b), offsets_(b), changed_vertex_(b), changed_face_(b), changed_edge_(b), changes_(b, 1), before_(b),
      end_boxes_before_(b), grown_(b, 1), far_ends_(b, 1), changed_groups_(b), all_(b)
{
  taken_.fill_zero();
}

/// The levels above the first, of all trees side by side.
void TreeSearch::build_levels(Backend &b, const std::vector<NewTree> &trees)
{
  int root = 0;
  for (const NewTree &t : trees) root = std::max(root, kernels::group_root_level(t.leaves));
  for (int below = 0; below < root; below += 2) {
    const SideBySide side_by_side(b);
    for (const NewTree &t : trees) {
      const int both = below + 2 <= kernels::group_root_level(t.leaves) ? 1 : 0, level = below + 1 + both;
      if (level <= kernels::group_root_level(t.leaves))
        CAMA_LAUNCH_TEAMS(void, b, group_levels, GROUP_TEAM, kernels::group_level_size(t.leaves, level), t.leaves,
                          level, both, *t.nodes);
    }
  }
}

TreeSearch::NewTree TreeSearch::group_faces(const SearchRooms &state, int leaves,
                                            const Stream<kernels::face_nodes> &leaf_face, const Stream<int> &changed,
                                            Stream<kernels::bvh8_node> &tree)
{
  tree.resize(kernels::group_tree_size(leaves));
  CAMA_LAUNCH(*state.backend, face_groups, kernels::group_level_size(leaves, 0), leaves, leaf_face,
              state.bounds.vertex_box, changed, tree);
  return {leaves, &tree};
}

/// Assigns features to groups. Without contact.self it leaves out what only cloth against cloth needs.
void TreeSearch::find_groups(const SearchRooms &state)
{
  Backend &b = *state.backend;
  const auto group_of = [&](int v) {
    return v < state.mesh.cloth_vertices
               ? 0
               : 1 + state.mesh.object_static[static_cast<std::size_t>(state.mesh.object_of(v))];
  };
  Group *group[3] = {&cloth_, &moving_, &static_};
  std::vector<int> face[3], edge[3], query_vertices[3];
  const auto faces = state.mesh.face.download();
  const auto edges = state.mesh.edge.download();
  for (std::size_t f = 0; f < faces.size(); ++f) face[group_of(faces[f].node[0])].push_back(static_cast<int>(f));
  for (std::size_t e = 0; e < edges.size(); ++e) edge[group_of(edges[e].node[0])].push_back(static_cast<int>(e));
  for (int v : state.bounds.query_vertices.download()) query_vertices[group_of(v)].push_back(v);
  self_ = state.contact.settings.self;
  if (!self_ && query_vertices[1].empty() && query_vertices[2].empty()) face[0].clear();
  if (!self_ && edge[1].empty() && edge[2].empty()) edge[0].clear();
  boxed_ = state.mesh.cloth_vertices;
  for (std::size_t o = 0; o < state.mesh.object_static.size(); ++o)
    if (!state.mesh.object_static[o])
      boxed_ = o + 1 < state.mesh.object_first.size() ? state.mesh.object_first[o + 1] : state.mesh.vertices;
  FeatureTrees *trees[3] = {&trees_.cloth, &trees_.moving, &trees_.resting};
  for (int k = 0; k < 3; ++k) {
    Group &g = *group[k];
    g.face.assign(face[k]);
    g.edge.assign(edge[k]);
    g.query_vertices.assign(query_vertices[k]);
    g.trees = trees[k];
    if (g.face.size() && !g.trees->face_order.backend()) {
      g.trees->face_order = Stream<int>(b);
      g.trees->face_bvh = Stream<kernels::bvh8_node>(b);
    }
    if (g.edge.size() && !g.trees->edge_order.backend()) {
      g.trees->edge_order = Stream<int>(b);
      g.trees->edge_bvh = Stream<kernels::bvh8_node>(b);
    }
  }
  if (static_.face.size() && !state.bounds.origin.backend()) state.bounds.origin = Stream<dvec3>(b);
  if (!static_.face.size()) state.bounds.origin.resize(0);
  std::vector<int> identity(static_cast<std::size_t>(state.mesh.vertices));
  std::iota(identity.begin(), identity.end(), 0);
  identity_.assign(identity);
  changed_.resize(state.mesh.vertices);
  before_.resize(state.mesh.vertices);
  end_boxes_.resize(state.mesh.vertices);
  end_boxes_before_.resize(state.mesh.vertices);
  motion_changes_ = state.mesh.motion_changes;
  found_ = true;
}

void TreeSearch::build_trees(const SearchRooms &state, const std::vector<Features> &features,
                             const Stream<int> &changed)
{
  Backend &b = *state.backend;
  std::vector<NewTree> trees;
  {
    const SideBySide side_by_side(b);
    for (const auto &[g, faces, edges] : features) {
      if (faces && g->face.size())
        trees.push_back(group_faces(state, g->face.size(), g->leaf_face, changed, g->trees->face_bvh));
      const int leaves = g->edge.size();
      if (!edges || leaves == 0) continue;
      g->trees->edge_bvh.resize(kernels::group_tree_size(leaves));
      CAMA_LAUNCH(b, edge_groups, kernels::group_level_size(leaves, 0), leaves, g->leaf_edge, state.bounds.vertex_box,
                  changed, g->trees->edge_bvh);
      trees.push_back({leaves, &g->trees->edge_bvh});
    }
  }
  build_levels(b, trees);
}

/// Faces, edges and vertices along the Morton curve.
void TreeSearch::sort_features(const SearchRooms &state, Group &g)
{
  Backend &b = *state.backend;
  const int faces = g.face.size(), edges = g.edge.size(), query_vertices = g.query_vertices.size();
  const Stream<dvec3> &origin = state.bounds.box_origin();
  key_.resize(std::max({faces, edges, query_vertices}));
  const auto along_curve = [&](Stream<int> &order, int n, const auto &make_codes) {
    if (n == 0) return false;
    order.resize(n);
    make_codes(order);
    b.sort(key_.buffer(), order.buffer(), n, morton_bits);
    return true;
  };
  if (along_curve(g.trees->face_order, faces, [&](Stream<int> &order) {
        CAMA_LAUNCH(b, codes_of_faces, faces, g.face, state.mesh.face, state.bounds.vertex_box, state.bounds.bounds,
                    origin, key_, order);
      })) {
    g.leaf_face.resize(faces);
    CAMA_LAUNCH(b, order_faces, faces, g.trees->face_order, state.mesh.face, g.leaf_face);
  }
  if (along_curve(g.trees->edge_order, edges, [&](Stream<int> &order) {
        CAMA_LAUNCH(b, codes_of_edges, edges, g.edge, state.mesh.edge, state.bounds.vertex_box, state.bounds.bounds,
                    origin, key_, order);
      })) {
    g.leaf_edge.resize(edges);
    CAMA_LAUNCH(b, order_edges, edges, g.trees->edge_order, state.mesh.edge, g.leaf_edge);
  }
  along_curve(g.query_order, query_vertices, [&](Stream<int> &order) {
    CAMA_LAUNCH(b, codes_of_vertices, query_vertices, g.query_vertices, state.bounds.vertex_box, state.bounds.bounds,
                origin, key_, order);
  });
}

/// Boxes of the first n vertices, over their motion and at its ends.
void TreeSearch::make_boxes(const SearchRooms &state, int n, const Stream<dvec3> &from, const Stream<dvec3> &to,
                            Motion motion)
{
  const BoundsState &bounds = state.bounds;
  int all = motion == Motion::known ? -1 : 0;
  if (all == 0 && state.mesh.cloth_vertices > many_vertices) {
    all = state.mesh.vertices / ASKED_VERTICES;
    far_ends_.fill_zero();
    CAMA_LAUNCH(*state.backend, count_far_ends, state.mesh.cloth_vertices / ASKED_VERTICES, from, to, bounds.margin,
                bounds.short_motion, bounds.uncertain, far_ends_);
  }
  CAMA_LAUNCH(*state.backend, vertex_boxes, n, from, to, bounds.margin, bounds.box_origin(), state.bounds.vertex_box);
  CAMA_LAUNCH(*state.backend, vertex_end_boxes, n, from, to, bounds.margin, bounds.short_motion, bounds.box_origin(),
              bounds.uncertain, all, far_ends_, bounds.vertex_box, end_boxes_);
}

/// Boxes and trees of static obstacles.
void TreeSearch::place_static(const SearchRooms &state, const Stream<dvec3> &from, const Stream<dvec3> &to,
                              Motion motion)
{
  sorts_since_placed_ = 0;   // remains so if anything below throws
  state.bounds.origin.copy_from(state.bounds.bounds);
  make_boxes(state, state.mesh.vertices, from, to, motion);
  sort_features(state, static_);
  build_trees(state, {{&static_, true, true}}, all_);
}

void TreeSearch::run(const SearchRooms &state, const Stream<dvec3> &from, const Stream<dvec3> &to)
{
  search(state, from, to, Motion::predicted);
}

void TreeSearch::search(const SearchRooms &state, const Stream<dvec3> &from, const Stream<dvec3> &to, Motion motion)
{
  motion_ = motion;
  if (motion_changes_ != state.mesh.motion_changes) {
    found_ = false;
    searches_since_sort_ = sorts_since_placed_ = 0;
  }
  const bool sort = searches_since_sort_ == 0 || searches_since_sort_ >= searches_per_sort;
  if (sort) searches_since_sort_ = 0;   // remains so if anything below throws
  if (!found_) find_groups(state);
  find_bounds(state, from, to);
  const bool has_static = static_.face.size() > 0;
  if (has_static && (sorts_since_placed_ == 0 || (sort && sorts_since_placed_ >= sorts_per_placing)))
    place_static(state, from, to, motion);
  else
    make_boxes(state, boxed_, from, to, motion);
  if (sort)
    for (Group *g : {&cloth_, &moving_}) sort_features(state, *g);
  build_trees(state, {{&cloth_, true, self_}, {&moving_, true, true}}, all_);
  ++searches_since_sort_;
  if (sort) ++sorts_since_placed_;
  for (PairList *list : {&state.contact.vertex_face, &state.contact.edge_edge}) {
    list->pairs.resize(0);
    list->direction.resize(0);
    list->gap_bound.resize(0);
  }
  std::vector<FaceQuery> faces;
  std::vector<EdgeQuery> edges;
  const auto ask = [&](const Group &items, const Group &tree) {
    if (tree.face.size() && items.query_vertices.size())
      faces.push_back({QUERY_ALL, &items.query_order, tree.face.size(), &tree.trees->face_order, &tree.leaf_face,
                       &tree.trees->face_bvh, vertex_shares_of(items.query_vertices.size())});
  };
  if (self_) {
    ask(cloth_, cloth_);
    edges.push_back({QUERY_ALL, &cloth_.trees->edge_order, &cloth_.leaf_edge, &cloth_, shares_of(cloth_.edge.size())});
  }
  for (const Group *g : {&moving_, &static_}) {
    ask(*g, cloth_);
    ask(cloth_, *g);
    if (g->edge.size())
      edges.push_back({QUERY_OTHER, &cloth_.trees->edge_order, &cloth_.leaf_edge, g, shares_of(cloth_.edge.size())});
  }
  query(state, faces, edges);
}

/// Flags the vertices whose motion leaves their boxes, which grow, and the faces and edges that have such vertices;
/// static obstacles have none.
kernels::change_counts TreeSearch::find_changed(const SearchRooms &state, const Stream<dvec3> &from,
                                                const Stream<dvec3> &to, double margin)
{
  Backend &b = *state.backend;
  const int n = state.mesh.vertices;
  grown_.fill_zero();
  CAMA_LAUNCH(b, grow_boxes, n, from, to, state.bounds.margin, state.bounds.box_origin(), margin, before_,
              state.bounds.vertex_box, end_boxes_before_, end_boxes_, changed_, grown_);
  vertex_offsets_.resize(n + 1);
  b.scan(changed_.buffer(), vertex_offsets_.buffer(), n);
  const int faces = cloth_.face.size() + moving_.face.size(),
            features = faces + cloth_.edge.size() + moving_.edge.size();
  flag_.resize(features);
  offsets_.resize(features + 1);
  int first_face = 0, first_edge = faces;
  for (const Group *g : {&cloth_, &moving_}) {
    CAMA_LAUNCH(b, changed_faces, g->face.size(), first_face, g->trees->face_order, state.mesh.face, changed_, flag_);
    CAMA_LAUNCH(b, changed_edges, g->edge.size(), first_edge, g->trees->edge_order, state.mesh.edge, changed_, flag_);
    first_face += g->face.size();
    first_edge += g->edge.size();
  }
  b.scan(flag_.buffer(), offsets_.buffer(), features);
  CAMA_LAUNCH(b, count_changes, 1, n, faces, features, vertex_offsets_, offsets_, grown_, changes_);
  return changes_.at(0);
}

CandidateSearch::Change TreeSearch::update(const SearchRooms &state, const Stream<dvec3> &from, const Stream<dvec3> &to,
                                           double margin)
{
  const auto renew = [&] {
    search(state, from, to, Motion::known);
    return Change::renewed;
  };
  if (searches_since_sort_ == 0) return renew();
  const kernels::change_counts changed = find_changed(state, from, to, margin);
  if (changed.vertices == 0) return Change::none;
  if (changed.vertices > max_changed * state.mesh.vertices) return renew();
  query_changed(state, from, changed);
  return Change::grown;
}

bool TreeSearch::complete(const SearchRooms &state, const Stream<dvec3> &from, const Stream<dvec3> &to, double margin)
{
  const kernels::change_counts changed = find_changed(state, from, to, margin);
  const int before = state.report.candidates;
  if (changed.vertices > 0) query_changed(state, from, changed);
  return changed.vertices > 0 && state.report.candidates > before;
}

void TreeSearch::query_changed(const SearchRooms &state, const Stream<dvec3> &from, const kernels::change_counts &of)
{
  Backend &b = *state.backend;
  changed_vertex_.resize(of.vertices);
  CAMA_LAUNCH(b, keep_flagged, state.mesh.vertices, 0, 0, vertex_offsets_, identity_, changed_vertex_);

  const Group *const groups[3] = {&cloth_, &moving_, &static_};
  const int faces_of[2] = {cloth_.face.size(), moving_.face.size()},
            edges_of[2] = {cloth_.edge.size(), moving_.edge.size()};
  const int all_faces = faces_of[0] + faces_of[1];
  const bool cloth_edges_asked = self_ || moving_.edge.size() > 0;
  if (of.grown > 0) build_trees(state, {{&cloth_, true, self_}, {&moving_, true, true}}, changed_);
  if (!self_) build_trees(state, {{&cloth_, false, cloth_edges_asked}}, all_);  // a search has not made this one
  changed_face_.resize(of.faces);
  changed_edge_.resize(of.edges);
  for (int k = 0; k < 2; ++k) {
    const FeatureTrees &t = *groups[k]->trees;
    CAMA_LAUNCH(b, keep_flagged, of.faces ? faces_of[k] : 0, 0, k * faces_of[0], offsets_, t.face_order, changed_face_);
    CAMA_LAUNCH(b, keep_flagged, of.edges ? edges_of[k] : 0, all_faces, all_faces + k * edges_of[0], offsets_,
                t.edge_order, changed_edge_);
  }
  std::vector<FaceQuery> faces;
  std::vector<EdgeQuery> edges;
  if (of.faces) {
    changed_leaf_face_.resize(of.faces);
    CAMA_LAUNCH(b, order_faces, of.faces, changed_face_, state.mesh.face, changed_leaf_face_);
    build_levels(b, {group_faces(state, of.faces, changed_leaf_face_, all_, changed_groups_)});
    for (const Group *g : groups)
      if (g->query_vertices.size())
        faces.push_back(
            {QUERY_UNCHANGED, &g->query_order, of.faces, &changed_face_, &changed_leaf_face_, &changed_groups_});
  }
  if (of.edges) {
    changed_leaf_edge_.resize(of.edges);
    CAMA_LAUNCH(b, order_edges, of.edges, changed_edge_, state.mesh.edge, changed_leaf_edge_);
  }
  for (const Group *g : groups) {
    const bool edge_tree = g->edge.size() && (g != &cloth_ || cloth_edges_asked);
    if (g->face.size())
      faces.push_back(
          {QUERY_CHANGED, &changed_vertex_, g->face.size(), &g->trees->face_order, &g->leaf_face, &g->trees->face_bvh});
    if (of.edges && edge_tree) edges.push_back({QUERY_CHANGED, &changed_edge_, &changed_leaf_edge_, g});
  }
  const int first_face = state.contact.vertex_face.pairs.size(), first_edge = state.contact.edge_edge.pairs.size();
  query(state, faces, edges);
  find_directions(state, from, first_face, first_edge);
}

}  // namespace cama
