// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>

#include "run/pipeline.hpp"
#include "solver/conjugate_gradient.hpp"

namespace cama {

/// A v = b of Equation 1 by preconditioned conjugate gradient, or by a sparse direct factorisation (the reference).
/// Where the preconditioner is not positive definite in its precision, the blocks of the diagonal take its place.
/// Starts from the current velocities; prescribed degrees of freedom are eliminated; stops by sqrt(r' P r) relative to
/// its start, or to that of the forces without penalties where it is smaller.
template <class Real> class LinearSolve final : public Stage {
public:
  explicit LinearSolve(Backend &backend);
  std::string_view name() const override { return "linear solve"; }
  void run(State &state) override;
  void save(State &state, Checkpoint &checkpoint) override;
  void restore(State &state, const Checkpoint &checkpoint) override;
  /// Improves System::solution for System::right_side; report.iterations and residual are its own.
  void solve(State &state);

  /// q = A x on the free rows, terms included.
  void multiply(State &state, const Stream<typename Types<Real>::vec3> &x, Stream<typename Types<Real>::vec3> &q);

private:
  using vec3 = typename Types<Real>::vec3;
  void extract_diagonal(State &state);
  /// Moves all free vertices uniform by what lowers the energy of the error most: along gravity before the solve, so
  /// that free fall is exact; along the net force that is left over after it, so that momentum is kept beyond the
  /// tolerance. Leaves the residual in r_.
  void move_uniformly(State &state, bool falling);
  void iterative(State &state);
  /// False if it broke down. uniform: with `move_uniformly`.
  template <class S>
  bool conjugate_gradient(State &state, std::unique_ptr<ConjugateGradient<S>> &solver, Preconditioner preconditioner,
                          bool uniform);
  void direct(State &state);
  bool terms_as_operator(const State &state) const
  {
    return state.options.assembly == Assembly::gather && state.terms > 0;
  }
  void dot(State &state, const Stream<vec3> &a, const Stream<vec3> &b);

  Stream<typename Types<Real>::mat3> diagonal_;
  Stream<vec3> r_, p_, q_, product_;
  Stream<double> partial_, reduced_, sum_, scalar_;
  const Stream<Real> no_mass_;
  bool finite_ = true;                                     // the last system
  std::unique_ptr<ConjugateGradient<float>> single_;       // made when first used
  std::unique_ptr<ConjugateGradient<Real>> own_, fallback_;
  Matching matching_;                                      // of a checkpoint, for the next solver that is made
};

extern template class LinearSolve<double>;
extern template class LinearSolve<float>;

}  // namespace cama
