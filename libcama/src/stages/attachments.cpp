// SPDX-License-Identifier: Apache-2.0
#include "stages/attachments.hpp"

#include <limits>

#include "device/launch.hpp"

namespace cama {

Attachments::Attachments(Backend &backend, const std::vector<Obstacle> &obstacles, const std::vector<int> &first)
    : rows(backend), obstacles_(obstacles), first_(first), faces_row_stream_(backend), faces_of_stream_(backend)
{}

void Attachments::find_faces()
{
  if (!faces_row_.empty()) return;
  std::size_t vertices = 0;
  for (const Obstacle &o : obstacles_) vertices += o.mesh.position.size();
  std::vector<std::vector<int>> around(vertices);
  for (std::size_t o = 0; o < obstacles_.size(); ++o)
    for (const Triangle &f : obstacles_[o].mesh.face)
      for (int k = 0; k < 3; ++k)
        for (int next : {f[(k + 1) % 3], f[(k + 2) % 3]})
          around[static_cast<std::size_t>(first_[o] - cloth_vertices() + f[k])].push_back(first_[o] + next);
  std::vector<int> row{0}, of;
  for (const std::vector<int> &faces : around) {
    of.insert(of.end(), faces.begin(), faces.end());
    row.push_back(static_cast<int>(of.size() / 2));
  }
  faces_row_.swap(row);
  faces_of_.swap(of);
}

void Attachments::add(kernels::attachment foot, const std::vector<dvec3> &position, double release, bool driven)
{
  using namespace kernels;
  find_faces();
  dvec3 off = position[foot.vertex];
  for (int j = 0; j < 3; ++j) off = daxpy(off, -foot.weight[j], position[foot.node[j]]);
  for (int j = 0; j < 3; ++j) {
    dvec3 axis[3];
    surface_frame(foot.node[j], cloth_vertices(), faces_row_.data(), faces_of_.data(), position.data(), axis);
    for (int k = 0; k < 3; ++k) foot.offset[3 * j + k] = ddot(off, axis[k]);
  }
  list.push_back({foot, release, driven});
}

void Attachments::add(int vertex, int obstacle, const std::vector<dvec3> &position, double release, bool driven)
{
  kernels::attachment best{};
  best.vertex = vertex;
  double smallest = std::numeric_limits<double>::infinity();
  const int first = first_[obstacle];
  for (const Triangle &f : obstacles_[static_cast<std::size_t>(obstacle)].mesh.face) {
    const kernels::proximity p = kernels::vertex_face_proximity(position[vertex], position[first + f[0]],
                                                                position[first + f[1]], position[first + f[2]]);
    if (p.distance >= smallest) continue;
    smallest = p.distance;
    for (int k = 0; k < 3; ++k) {
      best.node[k] = first + f[k];
      best.weight[k] = -p.weight[k + 1];
    }
  }
  add(best, position, release, driven);
}

void Attachments::upload()
{
  std::vector<kernels::attachment> values;
  for (const Attached &a : list) values.push_back(a.row);
  if (!values.empty() && faces_row_stream_.size() == 0) {
    faces_of_stream_.assign(faces_of_);
    faces_row_stream_.assign(faces_row_);   // last: it says that both are there
  }
  if (!values.empty() || rows.size()) rows.assign(values);
}

void Attachments::move(Backend &backend, Stream<dvec3> &position) const
{
  if (rows.size())
    CAMA_LAUNCH(backend, move_attached, rows.size(), cloth_vertices(), rows, faces_row_stream_, faces_of_stream_,
                position);
}

std::vector<int> Attachments::of(int obstacle) const
{
  const auto o = static_cast<std::size_t>(obstacle);
  const int first = first_[o], last = first + static_cast<int>(obstacles_[o].mesh.position.size());
  std::vector<int> vertices;
  for (const Attached &a : list)
    if (a.row.node[0] >= first && a.row.node[0] < last) vertices.push_back(a.row.vertex);
  return vertices;
}

}  // namespace cama
