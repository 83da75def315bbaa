// SPDX-License-Identifier: Apache-2.0
#include "solver/schwarz.hpp"

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "launch.hpp"

namespace cama {
namespace {

constexpr int steps_per_matching = 10;      // contacts may have changed what is strongly coupled
constexpr double changed_terms = 0.2;       // or as many terms as this fraction came or went
constexpr int iterations_per_block = 8;     // enqueued at once
constexpr double forces_slack = 10;         // of the tolerance, relative to the forces without penalties
constexpr double accepted = 1.2;            // of the goal, for the residual computed afresh
constexpr int most_refinements = 6;
/// Of r' P r relative to its start: where a recurrence in this precision would leave the true residual.
template <class S> constexpr double reachable = sizeof(S) == 8 ? 1e-28 : 4e-8;

int parts(int n, int size) { return (n + size - 1) / size; }

/// Terms that act beside the matrix; other ways of assembly put them in, in a new pattern every step.
int terms_beside(const State &state) { return state.options.assembly == Assembly::gather ? state.terms : 0; }

/// A stream of the precision of the forces as the two pointers of which kernels use one.
template <class Number, class Real, class T> Components<Number> as(const Stream<T> &stream)
{
  if constexpr (std::is_same_v<Number, Real>) return components<Number>(stream);
  else return nothing<Number>();
}

}  // namespace

template <class S>
SchwarzSolver<S>::SchwarzSolver(Backend &b)
    : aggregates_(b), slice_width_(b), slice_start_(b), slice_column_(b), slice_source_(b), slice_value_(b), term_nodes_(b), term_value_(b),
      factor_(b), coarse_factor_(b), weight_(b), coarse_weight_(b), block_start_(b), first_(b), last_(b), parent_(b), path_(b), vertex_parent_(b),
      sum_(b), other_sum_(b), r_(b), z_(b), total_(b), w_(b), p_(b), s_(b), x_(b), product_(b), coarse_r_(b), coarse_z_(b), partial_(b),
      scalar_(b, 2 * CG_COUNT)
{}

template <class S>
void SchwarzSolver<S>::make_slices(State &state, const Stream<int> &row, const Stream<int> &column)
{
  Backend &b = *state.backend;
  const int rows = aggregates_.rows(), slices = parts(rows, SLICE_ROWS);
  slice_width_.resize(slices);
  slice_start_.resize(slices + 1);
  CAMA_LAUNCH_REAL(S, b, slice_widths, slices, rows, aggregates_.order, row, column, state.cloth_vertices, aggregates_.place, slice_width_);
  b.scan(slice_width_.buffer(), slice_start_.buffer(), slices);
  const int entries = SLICE_ROWS * slice_start_.at(slices);
  slice_column_.resize(entries);
  slice_source_.resize(entries);
  slice_value_.resize(9 * entries);
  CAMA_LAUNCH_REAL(S, b, fill_slices, SLICE_ROWS * slices, rows, aggregates_.order, row, column, state.cloth_vertices, aggregates_.place,
                   slice_start_, slice_column_, slice_source_);
}

template <class S>
void SchwarzSolver<S>::make_level(Backend &b, int l, const Stream<int> &row, const Stream<int> &column, int rows, int columns,
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
  level.ancestor.resize(aggregates_.rows());
  if (l == 1) level.ancestor.copy_from(aggregates_.level(0).parent);
  else CAMA_LAUNCH(b, take_items, aggregates_.rows(), level_[static_cast<std::size_t>(l - 1)].ancestor, aggregates_.level(l - 1).parent, level.ancestor);
}

template <class S>
void SchwarzSolver<S>::make_tables(Backend &b)
{
  coarse_blocks_ = coarse_nodes_ = 0;
  const int levels = aggregates_.levels();
  for (int l = 1; l < levels; ++l) {
    coarse_blocks_ += aggregates_.level(l).blocks;
    coarse_nodes_ += aggregates_.level(l).nodes;
  }
  block_start_.resize(coarse_blocks_ + 1);
  for (Stream<int> *s : {&first_, &last_, &parent_}) s->resize(coarse_nodes_);
  for (int l = 1, nodes = 0, blocks = 0, below = 0; l < levels; ++l) {
    const auto &level = aggregates_.level(l);
    CAMA_LAUNCH(b, shift_items, level.blocks + 1, level.start, nodes, blocks, block_start_);
    if (l == levels - 1) CAMA_LAUNCH(b, set_int, level.nodes, nodes, -1, parent_);
    else CAMA_LAUNCH(b, shift_items, level.nodes, level.parent, nodes + level.nodes, nodes, parent_);
    CAMA_LAUNCH(b, cover_nodes, level.nodes, l == 1 ? -1 : below, nodes, aggregates_.level(l - 1).start, first_, last_);
    below = nodes;
    nodes += level.nodes;
    blocks += level.blocks;
  }
  if (levels == 1) return;
  path_.resize((levels - 1) * aggregates_.level(0).blocks);
  CAMA_LAUNCH_REAL(S, b, coarse_paths, aggregates_.level(0).blocks, levels - 1, parent_, path_);
}

template <class S> template <class Real>
void SchwarzSolver<S>::make_pattern(State &state)
{
  Backend &b = *state.backend;
  System<Real> &s = state.system<Real>();
  level_.clear();
  if (aggregates_.rows() == 0) return;
  make_slices(state, s.matrix.row, s.matrix.column);
  vertex_parent_.resize(state.cloth_vertices);
  CAMA_LAUNCH(b, vertex_parents, state.cloth_vertices, aggregates_.place, aggregates_.level(0).parent, vertex_parent_);
  for (int l = 0; l < aggregates_.levels(); ++l) {
    level_.emplace_back(b);
    if (l == 1) make_level(b, l, s.matrix.row, s.matrix.column, state.cloth_vertices, state.cloth_vertices, vertex_parent_);
    if (l < 2) continue;
    const Level &below = level_[static_cast<std::size_t>(l - 1)];
    const int nodes = aggregates_.level(l - 1).nodes;
    make_level(b, l, below.row, below.column, nodes, nodes, aggregates_.level(l - 1).parent);
  }
  make_tables(b);
}

template <class S>
bool SchwarzSolver<S>::outdated(const State &state) const
{
  if (terms_ < 0 || state.options.assembly != Assembly::gather) return true;
  return (state.terms > 0 && state.report.step - matched_ >= steps_per_matching) || std::abs(state.terms - terms_) > changed_terms * (state.terms + terms_) + 64;
}

/// The terms' part of the coarse diagonals: each level sums what rows add, child by child.
template <class S>
void SchwarzSolver<S>::weigh_terms(State &state)
{
  Backend &b = *state.backend;
  const bool wide = sizeof(S) == 8;
  for (int l = 1; l < aggregates_.levels(); ++l) {
    Level &level = level_[static_cast<std::size_t>(l)];
    sum_.resize(6 * aggregates_.rows());
    CAMA_LAUNCH(b, term_diagonals, aggregates_.rows(), aggregates_.order, state.term_incidence.row, state.term_incidence.entry, term_nodes_,
                level.ancestor, wide ? 1 : 0, as<double, S>(term_value_), as<float, S>(term_value_), sum_);
    for (int k = 0; k < l; ++k) {
      Stream<double> &to = k == l - 1 ? level.diagonal : other_sum_;
      to.resize(6 * aggregates_.level(k).blocks);
      CAMA_LAUNCH(b, sum_children, to.size(), aggregates_.level(k).start, sum_, to);
      if (k < l - 1) sum_.swap(other_sum_);
    }
  }
}

template <class S> template <class Real>
void SchwarzSolver<S>::prepare(State &state, const Stream<typename Types<Real>::mat3> &diagonal)
{
  Backend &b = *state.backend;
  System<Real> &s = state.system<Real>();
  if (outdated(state)) {
    terms_ = -1;   // stays so if anything below throws
    aggregates_.build<Real>(state, diagonal);
    make_pattern<Real>(state);
    terms_ = state.terms;
    matched_ = state.report.step;   // by number: a step that fails and is taken again counts once
  }
  if (aggregates_.rows() == 0) return;
  const int wide = sizeof(Real) == 8;
  CAMA_LAUNCH_REAL(S, b, fill_slice_values, slice_source_.size(), slice_source_, wide, as<double, Real>(s.matrix.block),
                   as<float, Real>(s.matrix.block), slice_value_);
  if (const int terms = terms_beside(state)) {
    term_nodes_.resize(terms);
    term_value_.resize(9 * terms);
    product_.resize(terms);
    CAMA_LAUNCH_REAL(Real, b, pack_terms, terms, s.term, state.cloth_vertices, aggregates_.place, sizeof(S) == 8 ? 1 : 0, term_nodes_,
                     as<double, S>(term_value_), as<float, S>(term_value_));
    weigh_terms(state);
  }
  const auto &fine = aggregates_.level(0);
  const int terms = terms_beside(state) > 0;
  factor_.resize(FACTOR_WORDS * fine.blocks);
  weight_.resize(BLOCK_SIZE * fine.blocks);
  coarse_factor_.resize(FACTOR_WORDS * coarse_blocks_);
  coarse_weight_.resize(BLOCK_SIZE * coarse_blocks_);
  CAMA_LAUNCH_TEAMS(S, b, factor_fine_blocks, BLOCK_TEAM, fine.blocks, fine.start, slice_start_, slice_column_, slice_value_, terms,
                    aggregates_.order, state.term_incidence.row, state.term_incidence.entry, term_nodes_, term_value_, factor_, weight_);
  for (int l = 1, at = 0; l < aggregates_.levels(); ++l) {
    Level &level = level_[static_cast<std::size_t>(l)];
    const int blocks = aggregates_.level(l).blocks;
    if (l == 1) CAMA_LAUNCH(b, coarse_values, level.value.size(), level.source_start, level.source, wide, as<double, Real>(s.matrix.block),
                            as<float, Real>(s.matrix.block), level.value);
    else CAMA_LAUNCH(b, coarse_values, level.value.size(), level.source_start, level.source, 1, level_[static_cast<std::size_t>(l - 1)].value,
                     nothing<float>(), level.value);
    CAMA_LAUNCH_TEAMS(S, b, factor_coarse_blocks, BLOCK_TEAM, blocks, at, aggregates_.level(l).start, level.row, level.column, level.value,
                      terms, level.diagonal, coarse_factor_, coarse_weight_);
    at += blocks;
  }
}

template <class S>
void SchwarzSolver<S>::apply(State &state, int at)
{
  Backend &b = *state.backend;
  const auto &fine = aggregates_.level(0);
  const int rows = aggregates_.rows(), levels = aggregates_.levels() - 1, terms = terms_beside(state);
  CAMA_LAUNCH_TEAMS(S, b, apply_blocks, BLOCK_TEAM, fine.blocks, 0, fine.start, first_, last_, at, scalar_, factor_, weight_,
                    components<S>(r_), components<S>(z_), components<S>(coarse_r_));
  CAMA_LAUNCH_TEAMS(S, b, apply_blocks, BLOCK_TEAM, coarse_blocks_, 1, block_start_, first_, last_, at, scalar_, coarse_factor_, coarse_weight_,
                    components<S>(coarse_r_), components<S>(coarse_z_), nothing<S>());
  const auto combine = [&](int rows_now, int terms_now, int levels_now, const Stream<vec3> &z) {
    CAMA_LAUNCH_REAL(S, b, combine_levels, rows_now + terms_now, rows_now, levels_now, fine.parent, path_, at, scalar_, coarse_z_, z,
                     term_nodes_, term_value_, total_, product_);
  };
  if (b.processor()) {   // terms read what rows have summed: less work, one launch more, the same bits
    combine(rows, 0, levels, z_);
    combine(0, terms, 0, total_);
  } else {
    combine(rows, terms, levels, z_);
  }
  CAMA_LAUNCH_TEAMS(S, b, cg_multiply, TEAM_ROWS, parts(rows, TEAM_ROWS), rows, slice_start_, slice_column_, slice_value_, terms > 0,
                    aggregates_.order, state.term_incidence.row, state.term_incidence.entry, term_value_, product_, at, scalar_, total_, r_, w_,
                    partial_);
}

template <class S> template <class Real>
typename SchwarzSolver<S>::Result SchwarzSolver<S>::solve(State &state, Stream<typename Types<Real>::vec3> &q, const Product<Real> &multiply)
{
  Backend &b = *state.backend;
  System<Real> &s = state.system<Real>();
  const int rows = aggregates_.rows(), wide = sizeof(Real) == 8;
  Result result;
  if (rows == 0) return result;
  for (Stream<vec3> *v : {&r_, &z_, &total_, &w_, &p_, &s_, &x_}) v->resize(rows);
  coarse_r_.resize(aggregates_.level(0).blocks);
  coarse_z_.resize(coarse_nodes_);
  partial_.resize(2 * parts(rows, TEAM_ROWS));
  const double tolerance = state.options.tolerance, dt = state.time_step;
  const int most = state.options.max_iterations, partials = parts(rows, TEAM_ROWS), numbers = 3 * rows;
  const auto start_from = [&](int mode, int plain, const Stream<typename Types<Real>::vec3> &b1, const Stream<typename Types<Real>::vec3> &q1) {
    if (mode == CG_MEASURE_FORCES) scalar_.fill_zero();
    CAMA_LAUNCH_REAL(S, b, gather_residual, rows, aggregates_.order, plain, wide, as<double, Real>(b1), as<double, Real>(q1),
                     as<float, Real>(b1), as<float, Real>(q1), components<S>(r_), scalar_);
    apply(state, 0);
    CAMA_LAUNCH_TEAMS(S, b, cg_start, CG_TEAM, 1, mode, partials, partial_, tolerance * tolerance, forces_slack * forces_slack * dt * dt,
                      std::min(1e-20, 1e-6 * tolerance * tolerance), reachable<S>, scalar_);
  };
  const auto iterate = [&] {
    for (int i = 0; i < iterations_per_block; ++i) {
      const int from = i % 2 * CG_COUNT, to = CG_COUNT - from;
      CAMA_LAUNCH_TEAMS(S, b, cg_advance, CG_TEAM, parts(numbers, CG_NUMBERS), numbers, partials, partial_, most, from, to, scalar_,
                        components<S>(total_), components<S>(w_), components<S>(p_), components<S>(s_), components<S>(x_), components<S>(r_));
      apply(state, to);
    }
  };
  start_from(CG_MEASURE_FORCES, 1, s.force, q);
  std::vector<double> scalar;
  double before = 0;
  for (int refinement = 0;; ++refinement) {
    multiply(s.solution, q);
    start_from(refinement == 0 ? CG_MEASURE_START : CG_MEASURE_CHECK, 0, s.right_side, q);
    if (refinement == 0) b.repeat(std::max(1, expected_ * 7 / 8 / iterations_per_block), iterate);
    bool recorded = refinement == 0;
    scalar = scalar_.download();
    const double start = refinement == 0 ? scalar[CG_START] : scalar[CG_INNER] / reachable<S>;
    if (refinement > 0) result.residual = scalar[CG_START] > 0 ? std::sqrt(start / scalar[CG_START]) : 0;
    const bool met = refinement > 0 && start <= accepted * accepted * scalar[CG_GOAL];
    if (met || refinement == most_refinements || (refinement > 0 && start > before / 4) || scalar[CG_ITERATIONS] >= most) break;
    while (scalar[CG_DONE] == 0) {
      b.repeat(1, iterate, recorded);
      recorded = true;
      scalar = scalar_.download();
    }
    if (scalar[CG_BROKEN] != 0) {
      result.broken = true;
      break;
    }
    if (scalar[CG_ITERATIONS] == 0) break;   // nothing to do
    before = start;
    CAMA_LAUNCH_REAL(S, b, add_solution, rows, aggregates_.order, components<S>(x_), wide, as<double, Real>(s.solution), as<float, Real>(s.solution));
  }
  result.iterations = expected_ = static_cast<int>(scalar[CG_ITERATIONS]);
  return result;
}

#define CAMA_SCHWARZ(S, Real)                                                                                                      \
  template void SchwarzSolver<S>::prepare<Real>(State &, const Stream<typename Types<Real>::mat3> &);                              \
  template SchwarzSolver<S>::Result SchwarzSolver<S>::solve<Real>(State &, Stream<typename Types<Real>::vec3> &, const Product<Real> &);
template class SchwarzSolver<double>;
template class SchwarzSolver<float>;
CAMA_SCHWARZ(double, double)
CAMA_SCHWARZ(float, double)
CAMA_SCHWARZ(float, float)
#undef CAMA_SCHWARZ

}  // namespace cama
