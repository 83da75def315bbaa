// SPDX-License-Identifier: Apache-2.0
// Obstacles as rigid bodies meet them: on the host, with their own tree of faces.
#pragma once
#include <array>
#include <vector>

#include "cama/scene.hpp"

namespace cama {

/// The surface of an obstacle: points within `radius` of its vertices, edges and faces, or a half space. A mesh that is
/// that of a sphere is one vertex with a radius.
struct ContactShape {
  explicit ContactShape(const Obstacle &obstacle);

  double radius = 0;  // m
  int outward =
      0;  // 1: the normals of the faces of a closed mesh point outwards; -1: inwards; 0: it is open, or no mesh
  bool plane = false;  // vertices: three points, whose normal (b - a) x (c - a) points out of the solid
  std::vector<dvec3> rest;  // [vertices] before any motion, m
  std::vector<Triangle> face;  // a point (c, c, c), a segment (a, b, b), or a triangle
  std::vector<char> corner;  // [vertices] 0: all faces around it lie in a plane, so that others touch first
  std::vector<Triangle> across;  // [faces] the vertex beyond each edge k, k + 1; -1: none
  std::vector<Triangle> face_edge;  // [faces] number of each edge k, k + 1; -1: flat, so that others touch first
  std::vector<std::array<int, 2>> edge, wing;  // [edges] that can touch: ends, and the vertices beside; -1: none
  std::vector<int> ring_row, ring;  // the neighbours of each vertex

private:
  void join_edges();
};

/// Boxes of the faces of a shape that moves, as a binary tree.
class ContactTree {
public:
  struct Box {
    dvec3 low, high;
  };

  explicit ContactTree(const ContactShape &shape);
  /// The faces' boxes while the vertices go straight from `start` to `end`.
  void fit(const ContactShape &shape, const std::vector<dvec3> &start, const std::vector<dvec3> &end);
  const Box &box() const { return box_[0]; }
  /// Calls found(face, face of the other) for faces whose boxes come within `margin`.
  template <class F> void pairs(const ContactTree &other, double margin, F &&found) const
  {
    visit(0, other, 0, margin, found);
  }

private:
  struct Node {
    int left = -1, right = -1, face = -1;
  };
  int build(const std::vector<dvec3> &center, std::vector<int> &order, int first, int last);
  template <class F> void visit(int i, const ContactTree &other, int j, double margin, F &&found) const
  {
    const Node &a = node_[static_cast<std::size_t>(i)], &b = other.node_[static_cast<std::size_t>(j)];
    const Box &own = box_[static_cast<std::size_t>(i)], &its = other.box_[static_cast<std::size_t>(j)];
    if (!near(own, its, margin)) return;
    if (a.face >= 0 && b.face >= 0) return found(a.face, b.face);
    if (b.face >= 0 || (a.face < 0 && size(own) >= size(its))) {
      visit(a.left, other, j, margin, found);
      visit(a.right, other, j, margin, found);
    } else {
      visit(i, other, b.left, margin, found);
      visit(i, other, b.right, margin, found);
    }
  }
  static double size(const Box &b) { return b.high.x - b.low.x + (b.high.y - b.low.y) + (b.high.z - b.low.z); }

public:
  static bool near(const Box &a, const Box &b, double margin)
  {
    return a.low.x - margin <= b.high.x && b.low.x - margin <= a.high.x && a.low.y - margin <= b.high.y &&
           b.low.y - margin <= a.high.y && a.low.z - margin <= b.high.z && b.low.z - margin <= a.high.z;
  }

private:
  std::vector<Node> node_;  // parents before children
  std::vector<Box> box_;
};

}  // namespace cama
