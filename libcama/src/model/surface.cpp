// SPDX-License-Identifier: Apache-2.0
#include "model/surface.hpp"

#include <algorithm>
#include <map>

#include "device/kernels.hpp"

namespace cama {
namespace {

using namespace kernels;

template <class Elements> Rows incident(int vertices, const Elements &elements)
{
  Rows rows;
  rows.start.assign(static_cast<std::size_t>(vertices) + 1, 0);
  for (const auto &e : elements)
    for (int v : e) ++rows.start[v + 1];
  for (int v = 0; v < vertices; ++v) rows.start[v + 1] += rows.start[v];
  rows.value.resize(rows.start.back());
  std::vector<int> at(rows.start.begin(), rows.start.end() - 1);
  for (std::size_t k = 0; k < elements.size(); ++k)
    for (int v : elements[k]) rows.value[at[v]++] = static_cast<int>(k);
  return rows;
}

}  // namespace

Sets::Sets(int n) : parent_(n)
{
  for (int i = 0; i < n; ++i) parent_[i] = i;
}

int Sets::root(int i) const
{
  while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
  return i;
}

void Sets::join(int a, int b)
{
  a = root(a), b = root(b);
  parent_[std::max(a, b)] = std::min(a, b);
}

Surface::Surface(const Topology &t)
    : topology(t), faces(incident(static_cast<int>(t.position.size()), t.face)),
      edges(incident(static_cast<int>(t.position.size()), t.edge)), outward(t.face.size(), 0)
{
  // A part of an obstacle is closed if every edge has two faces that run through it in opposite directions; the sign of
  // its volume gives the outer side.
  Sets part(static_cast<int>(t.position.size()));
  std::map<int, double> volume;
  std::map<int, bool> closed;
  for (const Triangle &f : t.face) {
    part.join(f[0], f[1]);
    part.join(f[0], f[2]);
  }
  for (const Triangle &f : t.face) {
    if (f[0] < t.cloth_vertices) continue;
    const int root = part.root(f[0]);
    const dvec3 o = t.position[root], a = dsub(t.position[f[0]], o), b = dsub(t.position[f[1]], o),
                c = dsub(t.position[f[2]], o);
    volume[root] += ddot(a, dcross(b, c));
    closed.emplace(root, true);
  }
  for (std::size_t e = 0; e < t.edge.size(); ++e) {
    if (t.edge[e][0] < t.cloth_vertices) continue;
    int count = 0, turn = 0;
    for (int f : faces_of_edge(static_cast<int>(e))) {
      const Triangle &k = t.face[f];
      for (int c = 0; c < 3; ++c)
        if (k[c] == t.edge[e][0]) turn += k[(c + 1) % 3] == t.edge[e][1] ? 1 : -1;
      ++count;
    }
    if (count != 2 || turn != 0) closed[part.root(t.edge[e][0])] = false;
  }
  for (std::size_t f = 0; f < t.face.size(); ++f) {
    if (t.face[f][0] < t.cloth_vertices) continue;
    const int root = part.root(t.face[f][0]);
    if (closed[root]) outward[f] = volume[root] > 0 ? 1 : (volume[root] < 0 ? -1 : 0);
  }
}

int Surface::edge_of(int a, int b) const
{
  for (int e : edges[a])
    if (topology.edge[e][0] == b || topology.edge[e][1] == b) return e;
  return -1;
}

std::vector<int> Surface::faces_of_edge(int edge) const
{
  std::vector<int> beside;
  for (int f : faces[topology.edge[edge][0]]) {
    const Triangle &t = topology.face[f];
    if (std::find(t.begin(), t.end(), topology.edge[edge][1]) != t.end()) beside.push_back(f);
  }
  return beside;
}

dvec3 Surface::normal(const std::vector<dvec3> &x, int face) const
{
  const Triangle &t = topology.face[face];
  return dcross(dsub(x[t[1]], x[t[0]]), dsub(x[t[2]], x[t[0]]));
}

}  // namespace cama
