// SPDX-License-Identifier: Apache-2.0
#include "solver/aggregates.hpp"

#include <algorithm>

namespace cama {
namespace {
constexpr int max_rounds = 7;       // of pairwise matching: blocks of 2, 4, 8, 16, then the remaining nodes
constexpr int proposals = 4;            // proposals per round
// More levels make the sum overshoot: 142 iterations became 160 on the drape of 200,000 triangles.
constexpr int max_levels = 3;
constexpr double min_progress = 0.6;   // share of the nodes that a level has to remove, or it is the last
}  // namespace

Aggregates::Aggregates(Backend &b)
    : rows(b), graph_(b), merged_(b), key_(b), merged_key_(b), entry_(b), head_(b), place_(b), size_(b),
      joined_size_(b), mate_(b), proposal_(b), parent_(b), cluster_(b), strength_(b), weight_(b)
{}

void Aggregates::merge(Backend &b, int n, int nodes, Graph &graph)
{
  head_.resize(n);
  place_.resize(n + 1);
  b.sort(key_.buffer(), entry_.buffer(), n, key_bits(nodes));
  CAMA_LAUNCH(b, key_heads, n, key_, nodes, head_);
  b.scan(head_.buffer(), place_.buffer(), n);
  const int entries = n ? place_.at(n) : 0;
  merged_key_.resize(entries);
  graph.nodes = nodes;
  graph.row.resize(nodes + 1);
  graph.column.resize(entries);
  graph.weight.resize(entries);
  CAMA_LAUNCH(b, merge_entries, n, key_, entry_, place_, weight_, merged_key_, graph.column, graph.weight);
  CAMA_LAUNCH(b, row_starts, nodes + 1, entries, merged_key_, graph.row);
}

int Aggregates::match(Backend &b)
{
  const int start = graph_.nodes;
  int nodes = start;
  size_.resize(nodes);
  cluster_.resize(start);
  CAMA_LAUNCH(b, set_int, nodes, 0, 1, size_);
  CAMA_LAUNCH(b, number_items, start, cluster_);
  for (int round = 0; round < max_rounds && nodes > 1; ++round) {
    for (Stream<int> *s : {&mate_, &proposal_, &head_, &parent_, &joined_size_}) s->resize(nodes);
    place_.resize(nodes + 1);
    CAMA_LAUNCH(b, set_int, nodes, 0, -1, mate_);
    for (int i = 0; i < proposals; ++i) {
      CAMA_LAUNCH(b, propose_matches, nodes, graph_.row, graph_.column, graph_.weight, size_, BLOCK_ROWS, mate_,
                  proposal_);
      CAMA_LAUNCH(b, accept_matches, nodes, proposal_, mate_);
    }
    CAMA_LAUNCH(b, first_of_matches, nodes, mate_, head_);
    b.scan(head_.buffer(), place_.buffer(), nodes);
    CAMA_LAUNCH(b, join_matches, nodes, mate_, place_, size_, parent_, joined_size_);
    const int joined = place_.at(nodes);
    if (joined == nodes) break;
    CAMA_LAUNCH(b, follow_parents, start, parent_, cluster_);
    size_.swap(joined_size_);
    const int entries = graph_.column.size();
    key_.resize(entries);
    entry_.resize(entries);
    CAMA_LAUNCH(b, parent_keys, nodes, graph_.row, graph_.column, parent_, nodes, joined, 0, key_, entry_);
    weight_.swap(graph_.weight);
    merge(b, entries, joined, merged_);
    std::swap(graph_, merged_);
    nodes = joined;
  }
  return nodes;
}

void Aggregates::arrange(Backend &b, std::vector<Stream<int>> &parents, const std::vector<int> &count)
{
  const int levels = static_cast<int>(count.size());
  level_.clear();
  for (int l = 0; l < levels; ++l) level_.emplace_back(b);
  Stream<int> above(b, count.back()), here(b), sorted(b);   // places of blocks, places of nodes, nodes in order
  CAMA_LAUNCH(b, number_items, count.back(), above);
  for (int l = levels - 1; l >= 0; --l) {
    Level &level = level_[static_cast<std::size_t>(l)];
    const Stream<int> &parent = parents[static_cast<std::size_t>(l)];
    level.nodes = l ? count[static_cast<std::size_t>(l - 1)] : rows.size;
    level.blocks = count[static_cast<std::size_t>(l)];
    key_.resize(level.nodes);
    sorted.resize(level.nodes);
    here.resize(level.nodes);
    level.parent.resize(level.nodes);
    level.start.resize(level.blocks + 1);
    CAMA_LAUNCH(b, order_keys, level.nodes, parent, above, key_, sorted);
    b.sort(key_.buffer(), sorted.buffer(), level.nodes, key_bits(level.blocks));
    CAMA_LAUNCH(b, row_starts, level.blocks + 1, level.nodes, key_, level.start);
    CAMA_LAUNCH(b, invert_order, level.nodes, sorted, here);
    CAMA_LAUNCH(b, place_parents, level.nodes, here, parent, above, level.parent);
    above.swap(here);
  }
  Stream<int> vertex(b, rows.size);
  vertex.swap(rows.order);
  CAMA_LAUNCH(b, take_items, rows.size, sorted, vertex, rows.order);
  CAMA_LAUNCH(b, invert_order, rows.size, rows.order, rows.place);
}

template <class Real>
void Aggregates::build(const SolverRooms &state, const Stream<typename Types<Real>::mat3> &diagonal)
{
  Backend &b = *state.backend;
  System<Real> &s = state.system.template of<Real>();
  rows.number(state);
  if (rows.size == 0) return level_.clear();
  const int vertices = state.mesh.cloth_vertices, blocks = s.matrix.column.size();
  const int terms = terms_beside(state), entries = blocks + TERM_ENTRIES * terms;
  strength_.resize(vertices);
  key_.resize(entries);
  entry_.resize(entries);
  weight_.resize(entries);
  CAMA_LAUNCH_REAL(Real, b, vertex_strengths, vertices, diagonal, strength_);
  CAMA_LAUNCH_REAL(Real, b, matrix_entries, vertices, s.matrix.row, s.matrix.column, s.matrix.block, rows.place,
                   rows.size, strength_, key_, entry_, weight_);
  CAMA_LAUNCH_REAL(Real, b, term_entries, terms, blocks, vertices, s.term, rows.place, rows.size, strength_, key_,
                   entry_, weight_);
  merge(b, entries, rows.size, graph_);
  // Each level's clusters are the nodes of the next, until one block holds them all or matching makes no progress.
  std::vector<Stream<int>> parents;
  std::vector<int> count;
  do {
    const int before = graph_.nodes, now = match(b);
    if (!parents.empty() && now > min_progress * before) break;
    parents.emplace_back(b);
    parents.back().swap(cluster_);
    count.push_back(now);
  } while (count.back() > 1 && static_cast<int>(count.size()) < max_levels);
  arrange(b, parents, count);
  // The result serves many steps; the scratch memory is freed.
  graph_ = Graph(b);
  merged_ = Graph(b);
  for (Stream<int> *s : {&entry_, &head_, &place_, &size_, &joined_size_, &mate_, &proposal_, &parent_, &cluster_})
    *s = Stream<int>(b);
  for (Stream<key64> *s : {&key_, &merged_key_}) *s = Stream<key64>(b);
  for (Stream<float> *s : {&strength_, &weight_}) *s = Stream<float>(b);
}

bool Aggregates::adopt(const SolverRooms &state, const Matching &m)
{
  if (m.levels.size() > static_cast<std::size_t>(max_levels)) return false;
  Backend &b = *state.backend;
  rows.number(state);
  std::vector<int> free = rows.order.download(), order = m.order;
  std::sort(order.begin(), order.end());
  if (order != free) return false;
  rows.order.assign(m.order);
  CAMA_LAUNCH(b, invert_order, rows.size, rows.order, rows.place);
  level_.clear();
  for (std::size_t l = 0; l < m.levels.size(); ++l) {
    level_.emplace_back(b);
    level_[l].nodes = static_cast<int>(m.levels[l].parent.size());
    level_[l].blocks = static_cast<int>(m.levels[l].start.size()) - 1;
    level_[l].parent.assign(m.levels[l].parent);
    level_[l].start.assign(m.levels[l].start);
  }
  return true;
}

template void Aggregates::build<double>(const SolverRooms &, const Stream<kernels::f64::mat3> &);
template void Aggregates::build<float>(const SolverRooms &, const Stream<kernels::f32::mat3> &);

}  // namespace cama
