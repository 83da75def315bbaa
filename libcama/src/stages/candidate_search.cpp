// SPDX-License-Identifier: Apache-2.0
#include "stages/candidate_search.hpp"

#include <algorithm>
#include <numeric>

#include "launch.hpp"

namespace cama {
namespace {
constexpr int slots = 32;             // hits kept by the count pass
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
  list.direction.resize(first + kept);
}

void CandidateSearch::find_directions(State &state, const Stream<dvec3> &from, int first_vertex_face, int first_edge_edge)
{
  const auto direct = [&](int kind, PairList &list, int first) {
    CAMA_LAUNCH(*state.backend, find_directions, list.pairs.size() - first, kind, first, list.pairs, state.face, state.edge, from,
                state.vertex_contact, list.direction);
  };
  direct(0, state.vertex_face, first_vertex_face);
  direct(1, state.edge_edge, first_edge_edge);
}

TreeSearch::TreeSearch(Backend &b)
    : CandidateSearch(b), key_(b), slot_(b), count_(b), offset_(b), identity_(b), changed_(b), flag_(b), offsets_(b), changed_vertex_(b),
      changed_face_(b), changed_edge_(b), before_(b), changed_tree_(b)
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

void TreeSearch::build_tree(State &state, int leaves, const Stream<kernels::box> &boxes, Stream<int> &order,
                                 Stream<kernels::box> &tree, bool sort)
{
  Backend &b = *state.backend;
  if (sort) {
    key_.resize(leaves);
    CAMA_LAUNCH(b, morton_codes, leaves, boxes, state.bounds, key_, order);
    b.sort(key_.buffer(), order.buffer(), leaves, morton_bits);
  }
  CAMA_LAUNCH(b, tree_leaves, leaves, order, boxes, tree);
  const int root = kernels::tree_root_level(leaves);
  for (int level = 0; level < root;) {
    const int steps = kernels::tree_level_size(leaves, level) <= 256 ? root - level : std::min(3, root - level);
    level += steps;
    CAMA_LAUNCH(b, tree_levels, kernels::tree_level_size(leaves, level), leaves, level, steps, tree);
  }
}

void TreeSearch::build_boxes(State &state, bool sort)
{
  Backend &b = *state.backend;
  CAMA_LAUNCH(b, face_boxes, state.faces, state.face, state.vertex_box, state.face_box);
  CAMA_LAUNCH(b, edge_boxes, state.edges, state.edge, state.vertex_box, state.edge_box);
  build_tree(state, state.faces, state.face_box, state.face_order, state.face_tree, sort);
  build_tree(state, state.edges, state.edge_box, state.edge_order, state.edge_tree, sort);
}

namespace {

/// Adds up what the count pass found and makes room for it; returns the first new place.
int make_room(Backend &b, const Stream<int> &count, Stream<int> &offset, int items, PairList &list)
{
  b.scan(count.buffer(), offset.buffer(), items);
  const int first = list.pairs.size(), size = first + offset.at(items);
  list.pairs.grow(size);
  list.known.grow(size);
  list.direction.grow(size);
  return first;
}

}  // namespace

void TreeSearch::query_faces(State &state, int mode, const Stream<int> &items, int leaves, const Stream<int> &order,
                             const Stream<kernels::box> &tree)
{
  Backend &b = *state.backend;
  const int self = state.contact_settings.self ? 1 : 0, n = items.size();
  if (n == 0 || leaves == 0) return;
  CAMA_LAUNCH(b, query_vertex_face_count, n, items, state.vertex_box, leaves, order, tree, state.face, state.cloth_vertices, self, mode,
              changed_, before_, slots, slot_, count_);
  const int first = make_room(b, count_, offset_, n, state.vertex_face);
  CAMA_LAUNCH(b, query_vertex_face_fill, n, items, state.vertex_box, leaves, order, tree, state.face, state.cloth_vertices, self, mode,
              before_, slots, slot_, count_, offset_, first, state.vertex_face.pairs);
  drop_exempt(state, 0, first);
}

void TreeSearch::query_edges(State &state, int mode, const Stream<int> &items)
{
  Backend &b = *state.backend;
  const int self = state.contact_settings.self ? 1 : 0, n = items.size();
  if (n == 0) return;
  CAMA_LAUNCH(b, query_edge_edge_count, n, items, state.edges, state.edge_order, state.edge_tree, state.edge, state.cloth_vertices, self,
              mode, changed_, before_, slots, slot_, count_);
  const int first = make_room(b, count_, offset_, n, state.edge_edge);
  CAMA_LAUNCH(b, query_edge_edge_fill, n, items, state.edges, state.edge_order, state.edge_tree, state.edge, state.cloth_vertices, self,
              mode, changed_, before_, slots, slot_, count_, offset_, first, state.edge_edge.pairs);
  drop_exempt(state, 1, first);
}

void TreeSearch::run(State &state, const Stream<dvec3> &from, const Stream<dvec3> &to)
{
  Backend &b = *state.backend;
  const bool sort = searches_since_sort_ == 0 || searches_since_sort_ >= searches_per_sort;
  const int most = std::max(state.vertices, state.edges);
  if (sort) {
    searches_since_sort_ = 0;   // stays so if anything below throws
    state.face_order.resize(state.faces);
    state.edge_order.resize(state.edges);
    state.face_tree.resize(kernels::tree_size(state.faces));
    state.edge_tree.resize(kernels::tree_size(state.edges));
    if (before_.size() == 0) {   // the last to be made
      std::vector<int> identity(static_cast<std::size_t>(most));
      std::iota(identity.begin(), identity.end(), 0);
      identity_.assign(identity);
      changed_.resize(state.vertices);
      before_.resize(state.vertices);
    }
  }
  find_bounds(state, from, to);
  CAMA_LAUNCH(b, vertex_boxes, state.vertices, from, to, state.margin, state.bounds, state.vertex_box);
  build_boxes(state, sort);
  ++searches_since_sort_;

  slot_.resize(slots * most);
  count_.resize(most);
  offset_.resize(most + 1);
  for (PairList *list : {&state.vertex_face, &state.edge_edge}) {
    list->pairs.resize(0);
    list->known.resize(0);
    list->direction.resize(0);
  }
  query_faces(state, QUERY_ALL, state.asking, state.faces, state.face_order, state.face_tree);
  identity_.resize(state.edges);
  query_edges(state, QUERY_ALL, identity_);
  for (PairList *list : {&state.vertex_face, &state.edge_edge}) {
    list->known.fill_zero();
    list->direction.fill_zero();   // a zero direction certifies nothing
  }
  ++state.report.searches;
  state.report.candidates = state.vertex_face.pairs.size() + state.edge_edge.pairs.size();
}

int TreeSearch::keep(State &state, int n, const Stream<int> &flag, const Stream<int> &value, Stream<int> &kept)
{
  Backend &b = *state.backend;
  offsets_.resize(n + 1);
  b.scan(flag.buffer(), offsets_.buffer(), n);
  kept.resize(offsets_.at(n));
  if (kept.size()) CAMA_LAUNCH(b, keep_flagged, n, offsets_, value, kept);
  return kept.size();
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
  const int changed = keep(state, state.vertices, changed_, identity_, changed_vertex_);
  if (changed == 0) return Change::none;
  if (changed > most_changed * state.vertices) {
    run(state, from, to);
    find_directions(state, from, 0, 0);
    return Change::renewed;
  }
  build_boxes(state, false);
  const int first_face = state.vertex_face.pairs.size(), first_edge = state.edge_edge.pairs.size();
  flag_.resize(std::max(state.faces, state.edges));
  CAMA_LAUNCH(b, changed_faces, state.faces, state.face_order, state.face, changed_, flag_);
  if (const int faces = keep(state, state.faces, flag_, state.face_order, changed_face_)) {
    changed_tree_.resize(kernels::tree_size(faces));
    build_tree(state, faces, state.face_box, changed_face_, changed_tree_, false);
    query_faces(state, QUERY_UNCHANGED, state.asking, faces, changed_face_, changed_tree_);
  }
  query_faces(state, QUERY_CHANGED, changed_vertex_, state.faces, state.face_order, state.face_tree);
  CAMA_LAUNCH(b, changed_edges, state.edges, state.edge_order, state.edge, changed_, flag_);
  identity_.resize(state.edges);
  keep(state, state.edges, flag_, identity_, changed_edge_);
  query_edges(state, QUERY_CHANGED, changed_edge_);
  const auto clear = [&](PairList &list, int first) {
    CAMA_LAUNCH(b, set_int, list.known.size() - first, first, 0, list.known);
  };
  clear(state.vertex_face, first_face);
  clear(state.edge_edge, first_edge);
  find_directions(state, from, first_face, first_edge);
  ++state.report.searches;
  state.report.candidates = state.vertex_face.pairs.size() + state.edge_edge.pairs.size();
  return Change::grown;
}

void ProximitySearch::run(State &state)
{
  CAMA_LAUNCH(*state.backend, predict_positions, state.vertices, state.fixed, state.position, state.velocity, state.gravity,
              state.position_next, state.time_step, state.predicted);
  search_.run(state, state.position, state.predicted);
}

}  // namespace cama
