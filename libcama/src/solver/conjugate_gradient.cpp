// SPDX-License-Identifier: Apache-2.0
#include "solver/conjugate_gradient.hpp"

#include <algorithm>
#include <cmath>

namespace cama {

static_assert(static_cast<int>(Preconditioner::jacobi) == PRECONDITIONER_JACOBI &&
              static_cast<int>(Preconditioner::block_jacobi) == PRECONDITIONER_BLOCK_JACOBI);
namespace {
constexpr double forces_slack = 10;         // times the tolerance, relative to the forces without penalties
constexpr double accepted = 1.2;            // times the goal, for the residual computed afresh
constexpr int max_refinements = 6;
constexpr int block = 4;                    // iterations that are enqueued at once
constexpr int few_rows = 65536;             // for which a launch costs more than terms that sum up their rows
/// r' P r, relative to its start, below which the recurrence in this precision departs from the true residual.
template <class S> constexpr double reachable = sizeof(S) == 8 ? 1e-28 : 4e-8;

/// column_length: numbers from column to column of a vector in columns; in_columns: number of vec4 that hold three
/// columns.
int column_length(int rows) { return ceil_divide(rows, SLICE_ROWS) * SLICE_ROWS; }
int in_columns(int rows) { return column_length(rows) / 4 * 3; }
}  // namespace

template <class S>
ConjugateGradient<S>::ConjugateGradient(Backend &b, Preconditioner kind)
    : kind_(kind), rows_(b), matrix_(b), inverse_(b), r_(b), z_(b), total_(b), w_(b), p_(b), s_(b), x_(b), product_(b),
      gradient_(b), partial_(b), scalar_(b, 2 * CG_COUNT)
{
  scalar_.fill_zero();
  if (kind == Preconditioner::schwarz) schwarz_ = std::make_unique<Schwarz<S>>(b);
}

template <class S> void ConjugateGradient<S>::forget()
{
  if (schwarz_) schwarz_->forget();
  pin_changes_ = step_ = -1;
  expected_[0] = expected_[1] = 0;
}

template <class S>
template <class Real>
void ConjugateGradient<S>::start_from(const SolverRooms &state, const Matching &matching)
{
  if (schwarz_) schwarz_->template adopt<Real>(state, matching);
}

template <class S> bool ConjugateGradient<S>::outdated(const SolverRooms &state) const
{
  if (schwarz_) return schwarz_->outdated(state);
  return pin_changes_ != state.mesh.pin_changes || state.options.paper.assembly != Assembly::gather;
}

template <class S>
template <class Real>
void ConjugateGradient<S>::prepare(const SolverRooms &state, Stream<typename Types<Real>::mat3> &diagonal,
                                   const std::function<void()> &beside)
{
  Backend &b = *state.backend;
  const BlockMatrix<Real> &matrix = state.system.template of<Real>().matrix;
  if (outdated(state)) {
    pin_changes_ = -1;   // remains so if anything below throws
    if (schwarz_) {
      schwarz_->template match<Real>(state, diagonal);
    } else {
      rows_.number(state);
      rows_.sort_by_length(b, matrix.row);
    }
  }
  if (pin_changes_ < 0) {
    if (rows().size) matrix_.template make_pattern<Real>(state, rows(), matrix);
    pin_changes_ = state.mesh.pin_changes;
  }
  if (rows().size == 0) return beside();
  if constexpr (sizeof(S) != sizeof(Real))
    if (gas_parts(state) > 0) {
      const auto &gradient = state.system.template of<Real>().gas_gradient;
      gradient_.resize(gradient.size());
      CAMA_LAUNCH_REAL(S, b, convert_gradient, 3 * gradient.size(), components<double>(gradient),
                       components<S>(gradient_));
    }
  matrix_.template fill<Real>(state, rows(), matrix);
  if (schwarz_) return schwarz_->template factor<Real>(state, matrix_, beside);
  beside();
  inverse_.resize(block_rows() * in_columns(rows_.size));
  CAMA_LAUNCH_REAL(Real, b, invert_diagonal, state.mesh.cloth_vertices, static_cast<int>(kind_), diagonal);
  CAMA_LAUNCH_REAL(S, b, pack_diagonal, rows_.size, rows_.order, component_stride(), block_rows(),
                   sizeof(Real) == 8 ? 1 : 0, as<double, Real>(diagonal), as<float, Real>(diagonal),
                   components<S>(inverse_));
}

template <class S> int ConjugateGradient<S>::component_stride() const
{
  return schwarz_ ? 0 : column_length(rows_.size);
}

template <class S>
template <class Real>
void ConjugateGradient<S>::gather(const SolverRooms &state, int plain, const Stream<typename Types<Real>::vec3> &right,
                                  const Stream<typename Types<Real>::vec3> &q)
{
  Backend &b = *state.backend;
  const int n = rows().size, is_double = sizeof(Real) == 8;
  if (schwarz_) {
    CAMA_LAUNCH_TEAMS(S, b, gather_block_residuals, CG_TEAM, schwarz_->group_start().size() - 1, schwarz_->levels(), n,
                      schwarz_->fine_blocks(), schwarz_->group_start(), schwarz_->block_start(), rows().order, plain,
                      is_double, as<double, Real>(right), as<double, Real>(q), as<float, Real>(right),
                      as<float, Real>(q), r_, scalar_);
    return;
  }
  CAMA_LAUNCH_REAL(S, b, gather_residual, n, rows().order, component_stride(), plain, is_double,
                   as<double, Real>(right), as<double, Real>(q), as<float, Real>(right), as<float, Real>(q),
                   components<S>(r_), scalar_);
  CAMA_LAUNCH_REAL(S, b, apply_diagonal, n, component_stride(), block_rows(), components<S>(inverse_),
                   components<S>(r_), z_);
}

template <class S>
const Stream<typename Types<S>::vec3> &ConjugateGradient<S>::gas_gradient(const SolverRooms &state) const
{
  if constexpr (sizeof(S) == 8)
    return state.system.f64->gas_gradient;
  else
    return state.system.f32 ? state.system.f32->gas_gradient : gradient_;
}

template <class S> void ConjugateGradient<S>::multiply_gas(const SolverRooms &state, int at)
{
  EnclosedGas &gas = state.system.gas;
  const int parts = gas_parts(state), stride = component_stride();
  if (parts == 0) return;
  CAMA_LAUNCH_TEAMS(S, *state.backend, gas_products, GAS_TEAM, parts, gas.vertex_part, rows().place,
                    gas_gradient(state), 4, components<S>(preconditioned()), at, scalar_, gas.product);
  CAMA_LAUNCH_TEAMS(S, *state.backend, add_gas_products, GAS_TEAM, parts, gas.vertex_part, gas.gas, gas.state,
                    rows().place, nothing<int>(), gas_gradient(state), gas.product, 1.0, stride ? 1 : 4,
                    stride ? stride : 1, at, scalar_, components<S>(w_), ceil_divide(rows().size, TEAM_ROWS), partial_);
}

template <class S> void ConjugateGradient<S>::advance(const SolverRooms &state, int from, int to)
{
  Backend &b = *state.backend;
  const int n = rows().size, partials = this->partials(state), most = state.options.max_iterations;
  if (schwarz_)
    CAMA_LAUNCH_TEAMS(S, b, cg_advance_blocks, CG_TEAM, schwarz_->group_start().size() - 1, schwarz_->levels(), n,
                      schwarz_->fine_blocks(), schwarz_->group_start(), schwarz_->block_start(), partials, partial_,
                      most, from, to, scalar_, total_, w_, p_, s_, x_, r_);
  else
    CAMA_LAUNCH_TEAMS(S, b, cg_advance, CG_TEAM, ceil_divide(n, CG_ROWS), n, component_stride(), block_rows(),
                      components<S>(inverse_), partials, partial_, most, from, to, scalar_, z_, components<S>(w_),
                      components<S>(p_), components<S>(s_), components<S>(x_), components<S>(r_));
}

template <class S> void ConjugateGradient<S>::multiply(const SolverRooms &state, int at)
{
  Backend &b = *state.backend;
  const int n = rows().size, terms = terms_beside(state);
  const auto combine = [&](int rows_here, int terms_here, int levels, const Stream<vec4> &z) {
    const Stream<int> &none = state.system.term_incidence.row;
    CAMA_LAUNCH_REAL(S, b, combine_levels, rows_here + terms_here, rows_here, levels, n,
                     levels > 1 ? schwarz_->fine_blocks() : 0, levels > 1 ? schwarz_->block_of_row() : none,
                     levels > 1 ? schwarz_->parents() : none, at, scalar_, z, matrix_.term_nodes, matrix_.term_value,
                     total_, product_);
  };
  if (schwarz_) {
    CAMA_LAUNCH_TEAMS(S, b, apply_blocks, APPLY_TEAM, schwarz_->blocks(), schwarz_->block_start(), at, scalar_,
                      schwarz_->factors(), schwarz_->weights(), r_, z_);
    // One launch less, but every term sums up its own rows; the bits are the same.
    const bool together = !b.wide_workers() && (4 * terms < n || n < few_rows);
    combine(n, together ? terms : 0, schwarz_->levels(), z_);
    if (!together) combine(0, terms, 1, total_);
  } else {
    combine(0, terms, 1, z_);
  }
  CAMA_LAUNCH_TEAMS(S, b, cg_multiply, CG_MULTIPLY_TEAM, ceil_divide(n, TEAM_ROWS), n, matrix_.start, matrix_.row,
                    matrix_.column, matrix_.value, terms > 0 ? 1 : 0, rows().order, state.system.term_incidence.row,
                    state.system.term_incidence.entry, matrix_.entry_weight, product_, at, scalar_, preconditioned(),
                    component_stride(), components<S>(r_), components<S>(w_), partial_);
  multiply_gas(state, at);
}

template <class S>
template <class Real>
typename ConjugateGradient<S>::Result
ConjugateGradient<S>::solve(const SolverRooms &state, const Stream<typename Types<Real>::vec3> *residual,
                            Stream<typename Types<Real>::vec3> &q, const Product<Real> &product, double slack)
{
  Backend &b = *state.backend;
  System<Real> &s = state.system.template of<Real>();
  const int n = rows().size, nodes = schwarz_ && n ? schwarz_->nodes() : n;
  Result result;
  if (n == 0) return result;
  const int length = schwarz_ ? n : in_columns(n);
  for (Stream<vec4> *v : {&w_, &p_, &s_, &x_}) v->resize(length);
  r_.resize(schwarz_ ? nodes : length);
  z_.resize(nodes);
  if (schwarz_) total_.resize(n);
  product_.resize(terms_beside(state));
  partial_.resize(2 * partials(state));
  const double tolerance = state.options.tolerance * slack, dt = state.time.step;
  const int most = state.options.max_iterations, partials = this->partials(state);
  const auto start_from = [&](int mode, int plain, const Stream<typename Types<Real>::vec3> &b1,
                              const Stream<typename Types<Real>::vec3> &q1) {
    gather<Real>(state, plain, b1, q1);
    multiply(state, 0);
    CAMA_LAUNCH_TEAMS(S, b, cg_start, CG_TEAM, 1, mode, partials, partial_, tolerance * tolerance,
                      forces_slack * forces_slack * dt * dt, std::min(1e-20, 1e-6 * tolerance * tolerance),
                      reachable<S>, scalar_);
  };
  const auto iterate = [&] {
    for (int i = 0; i < block; ++i) {
      const int from = i % 2 * CG_COUNT, to = CG_COUNT - from;
      advance(state, from, to);
      multiply(state, to);
    }
  };
  // Iterations are enqueued in blocks. Some too many, which do nothing, cost a GPU less than to wait once more.
  int &expected = expected_[step_ == state.report.step ? 1 : 0];
  const int blocks = b.wide_workers() ? expected * 7 / 8 / block : ceil_divide(expected, block);
  step_ = state.report.step;
  start_from(CG_MEASURE_FORCES, 1, s.force, q);
  std::vector<double> scalar;
  double before = 0;
  for (int refinement = 0;; ++refinement) {
    if (refinement == 0 && residual) {
      start_from(CG_MEASURE_START, 1, *residual, q);
    } else {
      product(s.solution, q);
      start_from(refinement == 0 ? CG_MEASURE_START : CG_MEASURE_CHECK, 0, s.right_side, q);
    }
    if (refinement == 0) b.repeat(std::max(1, blocks), iterate);
    scalar = scalar_.download();
    const double start = refinement == 0 ? scalar[CG_START] : scalar[CG_INNER] / reachable<S>;
    if (refinement == 0)
      result.start = start;
    else
      result.residual = result.start > 0 ? std::sqrt(start / result.start) : 0;
    const bool met = refinement > 0 && start <= accepted * accepted * scalar[CG_GOAL];
    if (met || refinement == max_refinements ||
        (refinement > 0 && (start > before / 4 || scalar[CG_ITERATIONS] >= most)))
      break;
    while (scalar[CG_DONE] == 0) {
      b.repeat(std::max(1, expected / (16 * block)), iterate);
      scalar = scalar_.download();
    }
    if (scalar[CG_BROKEN] != 0) {
      result.broken = true;
      break;
    }
    if (scalar[CG_ITERATIONS] == 0) break;   // nothing to do
    before = start;
    CAMA_LAUNCH_REAL(S, b, add_solution, n, rows().order, component_stride(), components<S>(x_),
                     static_cast<int>(sizeof(Real) == 8), as<double, Real>(s.solution), as<float, Real>(s.solution));
  }
  result.iterations = expected = static_cast<int>(scalar[CG_ITERATIONS]);
  if (schwarz_) schwarz_->note(state.report.step, result.iterations);
  return result;
}

template class ConjugateGradient<double>;
template class ConjugateGradient<float>;
#define CAMA_SOLVER(S, Real)                                                                                   \
  template void ConjugateGradient<S>::start_from<Real>(const SolverRooms &, const Matching &);                 \
  template void ConjugateGradient<S>::prepare<Real>(const SolverRooms &, Stream<typename Types<Real>::mat3> &, \
                                                    const std::function<void()> &);                            \
  template ConjugateGradient<S>::Result ConjugateGradient<S>::solve<Real>(                                     \
      const SolverRooms &, const Stream<typename Types<Real>::vec3> *, Stream<typename Types<Real>::vec3> &,   \
      const Product<Real> &, double);
CAMA_SOLVER(double, double)
CAMA_SOLVER(float, double)
CAMA_SOLVER(float, float)
#undef CAMA_SOLVER

}  // namespace cama
