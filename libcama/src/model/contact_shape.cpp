// SPDX-License-Identifier: Apache-2.0
#include "model/contact_shape.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <utility>

#include "device/kernels.hpp"

namespace cama {
namespace {

using namespace kernels;

constexpr double flat = 1e-6;  // sine of the angle between faces that lie in a plane
constexpr double round_vertices = 1e-6;  // of the radius, by which vertices of a sphere's mesh may be off
constexpr double round_faces = 0.06;  // likewise its faces: those of 180 triangles are

struct Ball {
  dvec3 center;
  double radius;
};

using Edges = std::map<std::array<int, 2>, std::vector<std::array<int, 2>>>;  // faces, and which of their edges

Edges edges_of(const std::vector<Triangle> &faces)
{
  Edges edges;
  for (std::size_t f = 0; f < faces.size(); ++f)
    for (int k = 0; k < 3; ++k) {
      const int a = faces[f][static_cast<std::size_t>(k)], b = faces[f][static_cast<std::size_t>((k + 1) % 3)];
      edges[{std::min(a, b), std::max(a, b)}].push_back({static_cast<int>(f), k});
    }
  return edges;
}

/// The sphere that fits points best: |x|^2 = 2 c x + k by least squares; none if they lie in a plane.
std::optional<Ball> fitted_ball(const std::vector<dvec3> &points)
{
  dvec3 mean{0, 0, 0};
  for (const dvec3 &x : points) mean = daxpy(mean, 1.0 / static_cast<double>(points.size()), x);
  std::array<std::array<double, 4>, 3> a{};  // normal equations about the mean, where k separates
  for (const dvec3 &point : points) {
    const dvec3 p = dsub(point, mean);
    const std::array<double, 3> x{p.x, p.y, p.z};
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t j = 0; j < 3; ++j) a[i][j] += 2 * x[i] * x[j];
      a[i][3] += x[i] * ddot(p, p);
    }
  }
  for (std::size_t k = 0; k < 3; ++k) {
    if (!(a[k][k] > 0)) return {};
    for (std::size_t i = 0; i < 3; ++i) {
      if (i == k) continue;
      const double factor = a[i][k] / a[k][k];
      for (std::size_t j = k; j < 4; ++j) a[i][j] -= factor * a[k][j];
    }
  }
  const dvec3 c{a[0][3] / a[0][0], a[1][3] / a[1][1], a[2][3] / a[2][2]};
  double radius = 0;
  for (const dvec3 &x : points) radius += dnorm(dsub(dsub(x, mean), c)) / static_cast<double>(points.size());
  return Ball{dadd(mean, c), radius};
}

/// The sphere whose mesh this is, if it is one's.
std::optional<Ball> ball_of(const Mesh &mesh, const Edges &edges)
{
  for (const auto &edge : edges)
    if (edge.second.size() != 2) return {};
  const std::optional<Ball> ball = fitted_ball(mesh.position);
  if (!ball) return {};
  for (const dvec3 &x : mesh.position)
    if (!(std::abs(dnorm(dsub(x, ball->center)) - ball->radius) <= round_vertices * ball->radius)) return {};
  for (const Triangle &f : mesh.face) {
    const auto x = [&](std::size_t k) { return mesh.position[static_cast<std::size_t>(f[k])]; };
    const dvec3 n = dnormalize(dcross(dsub(x(1), x(0)), dsub(x(2), x(0))));
    if (!(std::abs(ddot(n, dsub(x(0), ball->center))) >= (1 - round_faces) * ball->radius)) return {};
  }
  return ball;
}

int outward_of(const std::vector<dvec3> &position, const std::vector<Triangle> &face, const Edges &edges)
{
  for (const auto &edge : edges)
    if (edge.second.size() != 2) return 0;
  double volume = 0;
  for (const Triangle &f : face) {
    const auto x = [&](std::size_t k) { return dsub(position[static_cast<std::size_t>(f[k])], position[0]); };
    volume += ddot(x(0), dcross(x(1), x(2)));
  }
  return volume > 0 ? 1 : (volume < 0 ? -1 : 0);
}

bool keeps_size(const Motion &motion)
{
  return motion.is_rigid() && std::all_of(motion.keys.begin(), motion.keys.end(),
                                          [](const Motion::Key &k) { return k.transform.scale == 1; });
}

}  // namespace

ContactShape::ContactShape(const Obstacle &obstacle)
    : plane(obstacle.shape == ObstacleShape::plane), rest(obstacle.mesh.position), face(obstacle.mesh.face)
{
  const bool mesh = obstacle.shape == ObstacleShape::mesh || obstacle.shape == ObstacleShape::box;
  Edges edges = edges_of(face);
  if (!mesh) {
    radius = plane ? 0 : obstacle.radius;
    face = {plane                                     ? Triangle{0, 1, 2}
            : obstacle.shape == ObstacleShape::sphere ? Triangle{0, 0, 0}
                                                      : Triangle{0, 1, 1}};
    edges.clear();
    if (obstacle.shape == ObstacleShape::capsule) edges[{0, 1}] = {{0, 0}};
  } else if (const auto ball = keeps_size(obstacle.motion) ? ball_of(obstacle.mesh, edges) : std::nullopt) {
    radius = ball->radius;
    rest = {ball->center};
    face = {{0, 0, 0}};
    edges.clear();
  }
  if (mesh && radius == 0) outward = outward_of(rest, face, edges);
  across.assign(face.size(), {-1, -1, -1});
  face_edge.assign(face.size(), {-1, -1, -1});
  corner.assign(rest.size(), edges.empty() || !mesh);
  std::vector<std::vector<int>> neighbours(rest.size());
  const auto normal = [&](int f) {
    const Triangle &t = face[static_cast<std::size_t>(f)];
    const dvec3 a = rest[static_cast<std::size_t>(t[0])];
    return dnormalize(
        dcross(dsub(rest[static_cast<std::size_t>(t[1])], a), dsub(rest[static_cast<std::size_t>(t[2])], a)));
  };
  for (const auto &[ends, sides] : edges) {
    neighbours[static_cast<std::size_t>(ends[0])].push_back(ends[1]);
    neighbours[static_cast<std::size_t>(ends[1])].push_back(ends[0]);
    const auto beside = [&](std::size_t side) {
      return face[static_cast<std::size_t>(sides[side][0])][static_cast<std::size_t>((sides[side][1] + 2) % 3)];
    };
    const bool joint = sides.size() == 2;
    if (joint)
      for (std::size_t side = 0; side < 2; ++side)
        across[static_cast<std::size_t>(sides[side][0])][static_cast<std::size_t>(sides[side][1])] = beside(1 - side);
    if (joint && dnorm(dcross(normal(sides[0][0]), normal(sides[1][0]))) <= flat && obstacle.motion.is_rigid())
      continue;
    for (const auto &side : sides)
      face_edge[static_cast<std::size_t>(side[0])][static_cast<std::size_t>(side[1])] = static_cast<int>(edge.size());
    edge.push_back(ends);
    wing.push_back({mesh ? beside(0) : -1, joint ? beside(1) : -1});
    for (int v : ends) corner[static_cast<std::size_t>(v)] = 1;
  }
  if (obstacle.motion.is_rigid()) join_edges();
  ring_row = {0};
  for (const auto &own : neighbours) {
    ring.insert(ring.end(), own.begin(), own.end());
    ring_row.push_back(static_cast<int>(ring.size()));
  }
}

/// Joins edges that continue each other in a straight line: their common vertex is none that others touch first.
void ContactShape::join_edges()
{
  std::vector<std::vector<int>> around(rest.size());
  for (std::size_t e = 0; e < edge.size(); ++e)
    for (int v : edge[e]) around[static_cast<std::size_t>(v)].push_back(static_cast<int>(e));
  const auto direction = [&](int e) {
    const auto &ends = edge[static_cast<std::size_t>(e)];
    return dnormalize(dsub(rest[static_cast<std::size_t>(ends[1])], rest[static_cast<std::size_t>(ends[0])]));
  };
  for (std::size_t v = 0; v < rest.size(); ++v)
    if (around[v].size() == 2 && dnorm(dcross(direction(around[v][0]), direction(around[v][1]))) <= flat &&
        wing[static_cast<std::size_t>(around[v][0])][1] >= 0 && wing[static_cast<std::size_t>(around[v][1])][1] >= 0)
      corner[v] = 0;
  std::vector<int> joined(edge.size(), -1);
  std::vector<std::array<int, 2>> whole, beside;
  for (std::size_t first = 0; first < edge.size(); ++first) {
    if (joined[first] >= 0) continue;
    std::array<int, 2> ends = edge[first];
    joined[first] = static_cast<int>(whole.size());
    for (int &end : ends)
      for (int e = static_cast<int>(first); !corner[static_cast<std::size_t>(end)];) {
        const auto &two = around[static_cast<std::size_t>(end)];
        e = two[0] == e ? two[1] : two[0];
        if (joined[static_cast<std::size_t>(e)] >= 0) break;  // a ring without a corner
        joined[static_cast<std::size_t>(e)] = static_cast<int>(whole.size());
        const auto &next = edge[static_cast<std::size_t>(e)];
        end = next[0] == end ? next[1] : next[0];
      }
    whole.push_back(ends);
    beside.push_back(wing[first]);
  }
  for (Triangle &edges : face_edge)
    for (int &e : edges)
      if (e >= 0) e = joined[static_cast<std::size_t>(e)];
  edge = std::move(whole);
  wing = std::move(beside);
}

ContactTree::ContactTree(const ContactShape &shape)
{
  std::vector<dvec3> center;
  std::vector<int> order;
  for (std::size_t f = 0; f < shape.face.size(); ++f) {
    dvec3 sum{0, 0, 0};
    for (int v : shape.face[f]) sum = dadd(sum, shape.rest[static_cast<std::size_t>(v)]);
    center.push_back(sum);
    order.push_back(static_cast<int>(f));
  }
  build(center, order, 0, static_cast<int>(order.size()));
  box_.resize(node_.size());
}

int ContactTree::build(const std::vector<dvec3> &center, std::vector<int> &order, int first, int last)
{
  const int here = static_cast<int>(node_.size());
  node_.emplace_back();
  if (last - first == 1) {
    node_.back().face = order[static_cast<std::size_t>(first)];
    return here;
  }
  const auto begin = order.begin() + first, end = order.begin() + last;
  dvec3 low = center[static_cast<std::size_t>(*begin)], high = low;
  for (auto at = begin; at != end; ++at) {
    low = dvec3_min(low, center[static_cast<std::size_t>(*at)]);
    high = dvec3_max(high, center[static_cast<std::size_t>(*at)]);
  }
  const dvec3 size = dsub(high, low);
  const int axis = size.x >= size.y && size.x >= size.z ? 0 : (size.y >= size.z ? 1 : 2);
  std::sort(begin, end, [&](int a, int b) {
    const double x = dcomponent(center[static_cast<std::size_t>(a)], axis),
                 y = dcomponent(center[static_cast<std::size_t>(b)], axis);
    return x != y ? x < y : a < b;
  });
  const int middle = first + (last - first) / 2;
  const int left = build(center, order, first, middle), right = build(center, order, middle, last);
  node_[static_cast<std::size_t>(here)].left = left;
  node_[static_cast<std::size_t>(here)].right = right;
  return here;
}

void ContactTree::fit(const ContactShape &shape, const std::vector<dvec3> &start, const std::vector<dvec3> &end)
{
  for (std::size_t i = node_.size(); i-- > 0;) {
    const Node &n = node_[i];
    if (n.face < 0) {
      const Box &a = box_[static_cast<std::size_t>(n.left)], &b = box_[static_cast<std::size_t>(n.right)];
      box_[i] = {dvec3_min(a.low, b.low), dvec3_max(a.high, b.high)};
      continue;
    }
    Box b{start[static_cast<std::size_t>(shape.face[static_cast<std::size_t>(n.face)][0])], {}};
    b.high = b.low;
    for (int v : shape.face[static_cast<std::size_t>(n.face)])
      for (const auto *x : {&start, &end}) {
        b.low = dvec3_min(b.low, (*x)[static_cast<std::size_t>(v)]);
        b.high = dvec3_max(b.high, (*x)[static_cast<std::size_t>(v)]);
      }
    box_[i] = b;
  }
}

}  // namespace cama
