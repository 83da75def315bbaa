// SPDX-License-Identifier: Apache-2.0
#include "stages/linear_solve.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/LU>
#include <Eigen/SparseCholesky>

#include "device/ceil_divide.hpp"
#include "device/launch.hpp"

namespace cama {
template <class Real>
LinearSolve<Real>::LinearSolve(Backend &b) : diagonal_(b), r_(b), p_(b), q_(b), product_(b), partial_(b), sum_(b)
{}

template <class Real>
void multiply_gas(Backend &b, SystemState &system, const Stream<typename Types<Real>::vec3> &x, double factor,
                  const Stream<int> &fixed, Stream<typename Types<Real>::vec3> &q)
{
  EnclosedGas &gas = system.gas;
  const Stream<typename Types<Real>::vec3> &gradient = system.of<Real>().gas_gradient;
  const int parts = gas.vertex_part.size();
  CAMA_LAUNCH_TEAMS(Real, b, gas_products, GAS_TEAM, parts, gas.vertex_part, nothing<int>(), gradient, 3,
                    components<Real>(x), 0, nothing<double>(), gas.product);
  CAMA_LAUNCH_TEAMS(Real, b, add_gas_products, GAS_TEAM, parts, gas.vertex_part, gas.gas, gas.state, nothing<int>(),
                    fixed, gradient, gas.product, factor, 3, 1, 0, nothing<double>(), components<Real>(q), 0,
                    nothing<double>());
}

template void multiply_gas<double>(Backend &, SystemState &, const Stream<Types<double>::vec3> &, double,
                                   const Stream<int> &, Stream<Types<double>::vec3> &);
template void multiply_gas<float>(Backend &, SystemState &, const Stream<Types<float>::vec3> &, double,
                                  const Stream<int> &, Stream<Types<float>::vec3> &);

namespace {

/// Solves the equation with the stiffness of enclosed gas from a factorisation without it (Woodbury's formula), and
/// moves the forces of that stiffness to the right-hand side. x: velocities of fixed
/// vertices.
template <class Real, class Factor>
Eigen::VectorXd solve_with_gas(SystemState &system, const Factor &factor, const std::vector<int> &fixed,
                               const std::vector<typename Types<Real>::vec3> &x, Eigen::VectorXd &right)
{
  Eigen::VectorXd v = factor.solve(right);
  const std::vector<kernels::gas> gases = system.gas.gas.download();
  if (gases.empty()) return v;
  const auto state = system.gas.state.download();
  const auto gradient = system.of<Real>().gas_gradient.download();
  const auto gas_of = system.gas.gas_of.download();
  const Eigen::Index count = static_cast<Eigen::Index>(gases.size());
  Eigen::MatrixXd a = Eigen::MatrixXd::Zero(right.size(), count), small = Eigen::MatrixXd::Identity(count, count);
  Eigen::VectorXd stiffness(count), rate = Eigen::VectorXd::Zero(count);
  for (Eigen::Index g = 0; g < count; ++g) stiffness[g] = state[static_cast<std::size_t>(g)].stiffness;
  for (std::size_t i = 0; i < gas_of.size(); ++i) {
    if (gas_of[i] < 0) continue;
    const Eigen::Vector3d own(gradient[i].x, gradient[i].y, gradient[i].z);
    if (fixed[i])
      rate[gas_of[i]] += own.dot(Eigen::Vector3d(x[i].x, x[i].y, x[i].z));
    else
      a.col(gas_of[i]).segment<3>(3 * static_cast<Eigen::Index>(i)) = own;
  }
  const Eigen::MatrixXd response = factor.solve(a);
  const Eigen::VectorXd before = rate + a.transpose() * v;
  small += a.transpose() * response * stiffness.asDiagonal();
  const Eigen::VectorXd push = stiffness.cwiseProduct(small.partialPivLu().solve(before));
  v -= response * push;
  right -= a * push;
  return v;
}

}  // namespace

template <class Real> void LinearSolve<Real>::multiply(const Rooms &state, const Stream<vec3> &x, Stream<vec3> &q)
{
  System<Real> &s = state.system.template of<Real>();
  // In single precision the rounding of stiffness times a common motion would act as a force.
  const bool differences = sizeof(Real) == 4 && state.options.paper.assembly == Assembly::gather;
  const int parts = state.backend->wide_workers() ? 1 : 3, terms = terms_as_operator(state) ? state.system.terms : 0;
  product_.resize(terms);
  CAMA_LAUNCH_REAL(Real, *state.backend, term_products, terms, s.term, x, product_);
  CAMA_LAUNCH_REAL(Real, *state.backend, bcsr_multiply, parts * state.mesh.cloth_vertices, parts, s.matrix.row,
                   s.matrix.column, s.matrix.block, state.mesh.fixed, differences ? s.mass : no_mass_,
                   differences && s.drag.size() ? s.drag : no_drag_, terms, state.system.term_incidence.row,
                   state.system.term_incidence.entry, s.term, product_, x, q);
  multiply_gas<Real>(*state.backend, state.system, x, 1, state.mesh.fixed, q);
}

template <class Real> void LinearSolve<Real>::extract_diagonal(const Rooms &state)
{
  Backend &b = *state.backend;
  System<Real> &s = state.system.template of<Real>();
  diagonal_.resize(state.mesh.cloth_vertices);
  CAMA_LAUNCH_REAL(Real, b, extract_diagonal, state.mesh.cloth_vertices, s.matrix.row, s.matrix.column, s.matrix.block,
                   diagonal_);
  if (terms_as_operator(state))
    CAMA_LAUNCH_REAL(Real, b, add_term_diagonal, state.mesh.cloth_vertices, state.system.term_incidence.row,
                     state.system.term_incidence.entry, s.term, diagonal_);
}

template <class Real> void LinearSolve<Real>::move_by_gravity(const Rooms &state, bool from_zero)
{
  Backend &b = *state.backend;
  System<Real> &s = state.system.template of<Real>();
  r_.resize(state.mesh.cloth_vertices);
  p_.resize(state.mesh.vertices);
  if (!from_zero) multiply(state, s.solution, q_);
  CAMA_LAUNCH_REAL(Real, b, falling_direction, state.mesh.vertices, state.mesh.cloth_vertices, state.time.step,
                   state.elements.gravity, state.mesh.fixed, s.right_side, from_zero ? no_product_ : q_, r_, p_);
  move_along(state);
}

template <class Real> void LinearSolve<Real>::move_by_net_force(const Rooms &state)
{
  Backend &b = *state.backend;
  System<Real> &s = state.system.template of<Real>();
  const int rows = state.mesh.cloth_vertices, vertices = state.mesh.vertices, teams = ceil_divide(rows, SUM_ROWS);
  sum_.resize(3 * teams);
  CAMA_LAUNCH_TEAMS(Real, b, sum_residuals, SUM_ROWS, teams, rows, state.mesh.fixed, s.right_side, q_, r_, sum_);
  CAMA_LAUNCH_TEAMS(Real, b, uniform_direction, SUM_ROWS, ceil_divide(vertices, SUM_ROWS), vertices, rows, teams, sum_,
                    state.mesh.fixed, p_);
  move_along(state);
}

template <class Real> void LinearSolve<Real>::move_along(const Rooms &state)
{
  Backend &b = *state.backend;
  const int rows = state.mesh.cloth_vertices, teams = ceil_divide(rows, SUM_ROWS);
  multiply(state, p_, q_);
  partial_.resize(2 * teams);
  CAMA_LAUNCH_TEAMS(Real, b, direction_products, SUM_ROWS, teams, rows, r_, p_, q_, partial_);
  CAMA_LAUNCH_TEAMS(Real, b, move_along, SUM_ROWS, teams, rows, teams, partial_, p_, q_,
                    state.system.template of<Real>().solution, r_);
}

template <class Real>
template <class S>
bool LinearSolve<Real>::conjugate_gradient(const Rooms &state, std::unique_ptr<ConjugateGradient<S>> &solver,
                                           Preconditioner preconditioner, bool uniform, bool from_zero, double slack)
{
  if (!solver) solver = std::make_unique<ConjugateGradient<S>>(*state.backend, preconditioner);
  const Matching matching = std::exchange(matching_, {});
  if (uniform && !matching.order.empty()) solver->template start_from<Real>(state, matching);
  q_.resize(state.mesh.cloth_vertices);
  if (solver->needs_diagonal(state)) extract_diagonal(state);
  solver->template prepare<Real>(state, diagonal_, [&] {
    if (uniform) move_by_gravity(state, from_zero);
  });
  const auto result = solver->template solve<Real>(
      state, uniform ? &r_ : nullptr, q_, [&](const Stream<vec3> &x, Stream<vec3> &q) { multiply(state, x, q); },
      slack);
  state.report.iterations = result.iterations;
  state.report.residual = result.residual;
  finite_ = std::isfinite(result.start);
  start_ = result.start;
  if (uniform && !result.broken && result.iterations > 0) move_by_net_force(state);
  return !result.broken;
}

template <class Real> void LinearSolve<Real>::save(State &state, Checkpoint &checkpoint)
{
  if (!matching_.order.empty())
    checkpoint.matching = matching_;
  else if (single_ || own_)
    checkpoint.matching = single_ ? single_->matching(state) : own_->matching(state);
}

template <class Real> void LinearSolve<Real>::restore(State &, const Checkpoint &checkpoint)
{
  matching_ = checkpoint.matching;
  if (single_) single_->forget();
  if (own_) own_->forget();
  if (fallback_) fallback_->forget();
}

template <class Real> void LinearSolve<Real>::iterative(const Rooms &state, bool from_zero, double slack)
{
  const Preconditioner wanted = state.options.preconditioner;
  const bool single = sizeof(Real) == 4 || state.options.precision == Precision::mixed,
             uniform = wanted == Preconditioner::schwarz;
  if (single ? conjugate_gradient(state, single_, wanted, uniform, from_zero, slack)
             : conjugate_gradient<Real>(state, own_, wanted, uniform, from_zero, slack))
    return;
  if (wanted != Preconditioner::block_jacobi &&
      conjugate_gradient<Real>(state, fallback_, Preconditioner::block_jacobi, false, false, slack))
    return;
  const std::string step = "step " + std::to_string(state.report.step);
  if (!finite_)
    throw SolverError(
        step + ": the linear system is not finite; check the material's stiffness and density and the time step");
  throw SolverError(
      step + ": the linear solve broke down after " + std::to_string(state.report.iterations) +
      " iterations (the matrix is not positive definite); check stiffness and density, or take a smaller time step");
}

template <class Real> void LinearSolve<Real>::direct(const Rooms &state)
{
  System<Real> &s = state.system.template of<Real>();
  const int rows = state.mesh.cloth_vertices;
  const auto row = s.matrix.row.download(), column = s.matrix.column.download();
  const auto block = s.matrix.block.download();
  const auto fixed = state.mesh.fixed.download();
  const auto right = s.right_side.download();
  auto x = s.solution.download();
  const auto component = [](const auto &v, int k) { return static_cast<double>(k == 0 ? v.x : k == 1 ? v.y : v.z); };
  std::vector<Eigen::Triplet<double>> entries;
  Eigen::VectorXd rhs = Eigen::VectorXd::Zero(3 * rows);
  const auto add = [&](int i, int j, int a, int c, double value) {
    if (i >= rows || fixed[i]) return;
    if (j >= rows || fixed[j])
      rhs[3 * i + a] -= value * component(x[j], c);
    else
      entries.emplace_back(3 * i + a, 3 * j + c, value);
  };
  for (int i = 0; i < rows; ++i) {
    for (int k = row[i]; k < row[i + 1]; ++k)
      for (int a = 0; a < 3; ++a)
        for (int c = 0; c < 3; ++c) add(i, column[k], a, c, component(block[k].row[a], c));
    for (int a = 0; a < 3; ++a) {
      rhs[3 * i + a] += component(right[i], a);
      if (fixed[i]) {
        entries.emplace_back(3 * i + a, 3 * i + a, 1.0);
        rhs[3 * i + a] = component(x[i], a);
      }
    }
  }
  if (terms_as_operator(state))
    for (const auto &t : s.term.download())
      for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4; ++j)
          for (int a = 0; a < 3; ++a)
            for (int c = 0; c < 3; ++c)
              if (t.node[i] >= 0 && t.node[j] >= 0)
                add(t.node[i], t.node[j], a, c,
                    static_cast<double>(t.weight[i]) * t.weight[j] *
                        (t.along * component(t.normal, a) * component(t.normal, c) + (a == c ? t.around : Real(0))));
  Eigen::SparseMatrix<double> matrix(3 * rows, 3 * rows);
  matrix.setFromTriplets(entries.begin(), entries.end());
  Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factor(matrix);
  if (factor.info() != Eigen::Success || !(factor.vectorD().minCoeff() > 0))
    throw SolverError(
        "step " + std::to_string(state.report.step) +
        ": the sparse factorisation failed (the matrix is not positive definite); check stiffness and density");
  const Eigen::VectorXd v = solve_with_gas<Real>(state.system, factor, fixed, x, rhs);
  for (int i = 0; i < rows; ++i)
    if (!fixed[i])
      x[i] = {static_cast<Real>(v[3 * i]), static_cast<Real>(v[3 * i + 1]), static_cast<Real>(v[3 * i + 2])};
  s.solution.assign(x);
  start_ = 0;
  state.report.iterations = 0;
  state.report.residual = (matrix * v - rhs).norm() / std::max(rhs.norm(), 1e-300);
}

template <class Real> void LinearSolve<Real>::run_on(const Rooms &state)
{
  Backend &b = *state.backend;
  System<Real> &s = state.system.template of<Real>();
  s.right_side.resize(state.mesh.cloth_vertices);
  s.solution.resize(state.mesh.vertices);
  if (state.time.predicted) return solve_change(state);
  CAMA_LAUNCH_REAL(Real, b, start_solution, state.mesh.vertices, state.mesh.base_velocity(state.time),
                   state.mesh.velocity_next, state.mesh.fixed, s.solution);
  CAMA_LAUNCH_REAL(Real, b, make_right_side, state.mesh.cloth_vertices, static_cast<Real>(state.time.implicit_step),
                   s.mass, state.mesh.base_velocity(state.time), state.mesh.velocity_next, state.mesh.fixed, s.force,
                   state.system.terms ? 1 : 0, state.system.term_incidence.row, state.system.term_incidence.entry,
                   s.term, s.hold.size() > 0 ? s.hold : no_product_, s.right_side);
  solve(state);
  CAMA_LAUNCH_REAL(Real, b, store_velocity, state.mesh.cloth_vertices, state.mesh.fixed, s.solution,
                   state.mesh.velocity_next);
}

template <class Real> void LinearSolve<Real>::find_residual(const Rooms &state)
{
  Backend &b = *state.backend;
  System<Real> &s = state.system.template of<Real>();
  const Stream<dvec3> &v = state.mesh.velocity_next;
  const int contacts = state.system.terms - state.elements.stitches;
  product_.resize(contacts);
  CAMA_LAUNCH_REAL(Real, b, friction_impulses, contacts, s.term, s.hold, v, product_);
  CAMA_LAUNCH_REAL(Real, b, newton_right_side, state.mesh.cloth_vertices, static_cast<Real>(state.time.implicit_step),
                   s.mass, state.mesh.fixed, state.mesh.base_velocity(state.time), v, s.force,
                   state.system.terms ? 1 : 0, contacts, state.system.term_incidence.row,
                   state.system.term_incidence.entry, s.term, product_, s.right_side);
}

template <class Real> void LinearSolve<Real>::solve_change(const Rooms &state)
{
  find_residual(state);
  solve_from_zero(state);
  CAMA_LAUNCH_REAL(Real, *state.backend, add_velocity, state.mesh.cloth_vertices, state.mesh.fixed,
                   state.system.template of<Real>().solution, state.mesh.velocity_next);
}

template <class Real> void LinearSolve<Real>::solve(const Rooms &state)
{
  if (state.options.solver == LinearSolver::direct)
    direct(state);
  else
    iterative(state, false, 1);
}

template <class Real> void LinearSolve<Real>::solve_from_zero(const Rooms &state, double slack)
{
  state.system.template of<Real>().solution.fill_zero();
  if (state.options.solver == LinearSolver::direct)
    direct(state);
  else
    iterative(state, true, slack);
}

template class LinearSolve<double>;
template class LinearSolve<float>;

}  // namespace cama
