// SPDX-License-Identifier: Apache-2.0
#pragma once
#if CAMA_HAS_ASSIMP
#include <filesystem>

#include <assimp/Importer.hpp>
#include <assimp/scene.h>

#include "cama/types.hpp"

namespace cama {

/// 3x4 affine map in double; those of assimp are in single precision.
struct Affine {
  double m[3][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}};
  static Affine from(const aiMatrix4x4 &a)
  {
    return {{{a.a1, a.a2, a.a3, a.a4}, {a.b1, a.b2, a.b3, a.b4}, {a.c1, a.c2, a.c3, a.c4}}};
  }
  dvec3 apply(const dvec3 &x) const
  {
    return {m[0][0] * x.x + m[0][1] * x.y + m[0][2] * x.z + m[0][3],
            m[1][0] * x.x + m[1][1] * x.y + m[1][2] * x.z + m[1][3],
            m[2][0] * x.x + m[2][1] * x.y + m[2][2] * x.z + m[2][3]};
  }
};

inline Affine multiply(const Affine &a, const Affine &b)
{
  Affine r;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 4; ++j)
      r.m[i][j] = a.m[i][0] * b.m[0][j] + a.m[i][1] * b.m[1][j] + a.m[i][2] * b.m[2][j] + (j == 3 ? a.m[i][3] : 0);
  return r;
}

inline dvec3 y_up_to_z_up(const dvec3 &x) { return {x.x, -x.z, x.y}; }

/// Opens a file with triangles only and pivots collapsed. Throws FileError.
const aiScene *open_assimp(Assimp::Importer &importer, const std::filesystem::path &file, bool need_mesh);

/// Whether a face has three corners, all of them vertices of the mesh: damaged files name others.
bool is_triangle(const aiMesh &mesh, unsigned face);

}  // namespace cama
#endif
