// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "cama/error.hpp"
#include "cama/scene.hpp"
#include "device/kernels.hpp"

namespace cama {

std::vector<int> Scene::vertices_along(int cloth, const dvec3 &from, const dvec3 &to) const
{
  using namespace kernels;
  constexpr double near = 1e-3;  // of the length
  if (cloth < 0 || cloth >= static_cast<int>(cloths.size()))
    throw SceneError("line: there is no cloth " + std::to_string(cloth) + "; the scene has " +
                     std::to_string(cloths.size()) + ", counted from 0");
  const Cloth &c = cloths[static_cast<std::size_t>(cloth)];
  const dvec3 way = dsub(to, from);
  const double length = dnorm(way);
  if (!std::isfinite(length) || !(length > 0)) throw SceneError("line: needs two points that differ");
  std::vector<std::pair<double, int>> found;
  for (std::size_t v = 0; v < c.mesh.position.size(); ++v) {
    const dvec3 x = dsub(c.mesh.position[v], from);
    const double at = ddot(x, way) / (length * length);
    if (at < -near || at > 1 + near || dnorm(daxpy(x, -at, way)) > near * length) continue;
    found.push_back({at, static_cast<int>(v)});
  }
  std::sort(found.begin(), found.end());
  if (found.size() < 2)
    throw SceneError("line: cloth \"" + c.name + "\" has " + std::to_string(found.size()) +
                     " vertices on it; lay it along edges of the mesh");
  std::vector<int> vertices;
  for (const auto &[at, vertex] : found) vertices.push_back(vertex);
  return vertices;
}

}  // namespace cama
