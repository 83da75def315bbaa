// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <utility>
#include <vector>

#include "cama/mesh.hpp"

/// Geometry queries on the host, the same element functions that the kernels use.
namespace cama {

using Quad = std::array<dvec3, 4>;   ///< vertex then face, or two edges

struct Ccd {
  bool hit = false;
  double time = 1;
};          ///< time of impact in [0, 1]
/// Continuous collision over straight motions start -> end, by additive CCD with a directional certificate: no false
/// negative; `time` is never later than the true one. minimum_distance: m; at 0, pairs that pass nearer than double can
/// tell are decided in double-double.
Ccd vertex_face_ccd(const Quad &start, const Quad &end, double minimum_distance = 0);
Ccd edge_edge_ccd(const Quad &start, const Quad &end, double minimum_distance = 0);
/// The paper's: first root of the coplanarity cubic with an inside test, under a forward error bound: no false
/// negative; a pair that comes within that bound (about 1e-14 of its size) counts as hit. The time is the root's, so it
/// may be late by rounding.
Ccd vertex_face_ccd_cubic(const Quad &start, const Quad &end);
Ccd edge_edge_ccd_cubic(const Quad &start, const Quad &end);

struct Distance {
  double distance = 0;
  std::array<double, 4> weight{};
};  ///< signed weights: sum_k w_k x_k is the difference vector
Distance vertex_face_distance(const Quad &x);
Distance edge_edge_distance(const Quad &x);

/// Pairs (edge as vertex pair, face index) that intersect, by exact predicates; edges that share a vertex with the face
/// excluded.
struct Intersection {
  std::array<int, 2> edge;
  int face;
};
/// Vertices from first_obstacle_vertex on belong to obstacles, whose pairs among themselves are left out; -1: none.
/// Ordered by edge, then face.
std::vector<Intersection> intersections(const std::vector<dvec3> &position, const std::vector<Triangle> &face,
                                        int first_obstacle_vertex = -1);

}  // namespace cama
