// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <numeric>

#include "cama/mesh.hpp"

namespace cama {
namespace {

/// Along no edge of ordinary meshes: few vertices are level with others.
constexpr dvec3 direction{0.5411961, 0.2903847, 0.7892071};

/// Whether a mesh can be welded; Mesh::validate says what is wrong if not.
bool usable(const Mesh &m)
{
  const int count = static_cast<int>(m.position.size());
  for (const dvec3 &x : m.position)
    if (!std::isfinite(x.x) || !std::isfinite(x.y) || !std::isfinite(x.z)) return false;
  for (const Triangle &t : m.face)
    for (int v : t)
      if (v < 0 || v >= count) return false;
  return !m.face.empty() && (m.material_face.empty() || m.material_face.size() == m.face.size());
}

/// The lowest vertex of each vertex's group [vertices]: groups hold what is no more than `distance` apart, and what is
/// joined to the same vertex. Vertices are sorted by their height along `direction` and compared with those above them
/// within the distance.
std::vector<int> lowest_of_groups(const std::vector<dvec3> &position, double distance)
{
  const std::size_t n = position.size();
  std::vector<int> lowest(n), order(n);
  std::iota(lowest.begin(), lowest.end(), 0);
  std::iota(order.begin(), order.end(), 0);
  const auto root = [&](int v) {
    while (lowest[v] != v) v = lowest[v] = lowest[lowest[v]];
    return v;
  };
  std::vector<double> height(n);
  double largest = 0;
  for (std::size_t v = 0; v < n; ++v) {
    const dvec3 &x = position[v];
    height[v] = kernels::ddot(x, direction);
    largest = std::max({largest, std::abs(x.x), std::abs(x.y), std::abs(x.z)});
  }
  std::sort(order.begin(), order.end(),
            [&](int a, int b) { return height[a] != height[b] ? height[a] < height[b] : a < b; });
  const double reach = distance * (1 + 1e-9) + 4e-16 * largest;  // heights are rounded
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t k = i + 1; k < n && height[order[k]] - height[order[i]] <= reach; ++k) {
      const dvec3 apart = kernels::dsub(position[order[k]], position[order[i]]);
      if (kernels::ddot(apart, apart) > distance * distance) continue;
      const int a = root(order[i]), b = root(order[k]);
      lowest[std::max(a, b)] = std::min(a, b);
    }
  for (std::size_t v = 0; v < n; ++v) lowest[v] = root(static_cast<int>(v));
  return lowest;
}

bool repeats(const Triangle &t) { return t[0] == t[1] || t[1] == t[2] || t[2] == t[0]; }

}  // namespace

WeldDistances weld_distances(const Mesh &mesh)
{
  if (mesh.position.empty()) return {};
  dvec3 low = mesh.position[0], high = low;
  for (const dvec3 &x : mesh.position) {
    low = {std::min(low.x, x.x), std::min(low.y, x.y), std::min(low.z, x.z)};
    high = {std::max(high.x, x.x), std::max(high.y, x.y), std::max(high.z, x.z)};
  }
  const double extent = std::max({high.x - low.x, high.y - low.y, high.z - low.z});
  return {1e-6 * extent, 0.1 * extent};
}

WeldedMesh weld(const Mesh &mesh, double distance)
{
  const std::size_t n = mesh.position.size();
  WeldedMesh out;
  out.vertex.resize(n);
  if (!usable(mesh)) {
    std::iota(out.vertex.begin(), out.vertex.end(), 0);
    out.mesh = mesh;
    return out;
  }
  const std::vector<int> lowest = lowest_of_groups(mesh.position, distance);
  std::vector<char> used_before(n, 0), used(n, 0);  // of the lowest vertices
  out.mesh.material_position = mesh.material_position;
  for (std::size_t f = 0; f < mesh.face.size(); ++f) {
    const Triangle &t = mesh.face[f];
    const Triangle joined{lowest[t[0]], lowest[t[1]], lowest[t[2]]};
    for (int v : joined) used_before[v] = 1;
    if (repeats(joined) && !repeats(t)) continue;  // collapsed; what repeated a vertex before is for Mesh::validate
    for (int v : joined) used[v] = 1;
    out.mesh.face.push_back(joined);
    if (!mesh.material_face.empty()) out.mesh.material_face.push_back(mesh.material_face[f]);
  }
  std::vector<int> number(n, -1);
  for (std::size_t v = 0; v < n; ++v) {
    if (lowest[v] != static_cast<int>(v) || (used_before[v] && !used[v])) continue;
    number[v] = static_cast<int>(out.mesh.position.size());
    out.mesh.position.push_back(mesh.position[v]);
  }
  for (std::size_t v = 0; v < n; ++v) out.vertex[v] = number[lowest[v]];
  for (Triangle &t : out.mesh.face)
    for (int &v : t) v = number[v];
  return out;
}

std::vector<MeshStitch> renumber(const std::vector<MeshStitch> &stitches, const std::vector<int> &vertex)
{
  std::vector<MeshStitch> out;
  for (const MeshStitch &s : stitches) {
    const MeshStitch t{vertex[s.a], vertex[s.b], vertex[s.c], s.ratio};
    if (t.a >= 0 && t.b >= 0 && t.c >= 0 && t.a != t.b && t.a != t.c) out.push_back(t);
  }
  return out;
}

}  // namespace cama
