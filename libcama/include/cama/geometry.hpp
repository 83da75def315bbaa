// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <utility>
#include <vector>

#include "cama/mesh.hpp"

/// Geometry queries on the host, with the element functions that the kernels use.
namespace cama {

using Quad = std::array<dvec3, 4>;   ///< vertex then face, or two edges

struct Ccd {
  bool hit = false;
  double time = 1;  ///< of impact, in [0, 1]
};
/// Continuous collision detection for straight motions from start to end, by additive CCD with a directional
/// certificate: there are no false negatives, and `time` is never later than the true time. minimum_distance: m; at 0,
/// pairs that pass nearer than double can resolve are decided in double-double.
Ccd vertex_face_ccd(const Quad &start, const Quad &end, double minimum_distance = 0);
Ccd edge_edge_ccd(const Quad &start, const Quad &end, double minimum_distance = 0);
/// The paper's test: the first root of the coplanarity cubic with an inside test, under a forward error bound. There
/// are no false negatives; a pair that comes within that bound (about 1e-14 of its size) counts as hit. The time is
/// that of the root, so it may be late by rounding.
Ccd vertex_face_ccd_cubic(const Quad &start, const Quad &end);
Ccd edge_edge_ccd_cubic(const Quad &start, const Quad &end);

struct Distance {
  double distance = 0;  ///< m
  std::array<double, 4> weight{};  ///< signed: sum_k w_k x_k is the difference vector
};
Distance vertex_face_distance(const Quad &x);
Distance edge_edge_distance(const Quad &x);

/// An edge, as two vertices, and a face that intersect by exact predicates; edges that share a vertex with the face are
/// excluded.
struct Intersection {
  std::array<int, 2> edge;
  int face;
};
/// All intersections, ordered by edge, then face. Vertices from first_obstacle_vertex on belong to obstacles, whose
/// pairs with each other are left out; -1: none do.
std::vector<Intersection> intersections(const std::vector<dvec3> &position, const std::vector<Triangle> &face,
                                        int first_obstacle_vertex = -1);

}  // namespace cama
