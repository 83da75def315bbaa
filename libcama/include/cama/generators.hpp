// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "cama/motion.hpp"

/// Meshes that the shipped scenes are made of. Lengths are in m; `triangles` is an approximate number.
namespace cama {

/// A generated piece of cloth and its named vertex groups ("top", "top_left", "waist", ...).
struct Pattern {
  Mesh mesh;
  std::map<std::string, std::vector<int>> group;
};

/// Rectangle in the plane z = 0 around the origin; the diagonals alternate, so that the mesh prefers no direction.
/// Groups: left, right, bottom, top, bottom_left, bottom_right, top_left, top_right.
Pattern make_grid(double width, double height, int triangles);
Pattern make_grid_cells(double width, double height, int columns, int rows);
/// Open tube around the z axis with its base at z = 0, sewn along `seams` lines: its panels are separate in material
/// space. Groups: bottom, top.
Pattern make_tube(double bottom_radius, double top_radius, double height, int triangles, int seams = 1);

/// Geodesic sphere around the origin: 20 n^2 nearly equal triangles.
Mesh make_sphere(double radius, int triangles = 6480);
Mesh make_box(const dvec3 &size, int triangles = 12);
/// Capsule around the z axis; `length` is the distance between the centres of the two half spheres.
Mesh make_capsule(double radius, double length, int triangles = 6000);
/// Revolves a closed profile of (radius > 0, z) points, counter-clockwise, around the z axis.
Mesh make_revolution(const std::vector<std::pair<double, double>> &profile, int segments);
/// Cone and tube with one smooth wall and rounded lips, a closed solid; the throat (where the cone meets the tube) is
/// at z = 0.
struct Funnel {
  double top_radius = 0.55, throat_radius = 0.1, cone_height = 0.45, tube_length = 0.25, wall = 0.02;
};
Mesh make_funnel(const Funnel &shape, int triangles = 9000);

/// A smooth closed human-like body, 1.7 m high, feet at z = 0, looking along -y, that walks in place.
struct Walker {
  double height = 1.7;  ///< m
  double cell = 0.022;  ///< size of the meshing cell at a height of 1.7 m, m
  double rest = 0.5;  ///< time before the walk fades in, s
  double period = 1.2;  ///< of two steps, s
  double duration = 5;  ///< s
  double samples_per_second = 60;
  double stride = 22;  ///< swing of the thighs, degrees
};
Character make_walker(const Walker &walker);

/// A skirt or sleeveless dress of sewn gores around a body that stands along z. Groups: waist (top ring), hem.
struct Garment {
  double top = 1.03;  ///< height of the top ring, m
  double length = 0.5;  ///< along z, m
  int panels = 6;
  double flare = 0.12;  ///< how much the radius grows from hip to hem, m
  double clearance = 0.008;  ///< from the body, m
  double hip = 0;  ///< below this height the cloth never narrows, m; 0: from the top ring on (a skirt)
};
/// Rings follow the convex hull of the body's cross-sections (trunk and legs; parts beside them, like arms, are left
/// out). Throws MeshError if there is no body at that height or if an arm is in the way.
Pattern make_garment(const Mesh &body, const Garment &garment, int triangles);

}  // namespace cama
