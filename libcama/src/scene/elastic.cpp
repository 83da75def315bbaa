// SPDX-License-Identifier: Apache-2.0
// Elastics: springs that only pull along the edges of a line of cloth.
#include <algorithm>
#include <cmath>
#include <map>

#include "cama/error.hpp"
#include "cama/scene.hpp"

namespace cama {
namespace {

using Edge = std::array<int, 2>;

Edge ordered(int a, int b) { return {std::min(a, b), std::max(a, b)}; }

/// Lengths of the edges of a cloth in its rest state, m: the mean where faces beside an edge differ.
std::map<Edge, double> rest_lengths(const Cloth &cloth)
{
  std::map<Edge, std::pair<double, int>> sum;
  for (std::size_t f = 0; f < cloth.mesh.face.size(); ++f) {
    const auto u = cloth.rest_corners(f);
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t next = (k + 1) % 3;
      auto &[length, faces] = sum[ordered(cloth.mesh.face[f][k], cloth.mesh.face[f][next])];
      length += std::hypot(u[next][0] - u[k][0], u[next][1] - u[k][1]);
      ++faces;
    }
  }
  std::map<Edge, double> mean;
  for (const auto &[edge, lengths] : sum) mean[edge] = lengths.first / lengths.second;
  return mean;
}

}  // namespace

void Scene::add_elastic(int cloth, const std::vector<int> &vertices, double share, double stiffness)
{
  if (cloth < 0 || cloth >= static_cast<int>(cloths.size()))
    throw SceneError("elastic: there is no cloth " + std::to_string(cloth));
  const Cloth &c = cloths[static_cast<std::size_t>(cloth)];
  const std::string object = "elastic of cloth \"" + c.name + "\": ";
  if (vertices.size() < 2) throw SceneError(object + "a line needs two vertices at least");
  if (!std::isfinite(share) || !(share > 0))
    throw SceneError(object + "length is " + std::to_string(share) + "; give a share of the line's, greater than 0");
  if (!std::isfinite(stiffness) || !(stiffness > 0))
    throw SceneError(object + "stiffness is " + std::to_string(stiffness) + "; give N, greater than 0");
  const std::map<Edge, double> length = rest_lengths(c);
  std::vector<Stitch> springs;
  for (std::size_t i = 0; i + 1 < vertices.size(); ++i) {
    const int a = vertices[i], b = vertices[i + 1];
    const auto edge = length.find(ordered(a, b));
    if (edge == length.end())
      throw SceneError(object + "vertices " + std::to_string(a) + " and " + std::to_string(b) +
                       ", one after the other, have no edge between them; name the vertices along edges, in order");
    const double rest = share * edge->second;
    springs.push_back({cloth, a, cloth, b, b, 0, stiffness / rest, rest});
  }
  stitches.insert(stitches.end(), springs.begin(), springs.end());
}

}  // namespace cama
