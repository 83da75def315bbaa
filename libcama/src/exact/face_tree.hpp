// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <algorithm>
#include <vector>

#include "cama/mesh.hpp"
#include "device/kernels.hpp"

namespace cama {

/// Faces under an implicit tree, for queries by box.
struct FaceTree {
  std::vector<dvec3> bounds{2};
  std::vector<kernels::box> vertex_boxes, node;
  std::vector<int> order;
  int leaves = 0;

  FaceTree(const std::vector<dvec3> &position, const std::vector<Triangle> &face)
      : leaves(static_cast<int>(face.size()))
  {
    using namespace kernels;
    const int vertices = static_cast<int>(position.size());
    position_bounds(1, vertices, position.data(), position.data(), bounds.data());
    vertex_boxes.resize(position.size());
    for (std::size_t v = 0; v < position.size(); ++v)
      vertex_boxes[v] = swept_box(position[v], position[v], 0, bounds[0]);
    std::vector<box> boxes(face.size());
    for (std::size_t f = 0; f < face.size(); ++f)
      boxes[f] = box_union(box_union(vertex_boxes[face[f][0]], vertex_boxes[face[f][1]]), vertex_boxes[face[f][2]]);
    std::vector<key64> key(face.size());
    order.resize(face.size());
    for (int f = 0; f < leaves; ++f) {
      key[f] = morton_code(boxes[f], bounds.data(), bounds[0]);
      order[f] = f;
    }
    std::sort(order.begin(), order.end(), [&](int a, int b) { return key[a] != key[b] ? key[a] < key[b] : a < b; });
    node.resize(tree_size(leaves));
    tree_leaves(leaves, order.data(), boxes.data(), node.data());
    const int root = tree_root_level(leaves);
    if (root > 0) tree_levels(1, leaves, root, root, node.data());
  }

  /// The box of one point, inflated by `radius`.
  kernels::box around(const dvec3 &x, double radius) const { return kernels::swept_box(x, x, radius, bounds[0]); }

  template <class Visit> void visit(const kernels::box &b, Visit &&found) const
  {
    using namespace kernels;
    for (tree_node at = tree_find(tree_root(leaves), leaves, node.data(), b); at.level == 0;
         at = tree_find(tree_next(at), leaves, node.data(), b))
      found(order[at.index]);
  }
};

}  // namespace cama
