// SPDX-License-Identifier: Apache-2.0
#include "model/borders.hpp"

#include <algorithm>
#include <utility>

namespace cama {
namespace {

std::array<int, 2> ascending(int a, int b) { return {std::min(a, b), std::max(a, b)}; }

}  // namespace

Borders::Borders(const std::vector<kernels::face_nodes> &faces, int vertices)
    : face(faces.size(), kernels::face_border{{-1, -1, -1}, 0})
{
  for (std::size_t f = 0; f < faces.size(); ++f)
    for (int k = 0; k < 3; ++k) {
      const int a = faces[f].node[(k + 1) % 3], b = faces[f].node[(k + 2) % 3], beside = faces[f].node[k];
      if (a != b && b != beside && a != beside) sides_.push_back({ascending(a, b), static_cast<int>(f), k, beside});
    }
  std::stable_sort(sides_.begin(), sides_.end(), [](const Side &a, const Side &b) { return a.edge < b.edge; });
  share_edges();
  share_corners(faces, vertices);
}

/// The first face of an edge owns it. Of three or more, each has the next beyond the edge.
void Borders::share_edges()
{
  for (std::size_t first = 0, last; first < sides_.size(); first = last) {
    for (last = first; last < sides_.size() && sides_[last].edge == sides_[first].edge;) ++last;
    face[sides_[first].face].owned |= 1 << sides_[first].corner;
    if (last - first < 2) continue;
    for (std::size_t k = first; k < last; ++k)
      face[sides_[k].face].across[sides_[k].corner] = sides_[k + 1 < last ? k + 1 : first].beside;
  }
}

/// The first face of a corner owns it. A corner is on the rim if it ends an edge of one face.
void Borders::share_corners(const std::vector<kernels::face_nodes> &faces, int vertices)
{
  std::vector<char> rim(vertices, 0), owned(vertices, 0);
  neighbours.start.assign(vertices + 1, 0);
  std::vector<std::array<int, 2>> along;
  for (const Side &side : sides_) {
    if (face[side.face].across[side.corner] < 0)
      for (int v : side.edge) rim[v] = 1;
    along.push_back(side.edge);
    along.push_back({side.edge[1], side.edge[0]});
  }
  std::sort(along.begin(), along.end());
  along.erase(std::unique(along.begin(), along.end()), along.end());
  for (const auto &[vertex, neighbour] : along) {
    ++neighbours.start[vertex + 1];
    neighbours.value.push_back(neighbour);
  }
  for (int v = 0; v < vertices; ++v) neighbours.start[v + 1] += neighbours.start[v];
  for (std::size_t f = 0; f < faces.size(); ++f)
    for (int k = 0; k < 3; ++k) {
      const int v = faces[f].node[k];
      if (!std::exchange(owned[v], 1)) face[f].owned |= 1 << (3 + k);
      if (rim[v]) face[f].owned |= 1 << (6 + k);
    }
}

std::vector<kernels::edge_nodes> Borders::wings_of(const std::vector<kernels::edge_nodes> &edges) const
{
  std::vector<kernels::edge_nodes> wings;
  for (const kernels::edge_nodes &e : edges) {
    const std::array<int, 2> key = ascending(e.node[0], e.node[1]);
    auto side =
        std::lower_bound(sides_.begin(), sides_.end(), key, [](const Side &a, const auto &k) { return a.edge < k; });
    kernels::edge_nodes w{{-1, -1}};
    for (int k = 0; k < 2 && side != sides_.end() && side->edge == key; ++k, ++side) w.node[k] = side->beside;
    wings.push_back(w);
  }
  return wings;
}

}  // namespace cama
