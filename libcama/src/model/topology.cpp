// SPDX-License-Identifier: Apache-2.0
#include "model/topology.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "device/kernels.hpp"
#include "model/exemptions.hpp"
#include "scene/constants.hpp"

namespace cama {
namespace {

using namespace kernels;

/// Material coordinates of a face's corners; without material space the face is laid flat, with the projected x axis as
/// warp.
std::array<MaterialPoint, 3> corners(const Mesh &mesh, std::size_t f)
{
  if (!mesh.material_face.empty()) {
    const Triangle &m = mesh.material_face[f];
    return {mesh.material_position[m[0]], mesh.material_position[m[1]], mesh.material_position[m[2]]};
  }
  const Triangle &t = mesh.face[f];
  const dvec3 e1 = dsub(mesh.position[t[1]], mesh.position[t[0]]), e2 = dsub(mesh.position[t[2]], mesh.position[t[0]]);
  const dvec3 n = dnormalize(dcross(e1, e2));
  dvec3 warp = daxpy({1, 0, 0}, -n.x, n);
  if (dnorm(warp) < 0.1) warp = daxpy({0, 1, 0}, -n.y, n);
  warp = dnormalize(warp);
  const dvec3 weft = dcross(n, warp);
  return {{{0, 0}, {ddot(e1, warp), ddot(e1, weft)}, {ddot(e2, warp), ddot(e2, weft)}}};
}

/// 0, 1, 2 = 0, 45, 90 degrees from warp, folded.
double direction_of(double du, double dv)
{
  double b = std::abs(std::atan2(dv, du)) * 4 / pi;
  if (b > 2) b = 4 - b;
  return std::abs(b);
}

struct HalfEdge {
  std::array<int, 2> edge;
  int face, corner;
};

void add_hinges(const Cloth &cloth, int first_vertex, int material, const std::vector<RestTriangle> &triangles,
                std::size_t first_triangle, std::vector<RestHinge> &hinges)
{
  const Mesh &mesh = cloth.mesh;
  std::vector<HalfEdge> half;
  half.reserve(3 * mesh.face.size());
  for (std::size_t f = 0; f < mesh.face.size(); ++f)
    for (int c = 0; c < 3; ++c) {
      const int a = mesh.face[f][c], b = mesh.face[f][(c + 1) % 3];
      half.push_back({{std::min(a, b), std::max(a, b)}, static_cast<int>(f), c});
    }
  std::sort(half.begin(), half.end(),
            [](const HalfEdge &a, const HalfEdge &b) { return a.edge != b.edge ? a.edge < b.edge : a.face < b.face; });
  for (std::size_t k = 0; k + 1 < half.size(); ++k) {
    // of three or more faces, each forms a hinge with the next in the list
    if (half[k].edge != half[k + 1].edge) continue;
    const HalfEdge &p = half[k], &q = half[k + 1];
    const int a = mesh.face[p.face][p.corner], b = mesh.face[p.face][(p.corner + 1) % 3];
    const int c = mesh.face[p.face][(p.corner + 2) % 3], d = mesh.face[q.face][(q.corner + 2) % 3];
    RestHinge h{};
    h.node = {first_vertex + a, first_vertex + b, first_vertex + c, first_vertex + d};
    h.material = material;
    h.triangle = {static_cast<int>(first_triangle) + p.face, static_cast<int>(first_triangle) + q.face};
    double length[2];
    const HalfEdge *side[2] = {&p, &q};
    for (int s = 0; s < 2; ++s) {
      const auto u = cloth.rest_corners(static_cast<std::size_t>(side[s]->face));
      const MaterialPoint &m0 = u[side[s]->corner], &m1 = u[(side[s]->corner + 1) % 3];
      length[s] = std::hypot(m1[0] - m0[0], m1[1] - m0[1]);
      h.direction[s] = direction_of(m1[0] - m0[0], m1[1] - m0[1]);
    }
    h.length = 0.5 * (length[0] + length[1]);
    h.area = triangles[first_triangle + p.face].area + triangles[first_triangle + q.face].area;
    if (mesh.material_face.empty()) {
      const dvec3 o = mesh.position[a];
      const auto e = [&](int v) { return f64::to_vec3(dsub(mesh.position[v], o)); };
      h.rest_angle = f64::measure_hinge(e(b), e(c), e(d)).angle;
    }
    hinges.push_back(h);
  }
}

/// Sets the rest angles of the hinges along creases.
void fold(const Scene &scene, Topology &t)
{
  std::map<std::array<int, 2>, double> angle;  // by the lower and the higher vertex of the edge
  for (const Crease &crease : scene.creases) {
    const int first = t.cloth_range[crease.cloth].first;
    for (std::size_t k = 1; k < crease.vertices.size(); ++k) {
      const int a = first + crease.vertices[k - 1], b = first + crease.vertices[k];
      angle[{std::min(a, b), std::max(a, b)}] = crease.angle * pi / 180;
    }
  }
  if (angle.empty()) return;
  for (RestHinge &h : t.hinge) {
    const auto at = angle.find({std::min(h.node[0], h.node[1]), std::max(h.node[0], h.node[1])});
    if (at != angle.end()) h.rest_angle = at->second;
  }
}

}  // namespace

double Cloth::enclosed_volume() const
{
  double volume = 0;
  if (mesh.position.empty()) return volume;
  const dvec3 &origin = mesh.position.front();
  for (const Triangle &f : mesh.face)
    volume += ddot(dsub(mesh.position[f[0]], origin),
                   dcross(dsub(mesh.position[f[1]], origin), dsub(mesh.position[f[2]], origin))) /
              6;
  return volume;
}

Shrinkage Cloth::shrinkage_of(std::size_t triangle) const
{
  if (shrinkage.empty()) return {0, 0};
  return shrinkage.size() == 1 ? shrinkage[0] : shrinkage[triangle];
}

std::array<MaterialPoint, 3> Cloth::rest_corners(std::size_t triangle) const
{
  std::array<MaterialPoint, 3> u = corners(mesh, triangle);
  const Shrinkage s = shrinkage_of(triangle);
  for (MaterialPoint &corner : u) corner = {(1 - s[0]) * corner[0], (1 - s[1]) * corner[1]};
  return u;
}

Topology build_topology(const Scene &scene)
{
  Topology t;
  for (const Cloth &cloth : scene.cloths) t.object_name.push_back("cloth '" + cloth.name + "'");
  for (const Obstacle &obstacle : scene.obstacles) t.object_name.push_back("obstacle '" + obstacle.name + "'");
  const auto add_mesh = [&](const Mesh &mesh, const std::vector<dvec3> &position, int object) {
    const int first = static_cast<int>(t.position.size());
    t.position.insert(t.position.end(), position.begin(), position.end());
    t.rest_position.insert(t.rest_position.end(), mesh.position.begin(), mesh.position.end());
    for (const Triangle &f : mesh.face) t.face.push_back({first + f[0], first + f[1], first + f[2]});
    t.object.resize(t.position.size(), object);
    return first;
  };
  const auto add_edges = [&](const Mesh &mesh, int first) {
    for (auto e : unique_edges(mesh.face)) t.edge.push_back({first + e[0], first + e[1]});
  };
  for (std::size_t c = 0; c < scene.cloths.size(); ++c) {
    const Cloth &cloth = scene.cloths[c];
    const int first = add_mesh(cloth.mesh, cloth.mesh.position, static_cast<int>(c));
    add_edges(cloth.mesh, first);
    const std::size_t first_triangle = t.triangle.size();
    t.mass.resize(t.position.size(), 0.0);
    for (std::size_t f = 0; f < cloth.mesh.face.size(); ++f) {
      const auto u = cloth.rest_corners(f);
      const double a = u[1][0] - u[0][0], b = u[2][0] - u[0][0], p = u[1][1] - u[0][1], q = u[2][1] - u[0][1],
                   det = a * q - b * p;
      RestTriangle r;
      r.area = 0.5 * std::abs(det);
      r.d = {q / det, -b / det, -p / det, a / det};
      r.material = static_cast<int>(c);
      const Shrinkage shrinkage = cloth.shrinkage_of(f);
      const double unshrunk = r.area / ((1 - shrinkage[0]) * (1 - shrinkage[1]));
      for (int k = 0; k < 3; ++k) {
        r.node[k] = first + cloth.mesh.face[f][k];
        t.mass[r.node[k]] += cloth.material.density * unshrunk / 3;
      }
      t.triangle.push_back(r);
    }
    if (cloth.material.has_bending())
      add_hinges(cloth, first, static_cast<int>(c), t.triangle, first_triangle, t.hinge);
    t.cloth_range.emplace_back(first, static_cast<int>(t.position.size()));
  }
  t.cloth_vertices = static_cast<int>(t.position.size());
  fold(scene, t);
  t.radius.assign(t.position.size(), 0.0);
  t.shape.assign(t.position.size(), ObstacleShape::mesh);
  for (std::size_t o = 0; o < scene.obstacles.size(); ++o) {
    std::vector<dvec3> placed;
    scene.obstacles[o].motion.evaluate(0, scene.obstacles[o].mesh.position, placed);
    const int first = add_mesh(scene.obstacles[o].mesh, placed, static_cast<int>(scene.cloths.size() + o));
    t.radius.resize(t.position.size(), scene.obstacles[o].radius);
    t.shape.resize(t.position.size(), scene.obstacles[o].shape);
    switch (scene.obstacles[o].shape) {
    case ObstacleShape::mesh:
    case ObstacleShape::box: add_edges(scene.obstacles[o].mesh, first); break;
    case ObstacleShape::sphere: t.exact_face.push_back({first, first, first}); break;
    case ObstacleShape::capsule:
      t.exact_face.push_back({first, first + 1, first + 1});
      t.edge.push_back({first, first + 1});
      break;
    case ObstacleShape::plane: t.exact_face.push_back({first, first + 1, first + 2}); break;
    }
    t.obstacle_range.emplace_back(first, static_cast<int>(t.position.size()));
  }
  t.area.assign(t.position.size(), 0.0);
  t.shortest_edge.assign(t.position.size(), 1e300);
  for (const Triangle &f : t.face) {
    const double area =
        0.5 * dnorm(dcross(dsub(t.position[f[1]], t.position[f[0]]), dsub(t.position[f[2]], t.position[f[0]])));
    for (int v : f) t.area[v] += area / 3;
  }
  for (const Triangle &f : t.exact_face)
    for (int v : f) t.area[v] = 1e300;  // the smaller area counts: that of the other side
  for (const auto &e : t.edge) {
    const double length = dnorm(dsub(t.position[e[0]], t.position[e[1]]));
    for (int v : e) t.shortest_edge[v] = std::min(t.shortest_edge[v], length);
  }
  t.seam = seam_pairs(scene, t);
  return t;
}

std::vector<std::array<double, 4>> stretching_table(const Material &material)
{
  const int n = STRETCHING_CELLS;
  const auto &rows = material.stretching;
  std::vector<std::array<double, 4>> table(static_cast<std::size_t>(n) * n * n);
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j)
      for (int k = 0; k < n; ++k) {
        const double e00 = -0.25 + double(i) / n, e11 = -0.25 + double(j) / n, e01 = double(k) / n;
        // Principal stretch squared, 2 E + I, and its direction.
        const double mean = 1 + e00 + e11, half = e00 - e11, radius = std::hypot(half, 2 * e01);
        const double stretch = std::sqrt(std::max(mean + radius, 0.0));
        double angle = 0.5 * std::atan2(2 * e01, half) * 8 / pi;  // 0 to 4 between 0 and 90 degrees
        angle = std::clamp(std::abs(angle), 0.0, 4 - 1e-6);
        const int a = static_cast<int>(angle);
        const double fa = angle - a, strain = std::clamp((stretch - 1) * 6, 0.0, 1 - 1e-6);
        for (int m = 0; m < 4; ++m) {
          const double stretched = (1 - fa) * rows[1 + a][m] + fa * rows[2 + a][m];
          table[(static_cast<std::size_t>(i) * n + j) * n + k][m] =
              std::max(0.0, (1 - strain) * rows[0][m] + strain * stretched);
        }
      }
  return table;
}

std::vector<float> lengths_at_rest(const Scene &scene, const std::vector<kernels::edge_nodes> &edges)
{
  using Side = std::pair<std::array<int, 2>, float>;  // vertices in ascending order, length
  std::vector<Side> sides;
  int first = 0;
  for (const Cloth &cloth : scene.cloths) {
    for (std::size_t f = 0; f < cloth.mesh.face.size(); ++f) {
      const std::array<MaterialPoint, 3> at = corners(cloth.mesh, f);
      for (std::size_t c = 0; c < 3; ++c) {
        const std::size_t d = (c + 1) % 3;
        const int a = first + cloth.mesh.face[f][c], b = first + cloth.mesh.face[f][d];
        sides.push_back({{std::min(a, b), std::max(a, b)},
                         static_cast<float>(std::hypot(at[d][0] - at[c][0], at[d][1] - at[c][1]))});
      }
    }
    first += static_cast<int>(cloth.mesh.position.size());
  }
  std::sort(sides.begin(), sides.end());
  std::vector<float> lengths;
  lengths.reserve(edges.size());
  for (const kernels::edge_nodes &e : edges) {
    const std::array<int, 2> ends{std::min(e.node[0], e.node[1]), std::max(e.node[0], e.node[1])};
    const auto behind = std::upper_bound(sides.begin(), sides.end(), Side{ends, std::numeric_limits<float>::max()});
    lengths.push_back(behind != sides.begin() && (behind - 1)->first == ends ? (behind - 1)->second : 0);
  }
  return lengths;
}

}  // namespace cama
