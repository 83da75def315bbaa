// SPDX-License-Identifier: Apache-2.0
#include "model/exemptions.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "device/kernels.hpp"
#include "scene/constants.hpp"

namespace cama {
namespace {

std::pair<int, int> ordered(int a, int b) { return {std::min(a, b), std::max(a, b)}; }

/// The winding number of the faces of `object` around x: 1 inside a closed surface, 0 outside (van Oosterom and
/// Strackee 1983).
double winding_number(const dvec3 &x, const std::vector<dvec3> &position, const std::vector<Triangle> &face,
                      const std::vector<int> &owner, int object)
{
  using namespace kernels;
  double angle = 0;
  for (const Triangle &f : face) {
    if (owner[f[0]] != object) continue;
    const dvec3 a = dsub(position[f[0]], x), b = dsub(position[f[1]], x), c = dsub(position[f[2]], x);
    const double la = dnorm(a), lb = dnorm(b), lc = dnorm(c);
    angle += 2 * std::atan2(ddot(a, dcross(b, c)), la * lb * lc + ddot(a, b) * lc + ddot(b, c) * la + ddot(c, a) * lb);
  }
  return angle / (4 * pi);
}

}  // namespace

std::set<std::pair<int, int>> seam_pairs(const Scene &scene, const Topology &t)
{
  std::set<std::pair<int, int>> pairs;
  if (scene.stitches.empty()) return pairs;
  std::map<std::pair<int, int>, int> faces_at;
  for (const Triangle &f : t.face)
    if (f[0] < t.cloth_vertices)
      for (int k = 0; k < 3; ++k) ++faces_at[ordered(f[k], f[(k + 1) % 3])];
  std::vector<std::vector<int>> along(static_cast<std::size_t>(t.cloth_vertices));   // neighbours on the border
  for (const auto &[edge, faces] : faces_at)
    if (faces == 1) {
      along[edge.first].push_back(edge.second);
      along[edge.second].push_back(edge.first);
    }
  const auto widened = [&](std::vector<int> vertices) {
    const std::size_t n = vertices.size();
    for (std::size_t i = 0; i < n; ++i)
      vertices.insert(vertices.end(), along[vertices[i]].begin(), along[vertices[i]].end());
    return vertices;
  };
  for (const Stitch &s : scene.stitches) {
    if (s.length > 0) continue;  // an elastic, along an edge of the cloth
    const int a = t.cloth_range[s.cloth_a].first, b = t.cloth_range[s.cloth_b].first;
    for (int p : widened({a + s.vertex_a}))
      for (int q : widened({b + s.vertex_b, b + s.vertex_c}))
        if (p != q) pairs.insert(ordered(p, q));
  }
  return pairs;
}

bool at_seam(const Topology &t, const Intersection &found)
{
  for (int a : found.edge)
    for (int b : t.face[found.face])
      if (t.seam.count(ordered(a, b))) return true;
  return false;
}

void Exemptions::set_up(Backend &b, const Topology &topology)
{
  row = Stream<int>(b);
  entry = Stream<int>(b);
  object = Stream<int>(b);
  seam_ = topology.seam;
  object_ = topology.object;
  object.assign(object_);
  upload();
}

void Exemptions::add_tangle(const std::vector<Intersection> &found, const Topology &t)
{
  for (const Intersection &i : found) {
    const Triangle &f = t.face[i.face];
    const bool edge_is_cloth = i.edge[0] < t.cloth_vertices, face_is_cloth = f[0] < t.cloth_vertices;
    if (edge_is_cloth && face_is_cloth) {
      for (int a : i.edge)
        for (int b : f) let_pass(a, b);
    } else if (edge_is_cloth) {
      for (int a : i.edge) let_go(a, t.object[f[0]]);
    } else {
      for (int b : f) let_go(b, t.object[i.edge[0]]);
    }
  }
}

bool Exemptions::forget_separated(const std::vector<dvec3> &position, const std::vector<Triangle> &face,
                                  int cloth_vertices)
{
  Pairs tangled, caught;   // caught: pairs of cloth and object that still intersect
  const auto check = [&](int vertex, int other) {
    if (released_.count({vertex, object_[other]})) caught.insert({object_[vertex], object_[other]});
  };
  for (const Intersection &i : intersections(position, face, cloth_vertices))
    for (int a : i.edge)
      for (int b : face[i.face]) {
        if (tangled_.count(ordered(a, b))) tangled.insert(ordered(a, b));
        check(a, b);
        check(b, a);
      }
  for (const auto &[vertex, o] : released_)
    if (!caught.count({object_[vertex], o}) &&
        std::abs(winding_number(position[vertex], position, face, object_, o)) > 0.5)
      caught.insert({object_[vertex], o});
  const std::size_t before = tangled_.size() + released_.size();
  tangled_.swap(tangled);
  for (auto i = released_.begin(); i != released_.end();)
    if (caught.count({object_[i->first], i->second}))
      ++i;
    else
      i = released_.erase(i);
  return tangled_.size() + released_.size() != before;
}

void Exemptions::begin_step()
{
  marked_ = false;
  tangled_before_ = tangled_;
  released_before_ = released_;
  marked_ = true;
  if (stale_) upload();
}

void Exemptions::restore() noexcept
{
  if (!marked_) return;
  marked_ = false;
  stale_ |= tangled_ != tangled_before_ || released_ != released_before_;
  tangled_.swap(tangled_before_);
  released_.swap(released_before_);
}

void Exemptions::keep(Kept &kept) noexcept
{
  marked_ = false;
  stale_ |= tangled_ != kept.first || released_ != kept.second;
  tangled_.swap(kept.first);
  released_.swap(kept.second);
}

void Exemptions::upload()
{
  stale_ = true;   // remains so if anything below throws
  const int vertices = static_cast<int>(object_.size());
  std::vector<std::vector<int>> of(object_.size());
  for (const Pairs *pairs : {&seam_, &tangled_})
    for (const auto &[a, b] : *pairs) {
      of[a].push_back(b);
      of[b].push_back(a);
    }
  for (const auto &[vertex, o] : released_) of[vertex].push_back(vertices + o);
  std::vector<int> rows{0}, entries;
  for (std::vector<int> &list : of) {
    std::sort(list.begin(), list.end());
    entries.insert(entries.end(), list.begin(), std::unique(list.begin(), list.end()));
    rows.push_back(static_cast<int>(entries.size()));
  }
  row.assign(rows);
  entry.assign(entries);
  stale_ = false;
}

}  // namespace cama
