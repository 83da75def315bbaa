// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "cama/scene.hpp"
#include "cama/stream.hpp"
#include "device/kernels.hpp"

namespace cama {

/// Cloth vertices that follow the surfaces of obstacles. Vertices are numbered through all cloths, then all obstacles.
class Attachments {
public:
  struct Attached {
    kernels::attachment row;
    double release;  // s
    bool driven;  // not of the scene
  };

  /// obstacles, first: those of the scene and their first vertices, which must outlive this.
  Attachments(Backend &backend, const std::vector<Obstacle> &obstacles, const std::vector<int> &first);
  Attachments(const Attachments &) = delete;
  Attachments &operator=(const Attachments &) = delete;

  /// Attaches a cloth vertex to where it is beside an obstacle, or beside a triangle that is given with its foot point.
  /// position: of all vertices.
  void add(int vertex, int obstacle, const std::vector<dvec3> &position, double release, bool driven);
  void add(kernels::attachment foot, const std::vector<dvec3> &position, double release, bool driven);
  void upload();
  /// Moves the vertices to where the obstacles' vertices, which are in `position`, take them.
  void move(Backend &backend, Stream<dvec3> &position) const;
  std::vector<int> of(int obstacle) const;  ///< cloth vertices that are attached to an obstacle

  std::vector<Attached> list;
  Stream<kernels::attachment> rows;  // of the list, after upload()

private:
  int cloth_vertices() const { return first_.front(); }  // there is an obstacle, or nothing is attached
  /// The faces around the vertices of obstacles, as surface_frame takes them.
  void find_faces();

  const std::vector<Obstacle> &obstacles_;
  const std::vector<int> &first_;
  std::vector<int> faces_row_, faces_of_;  // empty until something is attached
  Stream<int> faces_row_stream_, faces_of_stream_;
};

}  // namespace cama
