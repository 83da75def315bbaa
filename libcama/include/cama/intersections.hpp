// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "cama/scene.hpp"

/// Which parts of a scene intersect at the start, and where.
namespace cama {

/// An edge that passes through a face. Objects are numbered cloths first, then obstacles; vertices and faces have their
/// numbers in the object.
struct Piercing {
  int edge_object = 0;
  std::array<int, 2> edge{};
  int face_object = 0, face = 0;
  dvec3 place{0, 0, 0};  ///< where the edge meets the face, m
};

/// All piercings between two objects (first <= second; if equal, of an object with itself).
struct ObjectIntersections {
  int first = 0, second = 0;
  std::string first_name, second_name;  ///< "cloth 'shirt'"
  std::vector<Piercing> piercings;
  dvec3 mean{0, 0, 0}, lower{0, 0, 0}, upper{0, 0, 0};  ///< of the places, m
};

/// The intersections of the scene at time 0 that contact has to prevent (cloth with itself and with other cloth only if
/// contact.self is on), by exact predicates as in `intersections`. One entry per pair of objects, ordered by object
/// numbers.
std::vector<ObjectIntersections> start_intersections(const Scene &scene);

/// Writes the faces that are pierced, and those beside edges that pierce; one group per pair of objects. The suffix of
/// the file decides: .obj has named groups, .ply a colour per face. Throws FileError.
void save_intersections(const std::filesystem::path &file, const Scene &scene,
                        const std::vector<ObjectIntersections> &found);

/// The first four pairs of objects with count, first elements and place, for error messages.
std::string describe(const std::vector<ObjectIntersections> &found);

}  // namespace cama
