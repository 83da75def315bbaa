// SPDX-License-Identifier: Apache-2.0
#include "cama/geometry.hpp"
#include "cama/intersections.hpp"

#include "bindings.hpp"

namespace cama::python {
namespace {

static_assert(sizeof(Quad) == 12 * sizeof(double));

const Quad *rows(const Doubles &array) { return reinterpret_cast<const Quad *>(array.data()); }

/// Applies one query to every row of [n, 4, 3] arrays; returns hit [n], time [n].
template <class Query> py::tuple ccd(const Doubles &start, const Doubles &end, Query &&query)
{
  const py::ssize_t n = start.shape(0);
  py::array_t<bool> hit(n);
  py::array_t<double> time(n);
  bool *h = hit.mutable_data();
  double *t = time.mutable_data();
  const Quad *a = rows(start), *b = rows(end);
  {
    py::gil_scoped_release release;
#pragma omp parallel for schedule(dynamic, 256)
    for (py::ssize_t i = 0; i < n; ++i) {
      const Ccd r = query(a[i], b[i]);
      h[i] = r.hit;
      t[i] = r.hit ? r.time : 1.0;
    }
  }
  return py::make_tuple(hit, time);
}

/// Returns distance [n], weights [n, 4].
py::tuple distance(const Doubles &points, Distance (*query)(const Quad &))
{
  const py::ssize_t n = points.shape(0);
  py::array_t<double> distance(n), weight(std::vector<py::ssize_t>{n, 4});
  double *d = distance.mutable_data(), *w = weight.mutable_data();
  const Quad *x = rows(points);
  {
    py::gil_scoped_release release;
#pragma omp parallel for
    for (py::ssize_t i = 0; i < n; ++i) {
      const Distance r = query(x[i]);
      d[i] = r.distance;
      for (int k = 0; k < 4; ++k) w[4 * i + k] = r.weight[static_cast<std::size_t>(k)];
    }
  }
  return py::make_tuple(distance, weight);
}

/// (first, second, first name, second name, rows [k, 5] of edge object, edge, face object, face; places [k, 3]) per
/// pair of objects.
py::list to_list(const std::vector<ObjectIntersections> &found)
{
  py::list pairs;
  for (const ObjectIntersections &pair : found) {
    std::vector<std::array<int, 5>> row;
    std::vector<dvec3> place;
    for (const Piercing &p : pair.piercings) {
      row.push_back({p.edge_object, p.edge[0], p.edge[1], p.face_object, p.face});
      place.push_back(p.place);
    }
    pairs.append(py::make_tuple(pair.first, pair.second, pair.first_name, pair.second_name,
                                to_array<int>(std::move(row)), to_array<double>(std::move(place))));
  }
  return pairs;
}

}  // namespace

py::dict to_dict(const UntangleReport &r)
{
  py::dict d;
  d["clean"] = r.clean;
  d["before"] = r.before;
  d["after"] = r.after;
  d["rounds"] = r.rounds;
  d["moved"] = r.moved;
  d["largest_move"] = r.largest_move;
  d["smallest_gap"] = r.smallest_gap;
  return d;
}

void bind_geometry(py::module_ &m)
{
  m.def("vertex_face_ccd", [](const Doubles &start, const Doubles &end, double minimum_distance) {
    return ccd(start, end, [=](const Quad &a, const Quad &b) { return vertex_face_ccd(a, b, minimum_distance); });
  });
  m.def("edge_edge_ccd", [](const Doubles &start, const Doubles &end, double minimum_distance) {
    return ccd(start, end, [=](const Quad &a, const Quad &b) { return edge_edge_ccd(a, b, minimum_distance); });
  });
  m.def("vertex_face_ccd_cubic",
        [](const Doubles &start, const Doubles &end) { return ccd(start, end, vertex_face_ccd_cubic); });
  m.def("edge_edge_ccd_cubic",
        [](const Doubles &start, const Doubles &end) { return ccd(start, end, edge_edge_ccd_cubic); });
  m.def("vertex_face_distance", [](const Doubles &points) { return distance(points, vertex_face_distance); });
  m.def("edge_edge_distance", [](const Doubles &points) { return distance(points, edge_edge_distance); });
  m.def("intersections", [](const Doubles &vertices, const Ints &faces, int first_obstacle_vertex) {
    const auto position = to_vector<dvec3>(vertices);
    const auto face = to_vector<Triangle>(faces);
    std::vector<Intersection> found;
    {
      py::gil_scoped_release release;
      found = intersections(position, face, first_obstacle_vertex);
    }
    return to_array<int>(std::move(found));
  });
  m.def("start_intersections", [](const Scene &scene) {
    std::vector<ObjectIntersections> found;
    {
      py::gil_scoped_release release;
      found = start_intersections(scene);
    }
    return to_list(found);
  });
  m.def("save_intersections", [](const std::filesystem::path &file, const Scene &scene) {
    py::gil_scoped_release release;
    save_intersections(file, scene, start_intersections(scene));
  });
  m.def("untangle", [](Scene &scene, int max_rounds, double gap) {
    UntangleReport report;
    {
      py::gil_scoped_release release;
      report = untangle(scene, UntangleOptions{max_rounds, gap});
    }
    return to_dict(report);
  });
}

}  // namespace cama::python
