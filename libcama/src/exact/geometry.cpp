// SPDX-License-Identifier: Apache-2.0
#include "cama/geometry.hpp"

#include <algorithm>
#include <atomic>
#include <new>

#include "cama/backend.hpp"
#include "exact/face_tree.hpp"
#include "exact/predicates.hpp"

namespace cama {
namespace {

using namespace kernels;

Ccd as_ccd(impact_time t) { return {t.hit != 0, t.hit ? t.time : 1.0}; }

Distance as_distance(const proximity &p) { return {p.distance, {p.weight[0], p.weight[1], p.weight[2], p.weight[3]}}; }

}  // namespace

Ccd vertex_face_ccd(const Quad &a, const Quad &b, double minimum_distance)
{
  if (minimum_distance == 0) return as_ccd(linear_touch_time(1, a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]));
  return as_ccd(vertex_face_impact_time(a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3], minimum_distance));
}

Ccd edge_edge_ccd(const Quad &a, const Quad &b, double minimum_distance)
{
  if (minimum_distance == 0) return as_ccd(linear_touch_time(2, a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]));
  return as_ccd(edge_edge_impact_time(a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3], minimum_distance));
}

Ccd vertex_face_ccd_cubic(const Quad &a, const Quad &b)
{
  return as_ccd(vertex_face_impact_cubic(a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]));
}

Ccd edge_edge_ccd_cubic(const Quad &a, const Quad &b)
{
  return as_ccd(edge_edge_impact_cubic(a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]));
}

Distance vertex_face_distance(const Quad &x) { return as_distance(vertex_face_proximity(x[0], x[1], x[2], x[3])); }
Distance edge_edge_distance(const Quad &x) { return as_distance(edge_edge_proximity(x[0], x[1], x[2], x[3])); }

std::vector<Intersection> intersections(const std::vector<dvec3> &position, const std::vector<Triangle> &face,
                                        int first_obstacle_vertex)
{
  if (face.empty()) return {};
  const FaceTree tree(position, face);
  const auto edge = unique_edges(face);
  const auto obstacle = [&](int vertex) { return first_obstacle_vertex >= 0 && vertex >= first_obstacle_vertex; };
  constexpr int chunk = 1024;   // edges; chunks run in parallel and are joined in order
  const int edges = static_cast<int>(edge.size()), chunks = (edges + chunk - 1) / chunk;
  std::vector<std::vector<Intersection>> found(chunks);
  const auto visit = [&](int c) {
    for (int e = c * chunk; e < std::min(edges, (c + 1) * chunk); ++e) {
      const int p = edge[e][0], q = edge[e][1];
      const std::size_t first = found[c].size();
      tree.visit(box_union(tree.vertex_boxes[p], tree.vertex_boxes[q]), [&](int f) {
        const Triangle &t = face[f];
        if (obstacle(p) && obstacle(t[0])) return;
        if (std::any_of(t.begin(), t.end(), [&](int v) { return v == p || v == q; })) return;
        if (exact::segment_meets_triangle(position[p], position[q], position[t[0]], position[t[1]], position[t[2]]))
          found[c].push_back({{p, q}, f});
      });
      std::sort(found[c].begin() + first, found[c].end(),
                [](const Intersection &a, const Intersection &b) { return a.face < b.face; });
    }
  };
  std::atomic<bool> out_of_memory{false};   // exceptions may not leave a parallel loop
#if defined(_OPENMP)
  // For small meshes this is 1, which starts no threads: a process that forks could not have them.
  const int threads = useful_threads(static_cast<int>(face.size()));
#pragma omp parallel for schedule(dynamic) num_threads(threads)
#endif
  for (int c = 0; c < chunks; ++c) {
    try {
      visit(c);
    } catch (const std::bad_alloc &) {
      out_of_memory = true;
    }
  }
  if (out_of_memory) throw std::bad_alloc();
  std::vector<Intersection> all;
  for (const auto &part : found) all.insert(all.end(), part.begin(), part.end());
  return all;
}

}  // namespace cama
