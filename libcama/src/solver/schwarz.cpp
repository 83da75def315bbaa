// SPDX-License-Identifier: Apache-2.0
#include "solver/schwarz.hpp"

#include <cmath>

namespace cama {
namespace {
// A matching is kept for some steps, although contacts may change the strong couplings. Few do: keeping it for 10 or 60
// steps differs by 0 to 6 % of iterations.
constexpr int min_steps = 10, max_steps = 60;
constexpr double longer_solves = 1.1;  // relative to the step of the matching
constexpr double changed_terms = 0.2;  // fraction of terms that have appeared or disappeared
}  // namespace

template <class S>
Schwarz<S>::Schwarz(Backend &b)
    : aggregates_(b), factor_(b), block_start_(b), group_start_(b), vertex_parent_(b), weight_(b), sum_(b),
      other_sum_(b)
{}

template <class S>
void Schwarz<S>::make_level(Backend &b, int l, const Stream<int> &row, const Stream<int> &column, int rows, int columns,
                            const Stream<int> &parent)
{
  Level &level = level_[static_cast<std::size_t>(l)];
  const int n = column.size(), nodes = aggregates_.level(l).nodes;
  Stream<key64> key(b, n), coarse_key(b);
  Stream<int> head(b, n), place(b, n + 1);
  level.source.resize(n);
  CAMA_LAUNCH(b, parent_keys, rows, row, column, parent, columns, nodes, 1, key, level.source);
  b.sort(key.buffer(), level.source.buffer(), n, key_bits(nodes));
  CAMA_LAUNCH(b, key_heads, n, key, nodes, head);
  b.scan(head.buffer(), place.buffer(), n);
  const int entries = place.at(n);
  coarse_key.resize(entries);
  level.column.resize(entries);
  level.source_start.resize(entries + 1);
  level.row.resize(nodes + 1);
  level.value.resize(9 * entries);
  CAMA_LAUNCH(b, coarse_pattern, n, key, place, nodes, coarse_key, level.column, level.source_start);
  CAMA_LAUNCH(b, row_starts, nodes + 1, entries, coarse_key, level.row);
  // The ancestors of rows.
  level.ancestor.resize(aggregates_.rows.size);
  if (l == 1)
    level.ancestor.copy_from(aggregates_.level(0).parent);
  else
    CAMA_LAUNCH(b, take_items, aggregates_.rows.size, level_[static_cast<std::size_t>(l - 1)].ancestor,
                aggregates_.level(l - 1).parent, level.ancestor);
}

template <class S> void Schwarz<S>::make_tables(Backend &b)
{
  const int levels = aggregates_.levels();
  blocks_ = nodes_ = 0;
  for (int l = 0; l < levels; ++l) {
    blocks_ += aggregates_.level(l).blocks;
    nodes_ += aggregates_.level(l).nodes;
  }
  block_start_.resize(blocks_ + 1);
  for (int l = 0, nodes = 0, blocks = 0; l < levels; ++l) {
    const auto &level = aggregates_.level(l);
    CAMA_LAUNCH(b, shift_items, level.blocks + 1, level.start, nodes, blocks, block_start_);
    nodes += level.nodes;
    blocks += level.blocks;
  }
  if (levels > 1) return;
  const int blocks = aggregates_.level(0).blocks;
  std::vector<int> start;
  for (int i = 0; i < blocks; i += BLOCK_ROWS) start.push_back(i);
  start.push_back(blocks);
  group_start_.assign(start);
}

template <class S>
template <class Real>
void Schwarz<S>::match(const SolverRooms &state, const Stream<typename Types<Real>::mat3> &diagonal)
{
  terms_ = -1;  // remains so if anything below throws
  aggregates_.build<Real>(state, diagonal);
  make_levels<Real>(state);
  terms_ = state.system.terms;
  pin_changes_ = state.mesh.pin_changes;
  matched_ = state.report.step;  // the number of the step: one that fails and is taken again counts once
}

template <class S> template <class Real> void Schwarz<S>::make_levels(const SolverRooms &state)
{
  level_.clear();
  if (rows().size == 0) return;
  Backend &b = *state.backend;
  const BlockMatrix<Real> &matrix = state.system.template of<Real>().matrix;
  vertex_parent_.resize(state.mesh.cloth_vertices);
  CAMA_LAUNCH(b, vertex_parents, state.mesh.cloth_vertices, rows().place, aggregates_.level(0).parent, vertex_parent_);
  for (int l = 0; l < aggregates_.levels(); ++l) {
    level_.emplace_back(b);
    if (l == 1)
      make_level(b, l, matrix.row, matrix.column, state.mesh.cloth_vertices, state.mesh.cloth_vertices, vertex_parent_);
    if (l < 2) continue;
    const Level &below = level_[static_cast<std::size_t>(l - 1)];
    const int nodes = aggregates_.level(l - 1).nodes;
    make_level(b, l, below.row, below.column, nodes, nodes, aggregates_.level(l - 1).parent);
  }
  make_tables(b);
}

template <class S> void Schwarz<S>::note(int step, int iterations)
{
  if (step != last_.step) {
    before_ = last_;
    last_ = {step, 0};
  }
  last_.iterations = std::max(last_.iterations, iterations);
  if (step == matched_) first_ = last_.iterations;
}

template <class S> void Schwarz<S>::forget()
{
  terms_ = -1;
  last_ = before_ = {};
  first_ = matched_ = pin_changes_ = 0;
}

template <class S> Matching Schwarz<S>::matching(const SolverRooms &state) const
{
  Matching m;
  if (terms_ < 0 || pin_changes_ != state.mesh.pin_changes || rows().size == 0) return m;
  m.step = matched_;
  m.terms = terms_;
  m.first_iterations = first_;
  m.last_iterations = last_.iterations;
  m.order = rows().order.download();
  for (int l = 0; l < levels(); ++l)
    m.levels.push_back({aggregates_.level(l).parent.download(), aggregates_.level(l).start.download()});
  return m;
}

template <class S> template <class Real> void Schwarz<S>::adopt(const SolverRooms &state, const Matching &m)
{
  if (m.order.empty() || !aggregates_.adopt(state, m)) return;
  make_levels<Real>(state);
  terms_ = m.terms;
  pin_changes_ = state.mesh.pin_changes;
  matched_ = m.step;
  first_ = m.first_iterations;
  before_ = {m.step, 0};
  last_ = {state.report.step - 1, m.last_iterations};
}

template <class S> bool Schwarz<S>::outdated(const SolverRooms &state) const
{
  if (terms_ < 0 || pin_changes_ != state.mesh.pin_changes || state.options.paper.assembly != Assembly::gather)
    return true;
  const int age = state.report.step - matched_;
  // A step that is taken again decides as before.
  const Solve &solve = last_.step < state.report.step ? last_ : before_;
  if (state.system.terms > 0 && (age >= max_steps || (age >= min_steps && solve.iterations > longer_solves * first_)))
    return true;
  return std::abs(state.system.terms - terms_) > changed_terms * (state.system.terms + terms_) + 64;
}

/// The terms' part of the coarse diagonals: each level sums the parts of the rows, child by child.
template <class S>
template <class Real>
void Schwarz<S>::find_coarse(const SolverRooms &state, const SlicedMatrix<S> &matrix)
{
  Backend &b = *state.backend;
  System<Real> &s = state.system.template of<Real>();
  const int n = rows().size, coarse = levels() - 1, is_double = sizeof(Real) == 8;
  if (coarse == 0) return;
  const bool terms = terms_beside(state) > 0;
  const auto level = [&](int l) -> Level & { return level_[static_cast<std::size_t>(l)]; };
  {
    const SideBySide side_by_side(b);
    CAMA_LAUNCH(b, coarse_values, level(1).value.size(), level(1).source_start, level(1).source, is_double,
                as<double, Real>(s.matrix.block), as<float, Real>(s.matrix.block), level(1).value);
    if (terms) {
      sum_.resize(6 * n * coarse);
      CAMA_LAUNCH(b, term_diagonals, n * coarse, n, rows().order, state.system.term_incidence.row,
                  state.system.term_incidence.entry, matrix.term_nodes, level(1).ancestor, level(coarse).ancestor,
                  sizeof(S) == 8 ? 1 : 0, as<double, S>(matrix.term_value), as<float, S>(matrix.term_value), sum_);
    }
  }
  const auto sum_up = [&](int l, int first, const Stream<double> &from, Stream<double> &to) {
    to.resize(6 * aggregates_.level(l).blocks);
    CAMA_LAUNCH(b, sum_children, to.size(), first, aggregates_.level(l).start, from, to);
  };
  {
    const SideBySide side_by_side(b);
    if (coarse > 1)
      CAMA_LAUNCH(b, coarse_values, level(2).value.size(), level(2).source_start, level(2).source, 1, level(1).value,
                  nothing<float>(), level(2).value);
    if (terms) sum_up(0, 0, sum_, level(1).diagonal);
    if (terms && coarse > 1) sum_up(0, n, sum_, other_sum_);
  }
  if (terms && coarse > 1) sum_up(1, 0, other_sum_, level(2).diagonal);
}

template <class S>
template <class Real>
void Schwarz<S>::factor(const SolverRooms &state, const SlicedMatrix<S> &matrix, const std::function<void()> &beside)
{
  Backend &b = *state.backend;
  const int terms = terms_beside(state) > 0, fine = aggregates_.level(0).blocks;
  factor_.resize(FACTOR_WORDS * blocks_);
  weight_.resize(BLOCK_SIZE * blocks_);
  // Level 0 stands for a level that does not exist: it is empty, and no block is on it.
  const auto level = [&](int l) -> const Level & { return level_[static_cast<std::size_t>(l < levels() ? l : 0)]; };
  const auto factor_from = [&](int begin, int n) {
    CAMA_LAUNCH_TEAMS(S, b, factor_blocks, BLOCK_TEAM, n, begin, fine,
                      fine + (levels() > 1 ? aggregates_.level(1).blocks : 0), block_start_, matrix.start, matrix.place,
                      matrix.column, matrix.value, terms, rows().order, state.system.term_incidence.row,
                      state.system.term_incidence.entry, matrix.term_nodes, matrix.term_value, level(1).row,
                      level(1).column, level(1).value, level(1).diagonal, level(2).row, level(2).column, level(2).value,
                      level(2).diagonal, factor_, weight_);
  };
  Fork fork(b);
  fork.aside([&] {
    beside();
    factor_from(0, fine);
  });
  find_coarse<Real>(state, matrix);
  factor_from(fine, blocks_ - fine);
}

template class Schwarz<double>;
template class Schwarz<float>;
#define CAMA_SCHWARZ(S, Real)                                                                             \
  template void Schwarz<S>::match<Real>(const SolverRooms &, const Stream<typename Types<Real>::mat3> &); \
  template void Schwarz<S>::adopt<Real>(const SolverRooms &, const Matching &);                           \
  template void Schwarz<S>::factor<Real>(const SolverRooms &, const SlicedMatrix<S> &, const std::function<void()> &);
CAMA_SCHWARZ(double, double)
CAMA_SCHWARZ(double, float)
CAMA_SCHWARZ(float, double)
CAMA_SCHWARZ(float, float)
#undef CAMA_SCHWARZ

}  // namespace cama
