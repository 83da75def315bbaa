// SPDX-License-Identifier: Apache-2.0
#include "stages/candidate_search.hpp"

#include <algorithm>
#include <numeric>

#include "launch.hpp"

namespace cama {
namespace {
constexpr int slots = 24;             // hits kept by the count pass
constexpr int searches_per_sort = 16; // leaf order is kept between sorts; boxes are always fresh
constexpr int morton_bits = 63;
constexpr double most_changed = 0.3;  // of the vertices: beyond, a full search costs less
}  // namespace

void CandidateSearch::drop_exempt(State &state, int kind, int first)
{
  if (!state.exemptions.any()) return;
  Backend &b = *state.backend;
  PairList &list = kind == 0 ? state.vertex_face : state.edge_edge;
  const int n = list.pairs.size() - first;
  wanted_.resize(n);
  place_.resize(n + 1);
  CAMA_LAUNCH(b, wanted_pairs, n, first, kind, state.vertices, list.pairs, state.face, state.edge, state.exemptions.row,
              state.exemptions.entry, state.exemptions.object, wanted_);
  b.scan(wanted_.buffer(), place_.buffer(), n);
  const int kept = place_.at(n);
  if (kept == n) return;
  kept_.resize(n);
  CAMA_LAUNCH(b, keep_pairs, n, first, place_, list.pairs, kept_);
  CAMA_LAUNCH(b, copy_pairs, kept, first, kept_, list.pairs);
  list.pairs.resize(first + kept);
  list.known.resize(first + kept);
}

void CandidateSearch::find_directions(State &state, const Stream<dvec3> &from, int first_vertex_face, int first_edge_edge)
{
  const auto direct = [&](int kind, PairList &list, int first) {
    first = std::min(first, list.direction.size());
    list.direction.grow(list.pairs.size());
    CAMA_LAUNCH(*state.backend, find_directions, list.pairs.size() - first, kind, first, list.pairs, state.face, state.edge, from,
                state.vertex_contact, list.direction);
  };
  direct(0, state.vertex_face, first_vertex_face);
  direct(1, state.edge_edge, first_edge_edge);
}

TreeSearch::TreeSearch(Backend &b)
    : CandidateSearch(b), batch_(b.processor() ? GROUP : 1), key_(b), slot_(b), count_(b), offset_(b), identity_(b), asking_(b),
      leaf_face_(b), changed_leaf_face_(b), leaf_edge_(b), totals_(b, 1), changed_(b), flag_(b), offsets_(b), changed_vertex_(b),
      changed_face_(b), changed_edge_(b), before_(b), changed_groups_(b)
{}

void CandidateSearch::find_bounds(State &state, const Stream<dvec3> &from, const Stream<dvec3> &to)
{
  Backend &b = *state.backend;
  const int first = std::min(state.vertices, 4096), second = std::min(first, 64);
  corners_.resize(2 * first);
  reduced_.resize(2 * second);
  CAMA_LAUNCH(b, position_bounds, first, state.vertices, from, to, corners_);
  CAMA_LAUNCH(b, reduce_bounds, second, first, corners_, reduced_);
  CAMA_LAUNCH(b, reduce_bounds, 1, second, reduced_, state.bounds);
}

void TreeSearch::build_levels(Backend &b, int leaves, Stream<kernels::box_group> &tree)
{
  const int root = kernels::group_root_level(leaves);
  for (int level = 0; level < root;) {
    const int both = level + 2 <= root ? 1 : 0;
    level += 1 + both;
    CAMA_LAUNCH(b, group_levels, GROUP * kernels::group_level_size(leaves, level), leaves, level, both, tree);
  }
}

void TreeSearch::build_faces(State &state, int leaves, const Stream<kernels::face_nodes> &leaf_face, Stream<kernels::box_group> &tree)
{
  tree.resize(kernels::group_tree_size(leaves));
  CAMA_LAUNCH(*state.backend, face_groups, kernels::group_level_size(leaves, 0), leaves, leaf_face, state.vertex_box, tree);
  build_levels(*state.backend, leaves, tree);
}

void TreeSearch::build_trees(State &state)
{
  if (state.faces) build_faces(state, state.faces, leaf_face_, state.face_groups);
  if (state.edges == 0) return;
  state.edge_groups.resize(kernels::group_tree_size(state.edges));
  CAMA_LAUNCH(*state.backend, edge_groups, kernels::group_level_size(state.edges, 0), state.edges, leaf_edge_, state.vertex_box, state.edge_groups);
  build_levels(*state.backend, state.edges, state.edge_groups);
}

/// Faces, edges and vertices along the Morton curve.
void TreeSearch::sort_features(State &state)
{
  Backend &b = *state.backend;
  const int asking = state.asking.size();
  key_.resize(std::max({state.faces, state.edges, asking}));
  state.face_order.resize(state.faces);
  state.edge_order.resize(state.edges);
  asking_.resize(asking);
  leaf_face_.resize(state.faces);
  leaf_edge_.resize(state.edges);
  CAMA_LAUNCH(b, face_boxes, state.faces, state.face, state.vertex_box, state.face_box);
  CAMA_LAUNCH(b, morton_codes, state.faces, state.face_box, state.bounds, key_, state.face_order);
  b.sort(key_.buffer(), state.face_order.buffer(), state.faces, morton_bits);
  CAMA_LAUNCH(b, order_faces, state.faces, state.face_order, state.face, leaf_face_);
  CAMA_LAUNCH(b, edge_boxes, state.edges, state.edge, state.vertex_box, state.edge_box);
  CAMA_LAUNCH(b, morton_codes, state.edges, state.edge_box, state.bounds, key_, state.edge_order);
  b.sort(key_.buffer(), state.edge_order.buffer(), state.edges, morton_bits);
  CAMA_LAUNCH(b, order_edges, state.edges, state.edge_order, state.edge, leaf_edge_);
  CAMA_LAUNCH(b, morton_codes_of, asking, state.asking, state.vertex_box, state.bounds, key_, asking_);
  b.sort(key_.buffer(), asking_.buffer(), asking, morton_bits);
}

/// Counts and then fills in the candidates of vertices and edges that ask, behind those that the lists have: one wait for both.
void TreeSearch::query(State &state, const std::vector<FaceQuery> &faces, int edge_mode, const Stream<int> &leaves)
{
  Backend &b = *state.backend;
  const int self = state.contact_settings.self ? 1 : 0;
  int vertex_items = 0;
  for (const FaceQuery &q : faces) vertex_items += q.items->size();
  const int edge_items = leaves.size(), items = vertex_items + edge_items;
  ++state.report.searches;
  if (items == 0) return;
  slot_.resize(slots * items);
  count_.resize(items);
  offset_.resize(items + 1);
  const auto batches = [&](int n, int batch) { return (n + batch - 1) / batch; };
  int at = 0;
  for (const FaceQuery &q : faces) {
    const int batch = q.mode == QUERY_CHANGED ? 1 : batch_, n = q.items->size();
    CAMA_LAUNCH(b, query_vertex_face_count, batches(n, batch), n, batch, *q.items, state.vertex_box, q.leaves, *q.order, *q.leaf_face, *q.tree,
                state.cloth_vertices, self, q.mode, changed_, before_, slots, at, slot_, count_);
    at += n;
  }
  const int edge_batch = edge_mode == QUERY_CHANGED ? 1 : batch_;
  CAMA_LAUNCH(b, query_edge_edge_count, batches(edge_items, edge_batch), edge_items, edge_batch, leaves, state.edges, state.edge_order, leaf_edge_,
              state.edge_groups, state.cloth_vertices, self, edge_mode, changed_, before_, slots, vertex_items, slot_, count_);
  b.scan(count_.buffer(), offset_.buffer(), items);
  CAMA_LAUNCH(b, scan_totals, 1, vertex_items, items, offset_, totals_);
  const kernels::pair found = totals_.at(0);
  const int first_face = state.vertex_face.pairs.size(), first_edge = state.edge_edge.pairs.size();
  const auto grow = [](PairList &list, int more) {
    if (more > 0x7fffffff - list.pairs.size()) throw MemoryError("a list of this scene exceeds 2^31 entries; lower the resolution or the contact thickness");
    list.pairs.grow(list.pairs.size() + more);
    list.known.grow(list.pairs.size());
  };
  grow(state.vertex_face, found.a);
  grow(state.edge_edge, found.b);
  at = 0;
  for (const FaceQuery &q : faces) {
    const int n = q.items->size();
    CAMA_LAUNCH(b, query_vertex_face_fill, n, *q.items, state.vertex_box, q.leaves, *q.order, *q.leaf_face, *q.tree, state.cloth_vertices, self,
                q.mode, before_, slots, at, slot_, count_, offset_, first_face, state.vertex_face.pairs, state.vertex_face.known);
    at += n;
  }
  CAMA_LAUNCH(b, query_edge_edge_fill, edge_items, leaves, state.edges, state.edge_order, leaf_edge_, state.edge_groups, state.cloth_vertices, self,
              edge_mode, changed_, before_, slots, vertex_items, slot_, count_, offset_, first_edge, state.edge_edge.pairs, state.edge_edge.known);
  drop_exempt(state, 0, first_face);
  drop_exempt(state, 1, first_edge);
  state.report.candidates = state.vertex_face.pairs.size() + state.edge_edge.pairs.size();
}

void TreeSearch::run(State &state, const Stream<dvec3> &from, const Stream<dvec3> &to)
{
  Backend &b = *state.backend;
  const bool sort = searches_since_sort_ == 0 || searches_since_sort_ >= searches_per_sort;
  if (sort) searches_since_sort_ = 0;   // stays so if anything below throws
  if (before_.size() == 0) {   // the last to be made
    std::vector<int> identity(static_cast<std::size_t>(std::max(state.vertices, state.edges)));
    std::iota(identity.begin(), identity.end(), 0);
    identity_.assign(identity);
    changed_.resize(state.vertices);
    before_.resize(state.vertices);
  }
  find_bounds(state, from, to);
  CAMA_LAUNCH(b, vertex_boxes, state.vertices, from, to, state.margin, state.bounds, state.vertex_box);
  if (sort) sort_features(state);
  build_trees(state);
  ++searches_since_sort_;
  for (PairList *list : {&state.vertex_face, &state.edge_edge}) {
    list->pairs.resize(0);
    list->known.resize(0);
    list->direction.resize(0);
    list->room.resize(0);
  }
  identity_.resize(state.edges);
  std::vector<FaceQuery> faces;
  if (state.faces) faces.push_back({QUERY_ALL, &asking_, state.faces, &state.face_order, &leaf_face_, &state.face_groups});
  query(state, faces, QUERY_ALL, identity_);
}

CandidateSearch::Change TreeSearch::update(State &state, const Stream<dvec3> &from, const Stream<dvec3> &to, double margin)
{
  Backend &b = *state.backend;
  if (searches_since_sort_ == 0) {
    run(state, from, to);
    find_directions(state, from, 0, 0);
    return Change::renewed;
  }
  CAMA_LAUNCH(b, grow_boxes, state.vertices, from, to, state.margin, state.bounds, margin, before_, state.vertex_box, changed_);
  offsets_.resize(state.vertices + 1);
  b.scan(changed_.buffer(), offsets_.buffer(), state.vertices);
  const int changed = offsets_.at(state.vertices);
  if (changed == 0) return Change::none;
  if (changed > most_changed * state.vertices) {
    run(state, from, to);
    find_directions(state, from, 0, 0);
    return Change::renewed;
  }
  identity_.resize(std::max(state.vertices, state.edges));
  changed_vertex_.resize(changed);
  CAMA_LAUNCH(b, keep_flagged, state.vertices, 0, offsets_, identity_, changed_vertex_);
  build_trees(state);

  const int features = state.faces + state.edges;
  flag_.resize(features);
  offsets_.resize(features + 1);
  CAMA_LAUNCH(b, changed_faces, state.faces, state.face_order, state.face, changed_, flag_);
  CAMA_LAUNCH(b, changed_edges, state.edges, state.faces, state.edge_order, state.edge, changed_, flag_);
  b.scan(flag_.buffer(), offsets_.buffer(), features);
  CAMA_LAUNCH(b, scan_totals, 1, state.faces, features, offsets_, totals_);
  const kernels::pair of = totals_.at(0);   // faces and edges with such vertices
  changed_face_.resize(of.a);
  changed_edge_.resize(of.b);
  CAMA_LAUNCH(b, keep_flagged, of.a ? state.faces : 0, 0, offsets_, state.face_order, changed_face_);
  CAMA_LAUNCH(b, keep_flagged, of.b ? state.edges : 0, state.faces, offsets_, identity_, changed_edge_);
  std::vector<FaceQuery> faces;
  if (of.a) {
    changed_leaf_face_.resize(of.a);
    CAMA_LAUNCH(b, order_faces, of.a, changed_face_, state.face, changed_leaf_face_);
    build_faces(state, of.a, changed_leaf_face_, changed_groups_);
    faces.push_back({QUERY_UNCHANGED, &asking_, of.a, &changed_face_, &changed_leaf_face_, &changed_groups_});
  }
  if (state.faces) faces.push_back({QUERY_CHANGED, &changed_vertex_, state.faces, &state.face_order, &leaf_face_, &state.face_groups});
  const int first_face = state.vertex_face.pairs.size(), first_edge = state.edge_edge.pairs.size();
  query(state, faces, QUERY_CHANGED, changed_edge_);
  find_directions(state, from, first_face, first_edge);
  return Change::grown;
}

void ProximitySearch::run(State &state)
{
  CAMA_LAUNCH(*state.backend, predict_positions, state.vertices, state.fixed, state.position, state.velocity, state.gravity,
              state.position_next, state.time_step, state.predicted);
  search_.run(state, state.position, state.predicted);
}

}  // namespace cama
