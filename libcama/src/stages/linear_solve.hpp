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
template <class Real>
class LinearSolve final
    : public StageOn<const Options, StepReport, const Clock, MeshState, const ElementState, SystemState> {
public:
  explicit LinearSolve(Backend &backend);
  std::string_view name() const override { return "linear solve"; }
  void run_on(const Rooms &state) override;
  void save(State &state, Checkpoint &checkpoint) override;
  void restore(State &state, const Checkpoint &checkpoint) override;
  /// Improves System::solution for System::right_side; report.iterations and residual are its own.
  void solve(const Rooms &state);

  /// q = A x on the free rows, terms included.
  void multiply(const Rooms &state, const Stream<typename Types<Real>::vec3> &x, Stream<typename Types<Real>::vec3> &q);

private:
  using vec3 = typename Types<Real>::vec3;
  void extract_diagonal(const Rooms &state);
  /// Moves all free vertices by the one vector that lowers the energy of the error most: along gravity before the
  /// solve, so that free fall is exact; along the net force that is left over after it, so that momentum is kept beyond
  /// the tolerance. Leaves the residual in r_.
  void move_uniformly(const Rooms &state, bool falling);
  void iterative(const Rooms &state);
  /// False if it broke down. uniform: with `move_uniformly`.
  template <class S>
  bool conjugate_gradient(const Rooms &state, std::unique_ptr<ConjugateGradient<S>> &solver,
                          Preconditioner preconditioner, bool uniform);
  void direct(const Rooms &state);
  bool terms_as_operator(const Rooms &state) const
  {
    return state.options.paper.assembly == Assembly::gather && state.system.terms > 0;
  }
  void dot(const Rooms &state, const Stream<vec3> &a, const Stream<vec3> &b);

  Stream<typename Types<Real>::mat3> diagonal_;
  Stream<vec3> r_, p_, q_, product_;
  Stream<double> partial_, reduced_, sum_, scalar_;
  const Stream<Real> no_mass_;
  bool finite_ = true;  // the last system
  std::unique_ptr<ConjugateGradient<float>> single_;  // made when first used
  std::unique_ptr<ConjugateGradient<Real>> own_, fallback_;
  Matching matching_;  // of a checkpoint, for the next solver that is made
};

extern template class LinearSolve<double>;
extern template class LinearSolve<float>;

}  // namespace cama
