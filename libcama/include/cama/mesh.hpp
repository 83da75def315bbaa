// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "cama/types.hpp"

namespace cama {

using Triangle = std::array<int, 3>;
using MaterialPoint = std::array<double, 2>;  ///< (u, v), m

/// Triangles in world space; panels may be separate in material space while they share vertices in world space.
struct Mesh {
  std::vector<dvec3> position;                    ///< [vertices], m
  std::vector<Triangle> face;                     ///< [triangles] indices into position
  std::vector<MaterialPoint> material_position;   ///< [material vertices], m; empty: none
  std::vector<Triangle> material_face;            ///< [triangles] indices into material_position; empty: none

  /// Throws MeshError, which names `object` and the element: empty mesh, non-finite coordinate, index out of range,
  /// repeated index, zero area (in world and, if present, material space), duplicate face, vertex that no face uses.
  void validate(const std::string &object) const;
};

/// Unique undirected edges (lo, hi), ordered by lo then hi.
std::vector<std::array<int, 2>> unique_edges(const std::vector<Triangle> &face);

/// Sewing line of a mesh file: x_a is held at (1 - ratio) x_b + ratio x_c.
struct MeshStitch {
  int a = 0, b = 0, c = 0;
  double ratio = 0;
};

/// The rest shape of cloth from a mesh file: its start, or its texture coordinates.
enum class RestShape { start, uv };

/// Reads OBJ (with its own reader, which keeps vertex order, separate texture indices and every bit) and PLY, glTF,
/// FBX, DAE and STL through assimp. All meshes of the file become one, vertices at equal positions are welded (not
/// those of OBJ), and coordinates are file units times `scale`; the y-up formats (glTF, FBX, DAE) are turned to z-up.
/// With RestShape::uv, texture coordinates times `material_scale` (m per unit) become material space; else the mesh has
/// none. Throws FileError, and MeshError if texture coordinates are asked for and missing or `material_scale` is given
/// without them.
Mesh load_mesh(const std::filesystem::path &file, double scale = 1.0, RestShape rest = RestShape::start,
               double material_scale = 1.0);
/// The lines "stitch a b c ratio" of an OBJ file (vertices counted from 0); other formats have none. Throws FileError.
std::vector<MeshStitch> load_stitches(const std::filesystem::path &file);

/// Distances to weld at, m: `coincident` joins vertices that differ by rounding, a millionth of the longest side of the
/// mesh's bounding box; more than `largest`, a tenth of it, is not meant.
struct WeldDistances {
  double coincident = 0, largest = 0;
};
WeldDistances weld_distances(const Mesh &mesh);

struct WeldedMesh {
  Mesh mesh;
  std::vector<int> vertex;  ///< [old vertices] new vertex; -1: none
};
/// Joins vertices that are no more than `distance` (m) apart, and what is joined to the same vertex. Each group keeps
/// the position of its first vertex, and vertices are numbered in the order of these. Triangles that collapse are left
/// out, and so are vertices that no other triangle uses. Material coordinates stay: seams remain open in material
/// space. A mesh with an index out of range or a coordinate that is not finite is returned as it is.
WeldedMesh weld(const Mesh &mesh, double distance);
/// Renumbers stitches after welding; a stitch whose vertex has become one of the edge it is drawn to, or has gone, is
/// left out.
std::vector<MeshStitch> renumber(const std::vector<MeshStitch> &stitches, const std::vector<int> &vertex);

/// Writes OBJ, with material coordinates if there are any. Throws FileError.
void save_obj(const std::filesystem::path &file, const Mesh &mesh);

}  // namespace cama
