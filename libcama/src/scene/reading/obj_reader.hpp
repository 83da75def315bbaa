// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "cama/mesh.hpp"

namespace cama {

/// The parts of an OBJ file that cama uses: vertices in file order, texture coordinates with their own indices, and
/// sewing lines.
struct ObjFile {
  Mesh mesh;
  std::vector<MeshStitch> stitches;
};

/// `rest`: uv, texture coordinates become material space; start, they are not looked at. Throws FileError and
/// MeshError.
ObjFile read_obj(const std::filesystem::path &file, double scale, RestShape rest, double material_scale);
/// Throws MeshError: `rest` is uv, and the file has no texture coordinates.
[[noreturn]] void fail_without_texture(const std::string &file, bool some);

}  // namespace cama
