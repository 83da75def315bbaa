// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "start/start_check.hpp"
#include "start/untangler.hpp"

namespace cama::untangling {

using namespace kernels;

namespace {

constexpr int reach_rings = 12;              // from a contour on, its smaller side is pushed this far in one round
constexpr double clearly_smaller = 0.5;      // largest area of the side that is pushed back, relative to the other's
constexpr double contour_step = 0.5;         // share of the possible way that a vertex goes in a round

}  // namespace

bool Untangler::closed_hit(const Hit &h) const
{
  if (surface_.outward[h.face]) return true;
  if (t_.edge[h.edge][0] < t_.cloth_vertices) return false;
  const std::vector<int> beside = surface_.faces_of_edge(h.edge);
  return !beside.empty() && surface_.outward[beside.front()] != 0;
}

std::vector<Hit> Untangler::audit() const
{
  std::vector<Hit> hits;
  for (const Intersection &i : forbidden_intersections(x_, t_, self_)) {
    Hit h{surface_.edge_of(i.edge[0], i.edge[1]), i.face, 0.5, {}};
    const Triangle &f = t_.face[i.face];
    const dvec3 p = x_[i.edge[0]], d = dsub(x_[i.edge[1]], p), n = surface_.normal(x_, i.face);
    const double slope = ddot(n, d);
    if (std::abs(slope) > 1e-12 * dnorm(n) * dnorm(d))
      h.along = std::clamp(ddot(n, dsub(x_[f[0]], p)) / slope, 0.0, 1.0);
    const proximity at = vertex_face_proximity(daxpy(p, h.along, d), x_[f[0]], x_[f[1]], x_[f[2]]);
    for (int k = 0; k < 3; ++k) h.weight[k] = -at.weight[k + 1];
    hits.push_back(h);
  }
  return hits;
}

/// Two hits are neighbours on a contour if they are ends of the same segment, in which two faces cross.
std::vector<int> Untangler::contours(const std::vector<Hit> &hits) const
{
  std::vector<std::pair<std::array<int, 2>, int>> ends;
  for (std::size_t i = 0; i < hits.size(); ++i)
    for (int g : surface_.faces_of_edge(hits[i].edge))
      ends.push_back({{std::min(g, hits[i].face), std::max(g, hits[i].face)}, static_cast<int>(i)});
  std::sort(ends.begin(), ends.end());
  Sets contour(static_cast<int>(hits.size()));
  for (std::size_t k = 1; k < ends.size(); ++k)
    if (ends[k].first == ends[k - 1].first) contour.join(ends[k].second, ends[k - 1].second);
  std::vector<int> root(hits.size());
  for (std::size_t i = 0; i < hits.size(); ++i) root[i] = contour.root(static_cast<int>(i));
  return root;
}

/// Sets of cloth vertices joined by edges that contours cross an even number of times, or not at all.
Sets Untangler::sides(const std::vector<Hit> &hits) const
{
  std::vector<char> odd(t_.edge.size(), 0);
  for (const Hit &h : hits) odd[h.edge] ^= 1;
  Sets side(static_cast<int>(t_.position.size()));
  for (std::size_t e = 0; e < t_.edge.size(); ++e)
    if (!odd[e]) side.join(t_.edge[e][0], t_.edge[e][1]);
  return side;
}

/// Vertices inside a closed obstacle move to the nearest point of its surface; cloth that an obstacle's edge pierces
/// moves beyond the edge.
void Untangler::push_out_of_obstacles(const std::vector<Hit> &hits, const Sets &side, std::vector<char> &done,
                                      std::vector<Push> &pushes) const
{
  std::map<int, int> votes;   // side -> inside minus outside
  std::set<int> inside;
  for (const Hit &h : hits) {
    if (!surface_.outward[h.face]) continue;
    const auto &e = t_.edge[h.edge];
    const double rise = surface_.outward[h.face] * ddot(surface_.normal(x_, h.face), dsub(x_[e[1]], x_[e[0]]));
    const int in = rise > 0 ? e[0] : e[1], out = rise > 0 ? e[1] : e[0];
    inside.insert(in);
    if (side.root(in) != side.root(out)) {
      ++votes[side.root(in)];
      --votes[side.root(out)];
    }
  }
  double all = 0;
  std::map<int, double> area;
  for (int v = 0; v < t_.cloth_vertices; ++v) {
    all += area_[v];
    const auto at = votes.find(side.root(v));
    if (at != votes.end() && at->second > 0) area[at->first] += area_[v];
  }
  for (int v = 0; v < t_.cloth_vertices; ++v) {
    const auto at = area.find(side.root(v));
    if (at != area.end() && at->second < 0.5 * all) inside.insert(v);
  }
  std::set<int> pushed;
  for (int v : inside) {
    if (inverse_mass_[v] == 0) continue;
    int nearest = -1;
    proximity best{};
    for (double radius = 4 * limit_[v] + gap_; nearest < 0 && radius < 1e3; radius *= 4)
      obstacle_tree_->visit(obstacle_tree_->around(x_[v], radius), [&](int k) {
        const Triangle &f = obstacle_triangle_[k];
        const proximity p = vertex_face_proximity(x_[v], x_[f[0]], x_[f[1]], x_[f[2]]);
        if (p.distance > radius ||
            (nearest >= 0 && (p.distance > best.distance || (p.distance == best.distance && k > nearest))))
          return;
        nearest = k;
        best = p;
      });
    if (nearest < 0) continue;
    const dvec3 out =
        dscale(surface_.outward[obstacle_face_[nearest]], dnormalize(surface_.normal(x_, obstacle_face_[nearest])));
    const dvec3 direction = best.distance > 0 ? dscale(-1, best.normal) : out;
    if (ddot(direction, out) <= 0) continue;   // outside already
    Push p;
    p.direction = direction;
    p.target = gap_;
    p.add(v, 1);
    for (int k = 0; k < 3; ++k) p.add(obstacle_triangle_[nearest][k], best.weight[k + 1]);
    pushes.push_back(p);
    pushed.insert(v);
  }
  for (std::size_t i = 0; i < hits.size(); ++i) {
    const Hit &h = hits[i];
    const auto &e = t_.edge[h.edge];
    if (surface_.outward[h.face]) {
      done[i] = pushed.count(e[0]) || pushed.count(e[1]);
      continue;
    }
    if (e[0] < t_.cloth_vertices || !closed_hit(h)) continue;
    dvec3 out{0, 0, 0};
    for (int f : surface_.faces_of_edge(h.edge))
      out = daxpy(out, surface_.outward[f], dnormalize(surface_.normal(x_, f)));
    out = dnormalize(out);
    if (ddot(out, out) == 0) continue;
    const int top = ddot(out, dsub(x_[e[1]], x_[e[0]])) > 0 ? e[1] : e[0];
    Push p;
    p.direction = out;
    p.target = gap_;
    for (int k = 0; k < 3; ++k) p.add(t_.face[h.face][k], h.weight[k]);
    p.add(top, -1);
    pushes.push_back(p);
    done[i] = 1;
  }
}

/// The vertices around one strand of a contour (the edges of one surface that pierce another), on either side of the
/// pierced surface; each vertex belongs to the side that is fewer edges away. So a contour divides its neighbourhood
/// even if it ends inside the surface.
std::array<Untangler::Side, 2> Untangler::sides_of_strand(const std::vector<Hit> &hits, const std::vector<int> &strand,
                                                          const std::vector<char> &cut) const
{
  std::map<int, int> label;   // vertex -> sum of signs
  for (int i : strand) {
    const auto &e = t_.edge[hits[i].edge];
    const int up = ddot(surface_.normal(x_, hits[i].face), dsub(x_[e[1]], x_[e[0]])) > 0 ? 1 : 0;
    ++label[e[up]];
    --label[e[1 - up]];
  }
  std::array<Side, 2> side;
  side[0].sign = -1;
  side[1].sign = 1;
  std::vector<int> front, next;
  for (auto &[v, sum] : label)
    if (sum != 0) {
      front.push_back(v);
      sum = sum > 0 ? 1 : -1;
    }
  for (int ring = 0; ring < reach_rings && !front.empty(); ++ring) {
    std::map<int, int> fresh;
    for (int v : front) {
      Side &own = side[label[v] > 0];
      own.vertex.push_back(v);
      own.area += area_[v];
      own.rings = ring;
      for (int e : surface_.edges[v]) {
        if (cut[e]) continue;
        const int other = t_.edge[e][0] == v ? t_.edge[e][1] : t_.edge[e][0];
        if (!label.count(other)) fresh[other] += label[v];
      }
    }
    front.clear();
    for (const auto &[v, sum] : fresh) {
      label[v] = sum >= 0 ? 1 : -1;
      front.push_back(v);
    }
  }
  return side;
}

/// Pushes the smallest side of every contour back through the surface that cuts it off.
void Untangler::push_back(const std::vector<Hit> &hits, const std::vector<int> &contour, std::vector<char> &done,
                          std::vector<Push> &pushes) const
{
  std::vector<char> cut(t_.edge.size(), 0);
  for (const Hit &h : hits) cut[h.edge] ^= 1;
  Sets strand(static_cast<int>(hits.size()));
  std::map<std::array<int, 2>, int> first;   // contour and face -> a hit of an edge of that face
  std::map<int, std::vector<int>> members;
  for (std::size_t i = 0; i < hits.size(); ++i) {
    if (closed_hit(hits[i])) continue;
    members[contour[i]].push_back(static_cast<int>(i));
    for (int f : surface_.faces_of_edge(hits[i].edge)) {
      const auto [at, fresh] = first.insert({{contour[i], f}, static_cast<int>(i)});
      if (!fresh) strand.join(at->second, static_cast<int>(i));
    }
  }
  for (const auto &[name, list] : members) {
    std::map<int, std::vector<int>> strands;
    for (int i : list)
      if (t_.edge[hits[i].edge][0] < t_.cloth_vertices && cut[hits[i].edge]) strands[strand.root(i)].push_back(i);
    Side best;
    const std::vector<int> *best_strand = nullptr;
    for (const auto &[root, own] : strands) {
      std::array<Side, 2> side = sides_of_strand(hits, own, cut);
      Side &small = side[0].area <= side[1].area ? side[0] : side[1];
      const double other = std::max(side[0].area, side[1].area);
      if (small.vertex.empty() || small.area > clearly_smaller * other || small.rings + 1 >= reach_rings) continue;
      if (!best_strand || small.area < best.area) {
        best = std::move(small);
        best_strand = &own;
      }
    }
    if (best_strand) push_side_back(hits, list, *best_strand, best, done, pushes);
  }
}

void Untangler::push_side_back(const std::vector<Hit> &hits, const std::vector<int> &members,
                               const std::vector<int> &strand, const Side &side, std::vector<char> &done,
                               std::vector<Push> &pushes) const
{
  const std::set<int> inside(side.vertex.begin(), side.vertex.end());
  const auto in = [&](int v) { return inside.count(v) != 0; };
  std::vector<int> wall;
  std::set<int> seen_face;
  for (int i : strand)
    if (seen_face.insert(hits[i].face).second) wall.push_back(hits[i].face);
  std::size_t from = 0;
  // The surface around the contour, with as many rings, without the side itself.
  for (int ring = 0; ring <= side.rings + 1 && from < wall.size(); ++ring) {
    const std::size_t to = wall.size();
    for (; from < to; ++from)
      for (int v : t_.face[wall[from]])
        for (int f : surface_.faces[v]) {
          const Triangle &k = t_.face[f];
          if (!std::any_of(k.begin(), k.end(), in) && seen_face.insert(f).second) wall.push_back(f);
        }
  }
  wall.erase(std::remove_if(wall.begin(), wall.end(),
                            [&](int f) { return std::any_of(t_.face[f].begin(), t_.face[f].end(), in); }),
             wall.end());
  std::vector<std::pair<dvec3, double>> ball;
  for (int f : wall) {
    const Triangle &k = t_.face[f];
    const dvec3 centre = dscale(1.0 / 3, dadd(x_[k[0]], dadd(x_[k[1]], x_[k[2]])));
    double radius = 0;
    for (int v : k) radius = std::max(radius, dnorm(dsub(x_[v], centre)));
    ball.push_back({centre, radius});
  }
  for (int v : side.vertex) {
    int nearest = -1;
    proximity best{};
    for (std::size_t k = 0; k < wall.size(); ++k) {
      if (nearest >= 0 && dnorm(dsub(x_[v], ball[k].first)) - ball[k].second > best.distance) continue;
      const Triangle &f = t_.face[wall[k]];
      if (f[0] == v || f[1] == v || f[2] == v) continue;
      const proximity p = vertex_face_proximity(x_[v], x_[f[0]], x_[f[1]], x_[f[2]]);
      if (nearest < 0 || p.distance < best.distance) {
        nearest = wall[k];
        best = p;
      }
    }
    if (nearest < 0) continue;
    const dvec3 normal = dscale(-side.sign, dnormalize(surface_.normal(x_, nearest)));
    const double height = best.distance * ddot(best.normal, normal);
    if (height >= gap_ || (best.distance > gap_ && -height < 0.3 * best.distance))
      continue;   // already there, or beside the surface's border
    Push p;
    p.direction = normal;
    p.target = gap_;
    p.add(v, 1);
    for (int k = 0; k < 3; ++k) p.add(t_.face[nearest][k], best.weight[k + 1]);
    pushes.push_back(p);
    for (int i : members)
      if (t_.edge[hits[i].edge][0] == v || t_.edge[hits[i].edge][1] == v) done[i] = 1;
  }
  // Moving the side frees the edges that pierce it.
  bool any = false;
  for (int i : members) any |= done[i] != 0;
  if (any)
    for (int i : members)
      if (std::any_of(t_.face[hits[i].face].begin(), t_.face[hits[i].face].end(), in)) done[i] = 1;
}

/// The relative motion of edge and face that shortens the contour fastest. The contour leaves the point where the edge
/// pierces along r_i, in each face beside the edge. If the edge moves by d against the face, the point moves by d -
/// (n.d / n.e) e, so the length changes by -sum_i r_i . (d - (n.d / n.e) e); it decreases fastest along sum_i (r_i -
/// (r_i.e / n.e) n).
void Untangler::shorten(const Hit &h, std::vector<Push> &pushes) const
{
  const auto &edge = t_.edge[h.edge];
  const Triangle &face = t_.face[h.face];
  const dvec3 e = dnormalize(dsub(x_[edge[1]], x_[edge[0]])), n = dnormalize(surface_.normal(x_, h.face));
  const double ne = ddot(n, e);
  dvec3 g{0, 0, 0};
  for (int f : surface_.faces_of_edge(h.edge)) {
    const Triangle &k = t_.face[f];
    const int third = k[0] + k[1] + k[2] - edge[0] - edge[1];
    dvec3 r = dnormalize(dcross(n, surface_.normal(x_, f)));
    const dvec3 w = dsub(x_[third], x_[edge[0]]), inward = daxpy(w, -ddot(w, e), e);
    if (ddot(r, inward) < 0) r = dscale(-1, r);
    g = dadd(g, daxpy(r, -ddot(r, e) * ne / (ne * ne + 0.01), n));  // bounded where the edge lies in the face's plane
  }
  const double size = dnorm(g);
  if (!(size > 1e-9)) return;
  Push p;
  p.direction = dscale(1 / size, g);
  p.add(edge[0], 1 - h.along);
  p.add(edge[1], h.along);
  for (int k = 0; k < 3; ++k) p.add(face[k], -h.weight[k]);
  double at = 0, step = 1e300;
  for (int k = 0; k < p.count; ++k) {
    at += p.weight[k] * ddot(p.direction, x_[p.node[k]]);
    if (p.node[k] < t_.cloth_vertices) step = std::min(step, limit_[p.node[k]]);
  }
  p.target = at + contour_step * step * size / std::sqrt(size * size + 0.25);
  pushes.push_back(p);
}

}  // namespace cama::untangling
