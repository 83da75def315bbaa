// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>
#include <vector>

#include "solver/aggregates.hpp"

namespace cama {

/// q = A x in the precision of the forces, on cloth vertices.
template <class Real>
using Product = std::function<void(const Stream<typename Types<Real>::vec3> &x, Stream<typename Types<Real>::vec3> &q)>;

/// A v = b by conjugate gradient with the multilevel additive Schwarz preconditioner, in precision S; the matrix and the residual come in
/// the precision of the forces, so that a solve in single precision is refined to any tolerance.
template <class S> class SchwarzSolver {
public:
  explicit SchwarzSolver(Backend &backend);

  /// New values of the matrix, with new blocks where contacts have changed much. diagonal: of the matrix, terms included.
  template <class Real> void prepare(State &state, const Stream<typename Types<Real>::mat3> &diagonal);

  struct Result { int iterations = 0; double residual = 0; bool broken = false; };
  /// Improves the solution until sqrt(r' P r) of the true residual has met the tolerance. multiply(x, q): q = A x; q: scratch.
  template <class Real>
  Result solve(State &state, Stream<typename Types<Real>::vec3> &q, const Product<Real> &multiply);

private:
  using vec3 = typename Types<S>::vec3;
  struct Level {
    explicit Level(Backend &b) : row(b), column(b), source_start(b), source(b), ancestor(b), value(b), diagonal(b) {}
    Stream<int> row, column;            // of the coarse matrix
    Stream<int> source_start, source;   // entries of the finer matrix that make an entry
    Stream<int> ancestor;               // [rows] node of this level
    Stream<double> value;               // [9 entries]
    Stream<double> diagonal;            // [6 nodes] of the terms
  };

  bool outdated(const State &state) const;
  template <class Real> void make_pattern(State &state);
  void make_slices(State &state, const Stream<int> &row, const Stream<int> &column);
  void make_level(Backend &b, int l, const Stream<int> &row, const Stream<int> &column, int rows, int columns, const Stream<int> &parent);
  void make_tables(Backend &b);
  void weigh_terms(State &state);
  /// z = P r, w = A z, r'z and z'w. at: place of the scalars.
  void apply(State &state, int at);

  Aggregates aggregates_;
  int terms_ = -1, matched_ = 0, coarse_blocks_ = 0, coarse_nodes_ = 0, expected_ = 0;
  std::vector<Level> level_;            // 0 is unused: the finest matrix is in slices
  Stream<int> slice_width_, slice_start_, slice_column_, slice_source_;
  Stream<S> slice_value_;
  Stream<kernels::element_nodes> term_nodes_;
  Stream<S> term_value_;                // [9 terms]
  Stream<int> factor_, coarse_factor_;
  Stream<S> weight_, coarse_weight_;
  Stream<int> block_start_, first_, last_, parent_, path_;   // of all coarse levels, one behind the other
  Stream<int> vertex_parent_;
  Stream<double> sum_, other_sum_;
  Stream<vec3> r_, z_, total_, w_, p_, s_, x_, product_, coarse_r_, coarse_z_;
  Stream<double> partial_, scalar_;     // scalars twice: of the last iteration and of this one
};

}  // namespace cama
