// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "cama/checkpoint.hpp"
#include "solver/sliced_matrix.hpp"

namespace cama {

/// Rows of the linear system in blocks of strongly coupled neighbours, and blocks in blocks, of free vertices only, by
/// deterministic handshake matching on |A_ij| / sqrt(tr A_ii tr A_jj), terms included.
class Aggregates {
public:
  explicit Aggregates(Backend &backend);

  /// diagonal: of the matrix, terms included.
  template <class Real> void build(const SolverRooms &state, const Stream<typename Types<Real>::mat3> &diagonal);

  /// Takes over the blocks of a checkpoint; false if they are not those of the present free vertices, or have too many
  /// levels.
  bool adopt(const SolverRooms &state, const Matching &matching);

  int levels() const { return static_cast<int>(level_.size()); }

  /// Level 0: rows in blocks; level l: blocks of level l - 1 in blocks.
  struct Level {
    explicit Level(Backend &b) : parent(b), start(b) {}
    int nodes = 0, blocks = 0;
    Stream<int> parent;  // [nodes] its block
    Stream<int> start;  // [blocks + 1] first node
  };
  const Level &level(int l) const { return level_[static_cast<std::size_t>(l)]; }

  RowOrder rows;  // ordered so that the rows of each block are neighbours

private:
  struct Graph {
    explicit Graph(Backend &b) : row(b), column(b), weight(b) {}
    int nodes = 0;
    Stream<int> row, column;
    Stream<float> weight;
  };
  /// Sorts the n entries in key_, entry_ and weight_, and adds up those with equal keys.
  void merge(Backend &b, int n, int nodes, Graph &graph);
  /// Joins neighbours until no two fit into BLOCK_ROWS; cluster_: [nodes] the cluster of each node of graph_. Returns
  /// the number of clusters.
  int match(Backend &b);
  /// Renumbers nodes so that those of each block are neighbours. parents, count: clusters of each level's nodes.
  void arrange(Backend &b, std::vector<Stream<int>> &parents, const std::vector<int> &count);

  std::vector<Level> level_;
  Graph graph_, merged_;
  Stream<key64> key_, merged_key_;
  Stream<int> entry_, head_, place_, size_, joined_size_, mate_, proposal_, parent_, cluster_;
  Stream<float> strength_, weight_;
};

}  // namespace cama
