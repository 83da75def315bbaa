// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "cama/scene.hpp"

/// Which parts of a scene intersect at the start, and where.
namespace cama {

/// An edge that passes through a face. Objects: cloths in order, then obstacles; vertices and faces in the object's own
/// numbering.
struct Piercing {
  int edge_object = 0;
  std::array<int, 2> edge{};
  int face_object = 0, face = 0;
  dvec3 place{0, 0, 0};  ///< where the edge meets the face, m
};

/// All piercings of one pair of objects (first <= second; equal: an object with itself).
struct ObjectIntersections {
  int first = 0, second = 0;
  std::string first_name, second_name;  ///< "cloth 'shirt'"
  std::vector<Piercing> piercings;
  dvec3 mean{0, 0, 0}, lower{0, 0, 0}, upper{0, 0, 0};  ///< of the places, m
};

/// The scene's intersections that contact is to prevent (cloth with itself and other cloth only where contact.self is
/// on), at time 0, one entry per pair of objects, ordered by object numbers. By exact predicates, as `intersections`.
std::vector<ObjectIntersections> start_intersections(const Scene &scene);

/// The faces that are pierced, and those beside edges that pierce; one group per pair of objects.
/// The suffix chooses: .obj has named groups, .ply a colour per face. Throws FileError.
void save_intersections(const std::filesystem::path &file, const Scene &scene,
                        const std::vector<ObjectIntersections> &found);

/// The first four pairs of objects with count, first primitives and place; for error texts.
std::string describe(const std::vector<ObjectIntersections> &found);

}  // namespace cama
