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
}  // namespace

bool CandidateSearch::covers(State &state, const Stream<dvec3> &from, const Stream<dvec3> &to, double margin)
{
  escaped_.fill_zero();
  CAMA_LAUNCH(*state.backend, check_coverage, state.vertices, from, to, state.vertex_box, state.bounds, margin, escaped_);
  return escaped_.at(0) == 0;
}

void CandidateSearch::find_directions(State &state, const Stream<dvec3> &from, int first_vertex_face, int first_edge_edge)
{
  const auto direct = [&](int kind, PairList &list, int first) {
    CAMA_LAUNCH(*state.backend, find_directions, list.pairs.size() - first, kind, first, list.pairs, state.face, state.edge, from,
                list.direction);
  };
  direct(0, state.vertex_face, first_vertex_face);
  direct(1, state.edge_edge, first_edge_edge);
}

bool CandidateSearch::update(State &state, const Stream<dvec3> &from, const Stream<dvec3> &to, double margin)
{
  if (covers(state, from, to, margin)) return false;
  run(state, from, to);
  find_directions(state, from, 0, 0);
  return true;
}

TreeSearch::TreeSearch(Backend &backend)
    : CandidateSearch(backend), corners_(backend), reduced_(backend), key_(backend), slot_(backend), count_(backend), offset_(backend), identity_(backend)
{}

void TreeSearch::find_bounds(State &state, const Stream<dvec3> &from, const Stream<dvec3> &to)
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

void TreeSearch::run(State &state, const Stream<dvec3> &from, const Stream<dvec3> &to)
{
  Backend &b = *state.backend;
  const bool sort = searches_since_sort_ == 0 || searches_since_sort_ >= searches_per_sort;
  if (sort) {
    searches_since_sort_ = 0;   // stays so if anything below throws
    state.face_order.resize(state.faces);
    state.edge_order.resize(state.edges);
    state.face_tree.resize(kernels::tree_size(state.faces));
    state.edge_tree.resize(kernels::tree_size(state.edges));
    if (identity_.size() == 0) {
      std::vector<int> identity(static_cast<std::size_t>(state.vertices));
      std::iota(identity.begin(), identity.end(), 0);
      identity_.assign(identity);
    }
  }
  find_bounds(state, from, to);
  CAMA_LAUNCH(b, vertex_boxes, state.vertices, from, to, state.margin, state.bounds, state.vertex_box);
  CAMA_LAUNCH(b, face_boxes, state.faces, state.face, state.vertex_box, state.face_box);
  CAMA_LAUNCH(b, edge_boxes, state.edges, state.edge, state.vertex_box, state.edge_box);
  build_tree(state, state.faces, state.face_box, state.face_order, state.face_tree, sort);
  build_tree(state, state.edges, state.edge_box, state.edge_order, state.edge_tree, sort);
  ++searches_since_sort_;

  const int self = state.contact_settings.self ? 1 : 0, most = std::max(state.vertices, state.edges);
  slot_.resize(slots * most);
  count_.resize(most);
  offset_.resize(most + 1);
  const auto finish = [&](int items, PairList &list) {
    b.scan(count_.buffer(), offset_.buffer(), items);
    list.pairs.resize(offset_.at(items));
    list.known.resize(list.pairs.size());
    list.known.fill_zero();
    list.direction.resize(list.pairs.size());
    list.direction.fill_zero();   // a zero direction certifies nothing
  };
  CAMA_LAUNCH(b, query_vertex_face_count, state.vertices, identity_, state.vertex_box, state.faces, state.face_order, state.face_tree,
              state.face, state.cloth_vertices, self, slots, slot_, count_);
  finish(state.vertices, state.vertex_face);
  CAMA_LAUNCH(b, query_vertex_face_fill, state.vertices, identity_, state.vertex_box, state.faces, state.face_order, state.face_tree,
              state.face, state.cloth_vertices, self, slots, slot_, count_, offset_, state.vertex_face.pairs);
  CAMA_LAUNCH(b, query_edge_edge_count, state.edges, state.edge_order, state.edge_tree, state.edge, state.cloth_vertices, self, slots,
              slot_, count_);
  finish(state.edges, state.edge_edge);
  CAMA_LAUNCH(b, query_edge_edge_fill, state.edges, state.edge_order, state.edge_tree, state.edge, state.cloth_vertices, self, slots,
              slot_, count_, offset_, state.edge_edge.pairs);
  ++state.report.searches;
  state.report.candidates = state.vertex_face.pairs.size() + state.edge_edge.pairs.size();
}

void ProximitySearch::run(State &state)
{
  CAMA_LAUNCH(*state.backend, predict_positions, state.vertices, state.fixed, state.position, state.velocity, state.gravity,
              state.position_next, state.time_step, state.predicted);
  search_.run(state, state.position, state.predicted);
}

}  // namespace cama
