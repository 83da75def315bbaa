// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "model/topology.hpp"

namespace cama {

/// Disjoint sets over 0 .. n - 1; the root is the smallest member.
class Sets {
public:
  explicit Sets(int n);
  int root(int i) const;
  void join(int a, int b);

private:
  mutable std::vector<int> parent_;
};

/// A list of lists: row i has values[start[i]] .. values[start[i + 1] - 1].
struct Rows {
  std::vector<int> start, value;
  struct Range {
    const int *first, *last;
    const int *begin() const { return first; }
    const int *end() const { return last; }
  };
  Range operator[](int i) const { return {value.data() + start[i], value.data() + start[i + 1]}; }
};

/// Adjacency of vertices, edges and faces, numbered over all objects.
struct Surface {
  explicit Surface(const Topology &topology);
  int edge_of(int a, int b) const;                  ///< -1: no such edge
  std::vector<int> faces_of_edge(int edge) const;
  dvec3 normal(const std::vector<dvec3> &x, int face) const;   ///< not normalised

  const Topology &topology;
  Rows faces, edges;                                ///< of each vertex
  std::vector<int> outward;  ///< [faces] 1 or -1: the normal of a closed obstacle points out or in; 0: not closed
};

}  // namespace cama
