// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <vector>

#include "cama/mesh.hpp"

namespace cama {

/// The parts of an OBJ file that cama uses: vertices in file order, texture coordinates with their own indices, and
/// sewing lines.
struct ObjFile {
  Mesh mesh;
  std::vector<MeshStitch> stitches;
};

ObjFile read_obj(const std::filesystem::path &file, double scale, double material_scale);

}  // namespace cama
