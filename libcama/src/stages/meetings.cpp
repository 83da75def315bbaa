// SPDX-License-Identifier: Apache-2.0
#include "stages/meetings.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "device/kernels.hpp"

namespace cama {
namespace {

using namespace kernels;

// Shares of the gap: what is near at the start, and what a pair that comes from afar is stopped for.
constexpr double near_share = 0.25, target_share = 0.9, accepted_share = 0.95;
constexpr double least_share = 0.1;  // of the gap, or half of what there is, which no motion leaves
constexpr double touching_share = 1e-6;  // of the gap: nearer ones have no direction
constexpr double angle = 1e-6;  // cosine, by which a direction may lean out of the cone of a feature
constexpr double parallel = 1e-6;  // squared sine between edges that are taken for parallel
constexpr int max_advances = 200;
constexpr double never = 2;

dvec3 at(const PlacedShape &s, int vertex, double time)
{
  const std::size_t v = static_cast<std::size_t>(vertex);
  return time == 0 ? s.start[v] : dlerp(s.start[v], s.end[v], time);
}

dvec3 moved(const PlacedShape &s, int vertex)
{
  const std::size_t v = static_cast<std::size_t>(vertex);
  return dsub(s.end[v], s.start[v]);
}

/// Whether going from a foot point along `to` leads away from `direction`, or across it.
bool leads_away(const dvec3 &direction, const dvec3 &to)
{
  return ddot(direction, to) <= angle * dnorm(direction) * dnorm(to);
}

/// How far the nearer end of an edge is beyond a face that it passes through, m; 0: it just touches it; -1: it does
/// not.
double depth_of_edge(const PlacedShape &p, int edge, const PlacedShape &q, int face)
{
  constexpr double rounding = 1e-9;
  const auto &e = p.shape->edge[static_cast<std::size_t>(edge)];
  const Triangle &f = q.shape->face[static_cast<std::size_t>(face)];
  const dvec3 x[2] = {at(p, e[0], 0), at(p, e[1], 0)}, y[3] = {at(q, f[0], 0), at(q, f[1], 0), at(q, f[2], 0)};
  const dvec3 n = dcross(dsub(y[1], y[0]), dsub(y[2], y[0]));
  const double a = ddot(n, dsub(x[0], y[0])), b = ddot(n, dsub(x[1], y[0]));
  if (!(a * b <= 0) || a == b) return -1;
  const dvec3 point = dlerp(x[0], x[1], a / (a - b));
  for (int k = 0; k < 3; ++k)
    if (ddot(n, dcross(dsub(y[(k + 1) % 3], y[k]), dsub(point, y[k]))) < -rounding * ddot(n, n)) return -1;
  return std::min(std::abs(a), std::abs(b)) / dnorm(n);
}

/// The largest distance of a vertex inside a closed mesh from its surface.
double depth_of_vertices(const PlacedShape &p, const PlacedShape &q)
{
  double most = 0;
  if (q.shape->outward == 0) return most;
  for (const dvec3 &x : p.start) {
    if (!ContactTree::near({x, x}, q.tree.box(), 0)) continue;
    double angle = 0, least = std::numeric_limits<double>::infinity();  // angle: solid, half of it
    for (const Triangle &f : q.shape->face) {
      const dvec3 y[3] = {at(q, f[0], 0), at(q, f[1], 0), at(q, f[2], 0)};
      const dvec3 a = dsub(y[0], x), b = dsub(y[1], x), c = dsub(y[2], x);
      const double la = dnorm(a), lb = dnorm(b), lc = dnorm(c);
      least = std::min(least, vertex_face_proximity(x, y[0], y[1], y[2]).distance);
      angle += std::atan2(ddot(a, dcross(b, c)), la * lb * lc + ddot(a, b) * lc + ddot(b, c) * la + ddot(c, a) * lb);
    }
    if (std::abs(angle) > 3) most = std::max(most, least);  // inside: 2 pi
  }
  return most;
}

dvec3 across_edge(const dvec3 &to, const dvec3 &edge) { return daxpy(to, -ddot(to, edge) / ddot(edge, edge), edge); }

}  // namespace

MeetingSearch::MeetingSearch(const PlacedShape &a, const PlacedShape &b, double gap)
    : a_(a), b_(b), gap_(gap), radius_(a.shape->radius + b.shape->radius)
{
  if (b.shape->plane) {
    for (std::size_t v = 0; v < a.shape->corner.size(); ++v)
      if (a.shape->corner[v]) candidates_.push_back({Kind::plane, static_cast<int>(v), 0});
    return;
  }
  a.tree.pairs(b.tree, radius_ + (1 + near_share) * gap, [&](int face_a, int face_b) { add(face_a, face_b); });
  std::sort(candidates_.begin(), candidates_.end());
  candidates_.erase(std::unique(candidates_.begin(), candidates_.end()), candidates_.end());
}

void MeetingSearch::add(int face_a, int face_b)
{
  const ContactShape &a = *a_.shape, &b = *b_.shape;
  const std::size_t f = static_cast<std::size_t>(face_a), g = static_cast<std::size_t>(face_b);
  for (int v : a.face[f])
    if (a.corner[static_cast<std::size_t>(v)]) candidates_.push_back({Kind::vertex_face, v, face_b});
  if (a.rest.size() > 1 || b.rest.size() > 1)  // of two balls one pair is enough
    for (int v : b.face[g])
      if (b.corner[static_cast<std::size_t>(v)]) candidates_.push_back({Kind::face_vertex, face_a, v});
  for (int e : a.face_edge[f])
    for (int d : b.face_edge[g])
      if (e >= 0 && d >= 0) candidates_.push_back({Kind::edges, e, d});
}

MeetingSearch::Closest MeetingSearch::closest(const Candidate &c, double time) const
{
  switch (c.kind) {
  case Kind::plane: return plane(c.a, time);
  case Kind::edges: return edges(c.a, c.b, time);
  case Kind::vertex_face: return vertex_face(a_, c.a, b_, c.b, time);
  default: {
    Closest found = vertex_face(b_, c.b, a_, c.a, time);
    std::swap(found.meeting.a, found.meeting.b);
    found.meeting.normal = dscale(-1, found.meeting.normal);
    found.meeting.key[0] = static_cast<int>(Kind::face_vertex);
    return found;
  }
  }
}

MeetingSearch::Closest MeetingSearch::vertex_face(const PlacedShape &p, int vertex, const PlacedShape &q, int face,
                                                  double time) const
{
  const ContactShape &s = *q.shape;
  const Triangle &f = s.face[static_cast<std::size_t>(face)];
  const dvec3 x = at(p, vertex, time);
  const dvec3 y[3] = {at(q, f[0], time), at(q, f[1], time), at(q, f[2], time)};
  const proximity found = vertex_face_proximity(x, y[0], y[1], y[2]);
  Closest c{found.distance - radius_, {{}, {}, {}, found.normal, time}, true};
  if (found.distance < touching_share * gap_ && s.outward != 0)  // on which side of the face it is, rounding decides
    c.meeting.normal = dscale(s.outward, dnormalize(dcross(dsub(y[1], y[0]), dsub(y[2], y[0]))));
  c.meeting.a.node = {vertex, 0, 0};
  c.meeting.b = {{f[0], f[1], f[2]}, {-found.weight[1], -found.weight[2], -found.weight[3]}};
  std::vector<int> feature;  // corners in the face
  for (int k = 0; k < 3; ++k)
    if (c.meeting.b.weight[static_cast<std::size_t>(k)] > 0) feature.push_back(k);
  const dvec3 foot = c.meeting.b.at(q.start);
  const dvec3 here = time == 0 ? foot : dlerp(foot, c.meeting.b.at(q.end), time), direction = dsub(x, here);
  if (feature.size() == 1) {
    const std::size_t v = static_cast<std::size_t>(f[static_cast<std::size_t>(feature[0])]);
    for (int at_ring = s.ring_row[v]; at_ring < s.ring_row[v + 1]; ++at_ring)
      c.least = c.least && leads_away(direction, dsub(at(q, s.ring[static_cast<std::size_t>(at_ring)], time), here));
  } else if (feature.size() == 2) {
    const int edge = feature[0] == 0 && feature[1] == 2 ? 2 : feature[0];
    const int beyond = s.across[static_cast<std::size_t>(face)][static_cast<std::size_t>(edge)];
    const dvec3 along = dsub(y[feature[1]], y[feature[0]]);
    if (beyond >= 0) c.least = leads_away(direction, across_edge(dsub(at(q, beyond, time), here), along));
  }
  std::array<int, 3> nodes{-1, -1, -1};
  for (std::size_t k = 0; k < feature.size(); ++k) nodes[k] = f[static_cast<std::size_t>(feature[k])];
  std::sort(nodes.begin(), nodes.end());
  c.meeting.key = {static_cast<int>(Kind::vertex_face), vertex, nodes[0], nodes[1], nodes[2], 0, 0};
  return c;
}

MeetingSearch::Closest MeetingSearch::edges(int a, int b, double time) const
{
  const auto &e = a_.shape->edge[static_cast<std::size_t>(a)], &g = b_.shape->edge[static_cast<std::size_t>(b)];
  const dvec3 x[2] = {at(a_, e[0], time), at(a_, e[1], time)}, y[2] = {at(b_, g[0], time), at(b_, g[1], time)};
  const proximity found = edge_edge_proximity(x[0], x[1], y[0], y[1]);
  Closest c{found.distance - radius_, {{}, {}, {}, found.normal, time}, found.interior != 0};
  c.meeting.a = {{e[0], e[1], 0}, {found.weight[0], found.weight[1], 0}};
  c.meeting.b = {{g[0], g[1], 0}, {-found.weight[2], -found.weight[3], 0}};
  c.meeting.key = {static_cast<int>(Kind::edges), a, b, 0, 0, 0, 0};
  const dvec3 u = dsub(x[1], x[0]), v = dsub(y[1], y[0]), n = dcross(u, v);
  c.least = c.least && found.distance > touching_share * gap_ && ddot(n, n) > parallel * ddot(u, u) * ddot(v, v);
  const auto check = [&](const PlacedShape &s, int edge, const dvec3 &end, const dvec3 &along, const dvec3 &normal) {
    for (int w : s.shape->wing[static_cast<std::size_t>(edge)])
      if (w >= 0) c.least = c.least && leads_away(normal, across_edge(dsub(at(s, w, time), end), along));
  };
  if (!c.least) return c;
  check(a_, a, x[0], u, dscale(-1, found.normal));
  check(b_, b, y[0], v, found.normal);
  return c;
}

MeetingSearch::Closest MeetingSearch::plane(int vertex, double time) const
{
  const dvec3 p = at(b_, 0, time), u = dsub(at(b_, 1, time), p), w = dsub(at(b_, 2, time), p), n = dcross(u, w);
  const dvec3 normal = dnormalize(n), r = dsub(at(a_, vertex, time), p);
  const double height = ddot(normal, r), wb = ddot(dcross(r, w), n) / ddot(n, n),
               wc = ddot(dcross(u, r), n) / ddot(n, n);
  Closest c{height - radius_, {{}, {}, {}, normal, time}, true};
  c.meeting.a.node = {vertex, 0, 0};
  c.meeting.b = {{0, 1, 2}, {1 - wb - wc, wb, wc}};
  c.meeting.key = {static_cast<int>(Kind::plane), vertex, 0, 0, 0, 0, 0};
  return c;
}

/// A bound of how much nearer the features come.
double MeetingSearch::travel(const Candidate &c) const
{
  if (c.kind == Kind::plane) {
    const dvec3 p = moved(b_, 0), r = dsub(at(a_, c.a, 0), at(b_, 0, 0)), u = dsub(at(b_, 1, 0), at(b_, 0, 0)),
                w = dsub(at(b_, 2, 0), at(b_, 0, 0));
    const double turn = dnorm(dsub(moved(b_, 1), p)) / dnorm(u) + dnorm(dsub(moved(b_, 2), p)) / dnorm(w);
    return dnorm(dsub(moved(a_, c.a), p)) + 2 * turn * dnorm(r);
  }
  double most = 0;
  const auto nodes = [](const PlacedShape &s, bool vertex, bool edge, int index) {
    const std::size_t i = static_cast<std::size_t>(index);
    if (vertex) return Triangle{index, index, index};
    return edge ? Triangle{s.shape->edge[i][0], s.shape->edge[i][1], s.shape->edge[i][1]} : s.shape->face[i];
  };
  const bool edge = c.kind == Kind::edges;
  for (int v : nodes(a_, c.kind == Kind::vertex_face, edge, c.a))
    for (int w : nodes(b_, c.kind == Kind::face_vertex, edge, c.b))
      most = std::max(most, dnorm(dsub(moved(a_, v), moved(b_, w))));
  return most;
}

/// Conservative advancement: the share of the step at which a pair comes as near as `accepted` > `target`.
double MeetingSearch::meet(const Candidate &c, double from, double target, double accepted, double travelled) const
{
  double time = 0, distance = from;
  for (int i = 0; i < max_advances && distance > accepted; ++i) {
    time += (distance - target) / travelled;
    if (!(time < 1)) return closest(c, 1).distance > accepted ? never : 1;
    distance = closest(c, time).distance;
  }
  return time;
}

std::vector<Meeting> MeetingSearch::meetings() const
{
  std::vector<Meeting> found;
  const auto keep = [&](const Meeting &m) {  // once, whichever of the faces around the feature it comes from
    if (std::none_of(found.begin(), found.end(), [&](const Meeting &other) { return other.key == m.key; }))
      found.push_back(m);
  };
  for (const Candidate &c : candidates_) {
    const Closest start = closest(c, 0);
    if (start.distance <= (1 + near_share) * gap_) {
      if (start.least) keep(start.meeting);
      continue;
    }
    const double travelled = travel(c), target = target_share * gap_;
    if (start.distance - target > travelled) continue;
    const double time = meet(c, start.distance, target, accepted_share * gap_, travelled);
    if (time > 1) continue;
    const Closest met = closest(c, time);
    if (met.least) keep(met.meeting);
  }
  return found;
}

Meeting MeetingSearch::first_crossing() const
{
  double first = never;
  Meeting found{};
  found.time = never;
  for (const Candidate &c : candidates_) {
    if (c.kind == Kind::plane) continue;  // it has a side from which it pushes
    const double start = closest(c, 0).distance, core = start + radius_, travelled = travel(c);
    double least = start > 0 ? std::min(least_share * gap_, 0.5 * start) : start - 0.5 * core;
    if (radius_ > 0) least = std::min(least, start - 1e-3 * gap_);
    if (!(core > touching_share * gap_) || start - least > travelled) continue;
    const double target = radius_ > 0 ? least - 0.01 * gap_ : 0.5 * least;
    const double time = meet(c, start, target, least, travelled);
    if (!(time < first)) continue;
    first = time;
    found = closest(c, time).meeting;
  }
  return found;
}

double MeetingSearch::depth() const
{
  double most = -1;
  for (const Candidate &c : candidates_)
    if (c.kind == Kind::plane || radius_ > 0) most = std::max(most, -closest(c, 0).distance);
  if (!b_.shape->plane) {
    a_.tree.pairs(b_.tree, 0, [&](int f, int g) {
      for (int e : a_.shape->face_edge[static_cast<std::size_t>(f)])
        if (e >= 0) most = std::max(most, depth_of_edge(a_, e, b_, g));
      for (int e : b_.shape->face_edge[static_cast<std::size_t>(g)])
        if (e >= 0) most = std::max(most, depth_of_edge(b_, e, a_, f));
    });
    if (most >= 0) most = std::max({most, depth_of_vertices(a_, b_), depth_of_vertices(b_, a_)});
  }
  return most > touching_share * gap_ ? most : 0;
}

}  // namespace cama
