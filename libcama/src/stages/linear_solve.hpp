// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>

#include "run/pipeline.hpp"
#include "solver/conjugate_gradient.hpp"

namespace cama {

/// q += factor k a (a . x) for each enclosed gas, where vertices are not fixed; an empty `fixed`: on all.
template <class Real>
void multiply_gas(Backend &backend, SystemState &system, const Stream<typename Types<Real>::vec3> &x, double factor,
                  const Stream<int> &fixed, Stream<typename Types<Real>::vec3> &q);

/// Solves A v = b of Equation 1 by the preconditioned conjugate gradient method, or by a sparse direct factorisation
/// (the reference). If the preconditioner is not positive definite in its precision, block Jacobi replaces it. The
/// solve starts from the current velocities, with prescribed degrees of freedom eliminated, and stops by sqrt(r' P r)
/// relative to its start, or to that of the forces without penalties if it is smaller.
template <class Real>
class LinearSolve final
    : public StageOn<const Options, StepReport, const Clock, MeshState, const ElementState, SystemState> {
public:
  explicit LinearSolve(Backend &backend);
  std::string_view name() const override { return "linear solve"; }
  void run_on(const Rooms &state) override;
  void save(State &state, Checkpoint &checkpoint) override;
  void restore(State &state, const Checkpoint &checkpoint) override;
  /// Sets System::solution, beginning with zero, for System::right_side, to the tolerance times `slack`; sets
  /// report.iterations and residual to those of this solve.
  void solve_from_zero(const Rooms &state, double slack = 1);
  /// r' P r before the last solve, about twice the energy of the change that it has found, J; 0 of a direct one.
  double start() const { return start_; }

  /// Sets System::right_side to the negative residual of Newton's method at velocity_next.
  void find_residual(const Rooms &state);

  /// q = A x on the free rows, terms included.
  void multiply(const Rooms &state, const Stream<typename Types<Real>::vec3> &x, Stream<typename Types<Real>::vec3> &q);

private:
  using vec3 = typename Types<Real>::vec3;
  /// Solves for the change of the predicted velocities.
  void solve_change(const Rooms &state);
  /// The same, beginning with what System::solution is, to the tolerance.
  void solve(const Rooms &state);
  void extract_diagonal(const Rooms &state);
  /// These add one common vector to all free vertices, such that the energy of the error decreases most, and leave the
  /// residual in r_. Before the solve it is along gravity, so that free fall is exact. from_zero: the solution is zero.
  void move_by_gravity(const Rooms &state, bool from_zero);
  /// After the solve it is along the remaining net force, so that momentum is conserved beyond the tolerance. q_: the
  /// product with the solution.
  void move_by_net_force(const Rooms &state);
  /// Adds the multiple of p_.
  void move_along(const Rooms &state);
  void iterative(const Rooms &state, bool from_zero, double slack);
  /// Returns false if it broke down. uniform: with common vectors before and after it.
  template <class S>
  bool conjugate_gradient(const Rooms &state, std::unique_ptr<ConjugateGradient<S>> &solver,
                          Preconditioner preconditioner, bool uniform, bool from_zero, double slack);
  void direct(const Rooms &state);
  bool terms_as_operator(const Rooms &state) const
  {
    return state.options.paper.assembly == Assembly::gather && state.system.terms > 0;
  }

  Stream<typename Types<Real>::mat3> diagonal_;
  Stream<vec3> r_, p_, q_, product_;
  Stream<double> partial_, sum_;
  const Stream<Real> no_mass_;
  const Stream<typename Types<Real>::mat3> no_drag_;
  const Stream<vec3> no_product_;
  bool finite_ = true;  // whether the last system was finite
  double start_ = 0;
  std::unique_ptr<ConjugateGradient<float>> single_;  // made when first used
  std::unique_ptr<ConjugateGradient<Real>> own_, fallback_;
  Matching matching_;  // of a checkpoint, for the next solver
};

extern template class LinearSolve<double>;
extern template class LinearSolve<float>;

}  // namespace cama
