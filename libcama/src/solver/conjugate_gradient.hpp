// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>
#include <memory>

#include "solver/schwarz.hpp"

namespace cama {

/// q = A x in the precision of the forces, on cloth vertices.
template <class Real>
using Product = std::function<void(const Stream<typename Types<Real>::vec3> &x, Stream<typename Types<Real>::vec3> &q)>;

/// Solves A v = b by the conjugate gradient method with one reduction an iteration (Chronopoulos and Gear 1989), in
/// precision S. The matrix and the residual have the precision of the forces, so that a solve in single precision is
/// refined to any tolerance.
template <class S> class ConjugateGradient {
public:
  ConjugateGradient(Backend &backend, Preconditioner kind);

  /// With Schwarz: the blocks of the last solve, or nothing if they are outdated.
  Matching matching(const SolverRooms &state) const { return schwarz_ ? schwarz_->matching(state) : Matching{}; }
  /// Makes it as new: nothing of earlier solves is known. It keeps its memory.
  void forget();
  /// Takes over blocks before the first solve. matching: checked.
  template <class Real> void start_from(const SolverRooms &state, const Matching &matching);

  /// Whether the next `prepare` reads the diagonal.
  bool needs_diagonal(const SolverRooms &state) const { return !schwarz_ || outdated(state); }
  /// Sets new values of the matrix. diagonal: of the matrix, terms included; it is overwritten. beside: work that reads
  /// the state's matrix, and may run at the same time.
  template <class Real>
  void prepare(const SolverRooms &state, Stream<typename Types<Real>::mat3> &diagonal,
               const std::function<void()> &beside);

  /// start: r' P r at the start. broken: not positive definite, or not finite.
  struct Result {
    int iterations = 0;
    double residual = 0, start = 0;
    bool broken = false;
  };
  /// Improves the solution until sqrt(r' P r) of the true residual meets the tolerance times `slack`. residual: that of
  /// the start, if known. multiply(x, q): q = A x; q: scratch.
  template <class Real>
  Result solve(const SolverRooms &state, const Stream<typename Types<Real>::vec3> *residual,
               Stream<typename Types<Real>::vec3> &q, const Product<Real> &multiply, double slack);

private:
  using vec3 = typename Types<S>::vec3;
  using vec4 = typename Types<S>::vec4;
  const RowOrder &rows() const { return schwarz_ ? schwarz_->rows() : rows_; }
  const Stream<vec4> &preconditioned() const { return schwarz_ ? total_ : z_; }
  /// Numbers from column to column of r, w, p, s, x and P; 0 with Schwarz, which stores rows.
  int component_stride() const;
  /// Rows of a block of P.
  int block_rows() const { return kind_ == Preconditioner::block_jacobi ? 3 : 1; }
  /// Whether the rows, or the blocks, are to be found anew.
  bool outdated(const SolverRooms &state) const;
  /// r = right - q, or r = right if `plain`, and what `multiply` needs of it: residuals of coarse nodes, or z = P r.
  template <class Real>
  void gather(const SolverRooms &state, int plain, const Stream<typename Types<Real>::vec3> &right,
              const Stream<typename Types<Real>::vec3> &q);
  /// z = P r with the coarse corrections, w = A z, r'z and z'w. at: place of the scalars.
  void multiply(const SolverRooms &state, int at);
  void advance(const SolverRooms &state, int from, int to);
  /// Adds the stiffness of enclosed gas to w = A z and to z'w.
  void multiply_gas(const SolverRooms &state, int at);
  /// Partial sums of r'z and z'w.
  int partials(const SolverRooms &state) const { return ceil_divide(rows().size, TEAM_ROWS) + gas_parts(state); }
  /// The derivative of the volumes in this precision.
  const Stream<vec3> &gas_gradient(const SolverRooms &state) const;

  const Preconditioner kind_;
  std::unique_ptr<Schwarz<S>> schwarz_;  // with the Schwarz preconditioner
  RowOrder rows_;  // with other preconditioners
  SlicedMatrix<S> matrix_;
  Stream<vec4> inverse_;  // P of other preconditioners
  int pin_changes_ = -1;  // mesh.pin_changes when the pattern was made; -1: there is none
  int expected_[2] = {0, 0};  // iterations of the first solve of a step, and of the others
  int step_ = -1;  // of the last solve
  Stream<vec4> r_, z_, total_, w_, p_, s_, x_, product_;  // r_, z_: followed by the nodes of coarse levels
  Stream<vec3> gradient_;  // of volumes, where the forces have another precision
  Stream<double> partial_, scalar_;  // scalars twice: of the last iteration and of this one
};

}  // namespace cama
