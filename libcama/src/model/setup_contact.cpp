// SPDX-License-Identifier: Apache-2.0
#include "model/setup_parts.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "model/features.hpp"

namespace cama {
namespace {

constexpr double without_end = 1e30;         // m; boxes of planes
// Of the thickness: half for the contact distance, the rest for what the solve adds to the prediction.
constexpr double contact_margin = 0.6;
// Of an edge. Shorter motions pass few other features, and tests for these would cost more than they save.
constexpr double short_share = 2;

/// The vertices beside each edge in the first two of its faces; -1 where there is none.
std::vector<kernels::edge_nodes> wings_of(const std::vector<kernels::edge_nodes> &edges,
                                          const std::vector<kernels::face_nodes> &faces)
{
  struct Side {
    std::array<int, 2> edge;
    int beside;
  };
  std::vector<Side> sides;
  for (const kernels::face_nodes &f : faces)
    for (int k = 0; k < 3; ++k) {
      const int a = f.node[k], b = f.node[(k + 1) % 3], beside = f.node[(k + 2) % 3];
      if (a != b && b != beside && a != beside) sides.push_back({{std::min(a, b), std::max(a, b)}, beside});
    }
  std::stable_sort(sides.begin(), sides.end(), [](const Side &a, const Side &b) { return a.edge < b.edge; });
  std::vector<kernels::edge_nodes> wings;
  for (const kernels::edge_nodes &e : edges) {
    const std::array<int, 2> key = {std::min(e.node[0], e.node[1]), std::max(e.node[0], e.node[1])};
    auto side =
        std::lower_bound(sides.begin(), sides.end(), key, [](const Side &a, const auto &k) { return a.edge < k; });
    kernels::edge_nodes w{{-1, -1}};
    for (int k = 0; k < 2 && side != sides.end() && side->edge == key; ++k, ++side) w.node[k] = side->beside;
    wings.push_back(w);
  }
  return wings;
}

}  // namespace

void set_up_contact(State &state, const Scene &scene, const Topology &t, const std::vector<double> &inverse_mass)
{
  Backend &b = *state.backend;
  state.contact.friction = has_friction(scene);
  state.bounds.predicted = Stream<dvec3>(b, state.mesh.vertices);
  state.mesh.inverse_mass = Stream<double>(b, inverse_mass);
  std::vector<kernels::face_nodes> faces;
  std::vector<kernels::edge_nodes> edges;
  std::vector<kernels::vertex_contact> properties(t.position.size());
  std::vector<double> margin(t.position.size()), short_motion(t.position.size());
  std::vector<int> query_vertices;
  state.contact.largest_thickness = state.bounds.spacing = 0;
  for (const auto *list : {&t.face, &t.exact_face})
    for (const Triangle &f : *list) faces.push_back({{f[0], f[1], f[2]}});
  for (const auto &e : t.edge) {
    // A box's edges without the diagonals of its sides: corners along an edge differ in one bit.
    if (t.shape[e[0]] == ObstacleShape::box) {
      const int first = t.obstacle_range[static_cast<std::size_t>(t.object[e[0]]) - scene.cloths.size()].first,
                bits = (e[0] - first) ^ (e[1] - first);
      if (bits & (bits - 1)) continue;
    }
    edges.push_back({{e[0], e[1]}});
  }
  const auto of_obstacle = [&](const kernels::edge_nodes &e) { return e.node[0] >= t.cloth_vertices; };
  if (!scene.contact.self && std::none_of(edges.begin(), edges.end(), of_obstacle))
    edges.clear();  // the cloth's edges have none to collide with
  state.mesh.edges = static_cast<int>(edges.size());
  for (std::size_t v = 0; v < t.position.size(); ++v) {
    const std::size_t object = static_cast<std::size_t>(t.object[v]), cloths = scene.cloths.size();
    const bool obstacle = object >= cloths;
    kernels::vertex_contact &p = properties[v];
    const ContactProperties own = scene.contact_properties(object);
    p.thickness = own.thickness;
    if (!obstacle) p.thickness = std::min(p.thickness, max_thickness_per_edge * t.shortest_edge[v]);
    state.contact.largest_thickness = std::max(state.contact.largest_thickness, p.thickness);
    p.area = t.area[v];
    short_motion[v] = short_share * std::sqrt(p.area);
    if (!obstacle) state.bounds.spacing += std::sqrt(p.area) / t.cloth_vertices;
    p.stiffness = own.stiffness;
    p.friction = own.friction;
    p.static_friction = own.static_friction;
    p.obstacle = obstacle;
    const ObstacleShape shape = t.shape[v];
    p.radius = t.radius[v];
    p.shape = shape == ObstacleShape::plane
                  ? SHAPE_PLANE
                  : (shape == ObstacleShape::sphere || shape == ObstacleShape::capsule ? SHAPE_ROUND : SHAPE_MESH);
    if (shape != ObstacleShape::plane) query_vertices.push_back(static_cast<int>(v));
    margin[v] = shape == ObstacleShape::plane ? without_end : p.radius + contact_margin * p.thickness;
  }
  state.mesh.face = Stream<kernels::face_nodes>(b, faces);
  state.mesh.edge = Stream<kernels::edge_nodes>(b, edges);
  state.mesh.edge_wing = Stream<kernels::edge_nodes>(b, wings_of(edges, faces));
  state.contact.vertex_contact = Stream<kernels::vertex_contact>(b, properties);
  state.bounds.margin = Stream<double>(b, margin);
  state.bounds.short_motion = Stream<double>(b, short_motion);
  state.bounds.query_vertices = Stream<int>(b, query_vertices);
  state.bounds.uncertain = Stream<double>(b, std::vector<double>{0});
  state.bounds.bounds = Stream<dvec3>(b, 2);
  state.bounds.vertex_box = Stream<kernels::box>(b, state.mesh.vertices);
  for (PairList *list : {&state.contact.vertex_face, &state.contact.edge_edge}) {
    list->pairs = Stream<kernels::pair>(b);
    list->direction = Stream<kernels::fvec3>(b);
    list->gap_bound = Stream<float>(b);
  }
  if (!t.seam.empty() || state.options.intersections == StartPolicy::exempt || state.options.pinch == Pinch::release)
    state.exemptions.set_up(b, t);
  state.contact.contact = Stream<kernels::contact>(b);
  state.contact.impact = Stream<kernels::impact>(b);
}

}  // namespace cama
