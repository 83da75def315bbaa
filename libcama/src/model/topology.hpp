// SPDX-License-Identifier: Apache-2.0
// What a scene's meshes become before they are copied to the device: elements with rest state, masses, contact
// properties.
#pragma once
#include <array>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "cama/scene.hpp"
#include "device/kernels.hpp"

namespace cama {

/// A contact thickness is at most this share of the shortest edge around a vertex: neighbours at rest are never in
/// contact.
inline constexpr double max_thickness_per_edge = 0.45;

struct RestTriangle {
  std::array<int, 3> node;
  int material;
  std::array<double, 4> d;   ///< inverse of the rest edge matrix, row major, 1/m
  double area;               ///< m^2
};

struct RestHinge {
  std::array<int, 4> node;
  int material;
  double rest_angle, length, area;
  std::array<double, 2> direction;   ///< of the rest edge in each face: 0, 1, 2 = 0, 45, 90 degrees
  std::array<int, 2> triangle;       ///< of node 2 and of node 3
};

/// The whole scene in one numbering: vertices and faces of all cloths, then of all obstacles.
struct Topology {
  int cloth_vertices = 0;
  std::vector<dvec3> position, rest_position;      ///< at the start; obstacles before their motion
  std::vector<Triangle> face;                      ///< of meshes and boxes
  std::vector<Triangle> exact_face;                ///< of spheres (c, c, c), capsules (a, b, b) and planes
  std::vector<std::array<int, 2>> edge;
  std::vector<RestTriangle> triangle;
  std::vector<RestHinge> hinge;
  std::vector<double> mass;                        ///< [cloth vertices], kg
  std::vector<double> area;                        ///< [vertices], a third of the area around, m^2
  std::vector<double> shortest_edge;               ///< [vertices], m
  std::vector<double> radius;                      ///< [vertices] of exact obstacles, m
  std::vector<ObstacleShape> shape;                      ///< [vertices]
  std::vector<int> object;                         ///< [vertices] cloth index, or cloths + obstacle index
  std::vector<std::pair<int, int>> cloth_range, obstacle_range;
  std::vector<std::string> object_name;            ///< "cloth 'shirt'": cloths, then obstacles
  std::set<std::pair<int, int>> seam;  ///< vertices (a < b) on both sides of a seam, which may be arbitrarily near

  /// The name of the object that a vertex belongs to.
  const std::string &owner(int vertex) const
  {
    return object_name[static_cast<std::size_t>(object[static_cast<std::size_t>(vertex)])];
  }
};

Topology build_topology(const Scene &scene);

/// [edges] Lengths at rest of edges between vertices of that numbering, m: the longer one where the two sides of an
/// edge differ, 0 for edges that no cloth has.
std::vector<float> lengths_at_rest(const Scene &scene, const std::vector<kernels::edge_nodes> &edges);

/// The stiffness table of a material, [30][30][30][4] over E11, E22, |E12| (Wang et al. 2011; sampling as in
/// docs/theory/elasticity.md), N/m.
std::vector<std::array<double, 4>> stretching_table(const Material &material);

}  // namespace cama
