// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>
#include <vector>

#include "solver/aggregates.hpp"

namespace cama {

/// The blocks of the multilevel additive Schwarz preconditioner, in precision S.
template <class S> class Schwarz {
public:
  explicit Schwarz(Backend &backend);

  /// Whether contacts or pins have changed so much, or solves have become so long, that a new matching is needed.
  bool outdated(const SolverRooms &state) const;
  /// Makes new blocks and a new order of rows(). diagonal: of the matrix, terms included.
  template <class Real> void match(const SolverRooms &state, const Stream<typename Types<Real>::mat3> &diagonal);
  /// The blocks, or nothing if they are outdated.
  Matching matching(const SolverRooms &state) const;
  /// Forgets blocks and solves, but keeps its memory.
  void forget();
  /// Takes over the blocks of a checkpoint; none if they are not those of the present rows.
  template <class Real> void adopt(const SolverRooms &state, const Matching &matching);
  /// Factors the blocks from new values. matrix: on the same rows. beside: work that may run at the same time; it reads
  /// the state's matrix and neither `matrix` nor anything of this.
  template <class Real>
  void factor(const SolverRooms &state, const SlicedMatrix<S> &matrix, const std::function<void()> &beside);

  /// Called after every solve of a step.
  void note(int step, int iterations);

  const RowOrder &rows() const { return aggregates_.rows; }
  int levels() const { return aggregates_.levels(); }
  int fine_blocks() const { return aggregates_.level(0).blocks; }
  const Stream<int> &block_of_row() const { return aggregates_.level(0).parent; }
  /// [fine blocks] their blocks on the next level, if there is one.
  const Stream<int> &parents() const { return aggregates_.level(levels() > 1 ? 1 : 0).parent; }
  int blocks() const { return blocks_; }  ///< of all levels
  int nodes() const { return nodes_; }  ///< of all levels, rows first
  const Stream<int> &block_start() const { return block_start_; }  ///< [blocks + 1] first node
  /// [groups + 1] first fine block of each group that a team restricts, the blocks of a block of the next level.
  const Stream<int> &group_start() const { return levels() > 1 ? aggregates_.level(1).start : group_start_; }
  const Stream<int> &factors() const { return factor_; }
  const Stream<S> &weights() const { return weight_; }

private:
  struct Level {
    explicit Level(Backend &b) : row(b), column(b), source_start(b), source(b), ancestor(b), value(b), diagonal(b) {}
    Stream<int> row, column;  // of the coarse matrix
    Stream<int> source_start, source;  // entries of the finer matrix that add up to an entry
    Stream<int> ancestor;  // [rows] their nodes on this level
    Stream<double> value;  // [9 entries]
    Stream<double> diagonal;  // [6 nodes] of the terms
  };

  /// Makes patterns and tables of the levels.
  template <class Real> void make_levels(const SolverRooms &state);
  void make_level(Backend &b, int l, const Stream<int> &row, const Stream<int> &column, int rows, int columns,
                  const Stream<int> &parent);
  void make_tables(Backend &b);
  /// Values of the coarse levels, and the diagonals of terms there.
  template <class Real> void find_coarse(const SolverRooms &state, const SlicedMatrix<S> &matrix);

  Aggregates aggregates_;
  /// The longest solve of a step.
  struct Solve {
    int step = -1, iterations = 0;
  };
  Solve last_, before_;  // of the last step and of the one before
  int first_ = 0;  // iterations of the longest solve in the step of the matching
  int terms_ = -1, matched_ = 0, pin_changes_ = 0, blocks_ = 0, nodes_ = 0;
  std::vector<Level> level_;  // 0 is unused: the finest matrix is a SlicedMatrix
  Stream<int> factor_, block_start_, group_start_, vertex_parent_;
  Stream<S> weight_;
  Stream<double> sum_, other_sum_;
};

}  // namespace cama
