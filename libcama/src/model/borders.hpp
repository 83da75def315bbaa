// SPDX-License-Identifier: Apache-2.0
// What meets at the edges and corners of faces, for contacts there.
#pragma once
#include <array>
#include <vector>

#include "device/kernels.hpp"
#include "model/surface.hpp"

namespace cama {

/// Faces with the features that they share, numbered over all objects. Faces without area have no part in it.
class Borders {
public:
  Borders(const std::vector<kernels::face_nodes> &faces, int vertices);
  /// The vertices beside each edge in the first two of its faces; -1 where there is none.
  std::vector<kernels::edge_nodes> wings_of(const std::vector<kernels::edge_nodes> &edges) const;

  std::vector<kernels::face_border> face;
  Rows neighbours;  ///< of each vertex, along the edges of its faces, ascending

private:
  /// An edge of a face, opposite a corner.
  struct Side {
    std::array<int, 2> edge;
    int face, corner, beside;
  };
  void share_edges();
  void share_corners(const std::vector<kernels::face_nodes> &faces, int vertices);

  std::vector<Side> sides_;  // by edge, then by face
};

}  // namespace cama
