// SPDX-License-Identifier: Apache-2.0
#include "cama/untangle.hpp"

#include <algorithm>
#include <cmath>
#include <memory>

#include "start/start_check.hpp"
#include "start/untangler.hpp"

namespace cama {
namespace untangling {

using namespace kernels;

namespace {

constexpr int relaxed_rings = 3;             // around moved vertices, in which stretch is relaxed
constexpr int patience = 12;                 // rounds without progress until the other method is tried
// Relative to an edge's length at the start: stretch is kept between these, and relaxes towards 1.
constexpr double shortest_stretch = 0.6, longest_stretch = 1.25;

double smallest_thickness(const Scene &scene, const Topology &t)
{
  double smallest = scene.contact.thickness;
  for (int v = 0; v < t.cloth_vertices; ++v) {
    const double own = scene.cloths[t.object[v]].material.thickness;
    smallest =
        std::min({smallest, own > 0 ? own : scene.contact.thickness, max_thickness_per_edge * t.shortest_edge[v]});
  }
  return smallest;
}

}  // namespace

Untangler::Untangler(const Scene &scene, const Topology &t, const UntangleOptions &o)
    : t_(t), surface_(t), self_(scene.contact.self), max_rounds_(o.max_rounds),
      gap_(o.gap > 0 ? o.gap : 0.1 * smallest_thickness(scene, t)), x_(t.position),
      inverse_mass_(t.position.size(), 0.0), limit_(t.position.size(), 0.0), area_(t.area),
      pushed_(t.position.size(), 0), moved_(t.position.size(), 0)
{
  for (int v = 0; v < t.cloth_vertices; ++v) inverse_mass_[v] = 1 / t.mass[v];
  for (const Pin &pin : scene.pins)
    for (int v : pin.vertices) inverse_mass_[t.cloth_range[pin.cloth].first + v] = 0;
  for (const auto &e : t.edge) start_length_.push_back(dnorm(dsub(x_[e[0]], x_[e[1]])));
  for (int v = 0; v < t.cloth_vertices; ++v) {
    double sum = 0;
    int n = 0;
    for (int e : surface_.edges[v]) sum += start_length_[e], ++n;
    limit_[v] = 0.5 * std::min(sum / std::max(n, 1), 4 * t.shortest_edge[v]);
  }
  for (std::size_t f = 0; f < t.face.size(); ++f)
    if (surface_.outward[f]) {
      obstacle_face_.push_back(static_cast<int>(f));
      obstacle_triangle_.push_back(t.face[f]);
    }
  if (!obstacle_face_.empty()) obstacle_tree_ = std::make_unique<FaceTree>(x_, obstacle_triangle_);
}

/// Features nearer than the gap, of which at least one vertex was moved; without intersections their directions are on
/// the right side.
std::vector<Untangler::Near> Untangler::near() const
{
  std::vector<Near> found;
  const FaceTree tree(x_, t_.face);
  const auto cloth = [&](int v) { return v < t_.cloth_vertices; };
  const auto skipped = [&](int a, int b) { return cloth(a) == cloth(b) && (!cloth(a) || !self_); };
  const auto add = [&](const proximity &p, std::array<int, 4> node) {
    if (p.distance >= gap_) return;
    Near n{{}, p.distance};
    n.push.direction = p.normal;
    n.push.target = 1.25 * gap_;
    for (int k = 0; k < 4; ++k) n.push.add(node[k], p.weight[k]);
    found.push_back(n);
  };
  const auto any_moved = [&](std::initializer_list<int> list) {
    return std::any_of(list.begin(), list.end(), [&](int v) { return moved_[v]; });
  };
  for (int v = 0; v < static_cast<int>(x_.size()); ++v)
    tree.visit(tree.around(x_[v], gap_), [&](int f) {
      const Triangle &k = t_.face[f];
      if (skipped(v, k[0]) || k[0] == v || k[1] == v || k[2] == v || !any_moved({v, k[0], k[1], k[2]})) return;
      add(vertex_face_proximity(x_[v], x_[k[0]], x_[k[1]], x_[k[2]]), {v, k[0], k[1], k[2]});
    });
  std::vector<int> others;
  for (int e = 0; e < static_cast<int>(t_.edge.size()); ++e) {
    const int a = t_.edge[e][0], b = t_.edge[e][1];
    others.clear();
    tree.visit(box_union(tree.around(x_[a], gap_), tree.around(x_[b], gap_)), [&](int f) {
      const Triangle &k = t_.face[f];
      if (skipped(a, k[0]) || !any_moved({a, b, k[0], k[1], k[2]})) return;
      for (int c = 0; c < 3; ++c) {
        const int p = k[c], q = k[(c + 1) % 3];
        if (p != a && p != b && q != a && q != b) {
          const int o = surface_.edge_of(p, q);
          if (o > e) others.push_back(o);
        }
      }
    });
    std::sort(others.begin(), others.end());
    others.erase(std::unique(others.begin(), others.end()), others.end());
    for (int o : others) {
      const int c = t_.edge[o][0], d = t_.edge[o][1];
      if (any_moved({a, b, c, d})) add(edge_edge_proximity(x_[a], x_[b], x_[c], x_[d]), {a, b, c, d});
    }
  }
  return found;
}

/// Pushed vertices may move, and so may the rings around them.
void Untangler::touch(const std::vector<Push> &pushes)
{
  for (const Push &p : pushes)
    for (int k = 0; k < p.count; ++k)
      if (p.node[k] < t_.cloth_vertices) pushed_[p.node[k]] = 1;
  active_ = pushed_;
  std::vector<int> front;
  for (int v = 0; v < t_.cloth_vertices; ++v)
    if (active_[v]) front.push_back(v);
  std::size_t from = 0;
  for (int ring = 0; ring < relaxed_rings; ++ring) {
    const std::size_t to = front.size();
    for (; from < to; ++from)
      for (int e : surface_.edges[front[from]])
        for (int v : t_.edge[e])
          if (!active_[v]) {
            active_[v] = 1;
            front.push_back(v);
          }
  }
}

void Untangler::satisfy(const Push &p)
{
  double at = 0, mobility = 0;
  for (int k = 0; k < p.count; ++k) {
    at += p.weight[k] * ddot(p.direction, x_[p.node[k]]);
    mobility += p.weight[k] * p.weight[k] * inverse_mass_[p.node[k]];
  }
  if (at >= p.target || !(mobility > 0)) return;
  const double impulse = (p.target - at) / mobility;
  for (int k = 0; k < p.count; ++k) {
    const double s = impulse * p.weight[k] * inverse_mass_[p.node[k]];
    if (s != 0) x_[p.node[k]] = daxpy(x_[p.node[k]], s, p.direction);
  }
}

/// Moves edges towards their length at the start, then applies the pushes; no vertex moves further than half an edge.
void Untangler::apply(const std::vector<Push> &pushes, double stretch_stiffness)
{
  touch(pushes);
  const std::vector<dvec3> before = x_;
  std::vector<int> springs;
  if (stretch_stiffness > 0)
    for (int e = 0; e < static_cast<int>(t_.edge.size()); ++e)
      if (t_.edge[e][0] < t_.cloth_vertices && (active_[t_.edge[e][0]] || active_[t_.edge[e][1]])) springs.push_back(e);
  const auto mobility = [&](int v) { return active_[v] ? inverse_mass_[v] : 0.0; };
  for (int sweep = 0; sweep < 4; ++sweep) {
    for (int e : springs) {
      const int a = t_.edge[e][0], b = t_.edge[e][1];
      const dvec3 d = dsub(x_[b], x_[a]);
      const double wa = mobility(a), wb = mobility(b), length = dnorm(d);
      if (!(wa + wb > 0) || !(length > 0)) continue;
      const double wanted = std::clamp(length, shortest_stretch * start_length_[e], longest_stretch * start_length_[e]);
      const double s = (length - wanted + stretch_stiffness * (wanted - start_length_[e])) / (length * (wa + wb));
      if (wa > 0) x_[a] = daxpy(x_[a], s * wa, d);
      if (wb > 0) x_[b] = daxpy(x_[b], -s * wb, d);
    }
    for (const Push &p : pushes) satisfy(p);
  }
  for (int v = 0; v < t_.cloth_vertices; ++v) {
    if (!active_[v]) continue;
    const dvec3 d = dsub(x_[v], before[v]);
    const double length = dnorm(d);
    if (length > limit_[v]) x_[v] = daxpy(before[v], limit_[v] / length, d);
    if (length > 0) moved_[v] = 1;
  }
}

UntangleReport Untangler::run()
{
  UntangleReport report;
  std::vector<dvec3> fewest_x = x_, clean_x;
  int fewest = -1, stalled = 0, parting = 0;
  bool sides_first = true;
  double clean_gap = -1, stiffness = 0.1;   // decreases, so that the pushes prevail in the end
  for (;; ++report.rounds) {
    const std::vector<Hit> hits = audit();
    const int count = static_cast<int>(hits.size());
    if (fewest < 0) report.before = count;
    if (fewest < 0 || count < fewest) {
      fewest = count;
      fewest_x = x_;
      stalled = 0;
    } else if (count > 2 * fewest + 100 && report.rounds < max_rounds_) {
      x_ = fewest_x;
      stalled = 0;
      sides_first = !sides_first;
      continue;
    } else if (++stalled >= patience) {
      stalled = 0;
      sides_first = !sides_first;
    }
    std::vector<Push> pushes;
    if (count == 0) {
      const std::vector<Near> close = near();
      double smallest = gap_;
      for (const Near &n : close) {
        smallest = std::min(smallest, n.distance);
        pushes.push_back(n.push);
      }
      if (smallest > clean_gap) {
        clean_gap = smallest;
        clean_x = x_;
      }
      if (close.empty() || ++parting > 40) break;
    }
    if (report.rounds >= max_rounds_) break;
    if (count > 0) {
      std::vector<char> done(hits.size(), 0);
      const Sets side = sides(hits);
      push_out_of_obstacles(hits, side, done, pushes);
      if (sides_first) push_back(hits, contours(hits), done, pushes);
      for (std::size_t i = 0; i < hits.size(); ++i)
        if (!done[i]) shorten(hits[i], pushes);
    }
    apply(pushes, count > 0 ? stiffness : 0.0);
    stiffness *= 0.985;
  }
  report.clean = clean_gap > 0;
  report.after = clean_gap > 0 ? 0 : fewest;
  report.smallest_gap = std::max(clean_gap, 0.0);
  x_ = report.clean ? clean_x : fewest_x;
  for (int v = 0; v < t_.cloth_vertices; ++v) {
    const double length = dnorm(dsub(x_[v], t_.position[v]));
    report.moved += length > 0;
    report.largest_move = std::max(report.largest_move, length);
  }
  return report;
}

}  // namespace untangling

UntangleReport untangle(const Scene &scene, Topology &topology, const UntangleOptions &options)
{
  std::vector<dvec3> moved;
  UntangleReport report;
  {
    untangling::Untangler work(scene, topology, options);
    report = work.run();
    moved = work.positions();
  }
  topology.position = std::move(moved);
  return report;
}

UntangleReport untangle(Scene &scene, const UntangleOptions &options)
{
  scene.validate();
  Topology topology = build_topology(scene);
  const UntangleReport report = untangle(scene, topology, options);
  for (std::size_t c = 0; c < scene.cloths.size(); ++c) {
    Mesh &mesh = scene.cloths[c].mesh;
    std::copy_n(topology.position.begin() + topology.cloth_range[c].first, mesh.position.size(), mesh.position.begin());
  }
  return report;
}

}  // namespace cama
