// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <set>

#include "cama/error.hpp"
#include "device/kernels.hpp"
#include "model/exemptions.hpp"
#include "start/start_check.hpp"

namespace cama {
namespace {

using namespace kernels;

std::string name_of(const Scene &scene, int object)
{
  const std::size_t o = static_cast<std::size_t>(object), cloths = scene.cloths.size();
  return o < cloths ? "cloth '" + scene.cloths[o].name + "'" : "obstacle '" + scene.obstacles[o - cloths].name + "'";
}

/// First vertex and first face of every object.
struct Starts {
  std::vector<int> vertex, face;
};

Starts starts(const Scene &scene)
{
  Starts s{{0}, {0}};
  const auto add = [&](const Mesh &m) {
    s.vertex.push_back(s.vertex.back() + static_cast<int>(m.position.size()));
    s.face.push_back(s.face.back() + static_cast<int>(m.face.size()));
  };
  for (const Cloth &c : scene.cloths) add(c.mesh);
  for (const Obstacle &o : scene.obstacles) add(o.mesh);
  return s;
}

/// Where the line through p and q meets the plane of a, b, c, clamped to the segment p q.
dvec3 meeting_point(dvec3 p, dvec3 q, dvec3 a, dvec3 b, dvec3 c)
{
  const dvec3 n = dcross(dsub(b, a), dsub(c, a));
  const double from = ddot(n, dsub(a, p)), along = ddot(n, dsub(q, p));
  const double t = std::abs(along) > 0 ? std::clamp(from / along, 0.0, 1.0) : 0.5;
  return dlerp(p, q, t);
}

constexpr unsigned char colours[8][3] = {{228, 26, 28}, {55, 126, 184},  {77, 175, 74}, {152, 78, 163},
                                         {255, 127, 0}, {247, 129, 191}, {166, 86, 40}, {153, 153, 153}};

/// Faces of one pair of objects to be written, in the numbering of all faces.
std::set<int> intersecting_faces(const Topology &t, const Starts &start, const ObjectIntersections &pair)
{
  std::set<std::array<int, 2>> edges;
  std::set<int> faces;
  for (const Piercing &p : pair.piercings) {
    const int first = start.vertex[p.edge_object];
    edges.insert({first + p.edge[0], first + p.edge[1]});
    faces.insert(start.face[p.face_object] + p.face);
  }
  for (const int object : {pair.first, pair.second})
    for (int f = start.face[object]; f < start.face[object + 1]; ++f)
      for (int k = 0; k < 3; ++k) {
        const int a = t.face[f][k], b = t.face[f][(k + 1) % 3];
        if (edges.count({std::min(a, b), std::max(a, b)})) faces.insert(f);
      }
  return faces;
}

std::string group_name(const ObjectIntersections &pair)
{
  std::string name = pair.first_name + "_with_" + pair.second_name;
  for (char &c : name)
    if (c == ' ' || c == '\'') c = '_';
  return name;
}

/// Vertices and faces of all groups, with vertices renumbered.
struct Groups {
  std::vector<dvec3> vertex;
  std::vector<std::vector<Triangle>> face;
};

Groups collect(const Scene &scene, const std::vector<ObjectIntersections> &found)
{
  const Topology t = build_topology(scene);
  const Starts start = starts(scene);
  Groups g;
  std::map<int, int> number;
  for (const ObjectIntersections &pair : found) {
    g.face.emplace_back();
    for (int f : intersecting_faces(t, start, pair)) {
      Triangle own{};
      for (int k = 0; k < 3; ++k) {
        const auto [at, fresh] = number.emplace(t.face[f][k], static_cast<int>(g.vertex.size()));
        if (fresh) g.vertex.push_back(t.position[t.face[f][k]]);
        own[k] = at->second;
      }
      g.face.back().push_back(own);
    }
  }
  return g;
}

void write_obj(std::ostream &out, const Groups &g, const std::vector<ObjectIntersections> &found)
{
  for (const dvec3 &x : g.vertex) out << "v " << x.x << ' ' << x.y << ' ' << x.z << '\n';
  for (std::size_t k = 0; k < found.size(); ++k) {
    out << "g " << group_name(found[k]) << '\n';
    for (const Triangle &f : g.face[k]) out << "f " << f[0] + 1 << ' ' << f[1] + 1 << ' ' << f[2] + 1 << '\n';
  }
}

void write_ply(std::ostream &out, const Groups &g, const std::vector<ObjectIntersections> &found)
{
  std::size_t faces = 0;
  for (const auto &group : g.face) faces += group.size();
  out << "ply\nformat ascii 1.0\n";
  for (std::size_t k = 0; k < found.size(); ++k) {
    const auto &c = colours[k % 8];
    out << "comment colour " << int(c[0]) << ' ' << int(c[1]) << ' ' << int(c[2]) << ": " << found[k].first_name
        << " with " << found[k].second_name << '\n';
  }
  out << "element vertex " << g.vertex.size()
      << "\nproperty double x\nproperty double y\nproperty double z\nelement face " << faces
      << "\nproperty list uchar int vertex_indices\nproperty uchar red\nproperty uchar green\nproperty uchar "
         "blue\nend_header\n";
  for (const dvec3 &x : g.vertex) out << x.x << ' ' << x.y << ' ' << x.z << '\n';
  for (std::size_t k = 0; k < g.face.size(); ++k)
    for (const Triangle &f : g.face[k]) {
      const auto &c = colours[k % 8];
      out << "3 " << f[0] << ' ' << f[1] << ' ' << f[2] << ' ' << int(c[0]) << ' ' << int(c[1]) << ' ' << int(c[2])
          << '\n';
    }
}

}  // namespace

std::vector<Intersection> forbidden_intersections(const std::vector<dvec3> &position, const Topology &t, bool self)
{
  std::vector<Intersection> found = intersections(position, t.face, t.cloth_vertices);
  const auto allowed = [&](const Intersection &i) {
    return (!self && i.edge[0] < t.cloth_vertices && t.face[i.face][0] < t.cloth_vertices) || at_seam(t, i);
  };
  found.erase(std::remove_if(found.begin(), found.end(), allowed), found.end());
  return found;
}

std::vector<ObjectIntersections> by_objects(const Scene &scene, const Topology &t, const std::vector<dvec3> &x)
{
  const Starts start = starts(scene);
  std::map<std::pair<int, int>, ObjectIntersections> pairs;
  for (const Intersection &i : forbidden_intersections(x, t, scene.contact.self)) {
    const Triangle &f = t.face[i.face];
    Piercing p;
    p.edge_object = t.object[i.edge[0]];
    p.face_object = t.object[f[0]];
    p.edge = {i.edge[0] - start.vertex[p.edge_object], i.edge[1] - start.vertex[p.edge_object]};
    p.face = i.face - start.face[p.face_object];
    p.place = meeting_point(x[i.edge[0]], x[i.edge[1]], x[f[0]], x[f[1]], x[f[2]]);
    pairs[std::minmax({p.edge_object, p.face_object})].piercings.push_back(p);
  }
  std::vector<ObjectIntersections> found;
  for (auto &[objects, pair] : pairs) {
    pair.first = objects.first;
    pair.second = objects.second;
    pair.first_name = name_of(scene, pair.first);
    pair.second_name = name_of(scene, pair.second);
    pair.lower = pair.upper = pair.piercings.front().place;
    dvec3 sum{0, 0, 0};
    for (const Piercing &p : pair.piercings) {
      sum = dadd(sum, p.place);
      pair.lower = dvec3_min(pair.lower, p.place);
      pair.upper = dvec3_max(pair.upper, p.place);
    }
    pair.mean = dscale(1.0 / static_cast<double>(pair.piercings.size()), sum);
    found.push_back(std::move(pair));
  }
  return found;
}

std::vector<ObjectIntersections> start_intersections(const Scene &scene)
{
  scene.validate();
  const Topology t = build_topology(scene);
  return by_objects(scene, t, t.position);
}

void save_intersections(const std::filesystem::path &file, const Scene &scene,
                        const std::vector<ObjectIntersections> &found)
{
  const std::string suffix = file.extension().string();
  if (suffix != ".obj" && suffix != ".ply")
    throw FileError(file.string() + ": '" + suffix + "' is not a supported format; use .obj or .ply");
  std::ofstream out(file);
  out.precision(17);
  const Groups groups = collect(scene, found);
  if (suffix == ".obj")
    write_obj(out, groups, found);
  else
    write_ply(out, groups, found);
  out.flush();
  if (!out) throw FileError(file.string() + ": cannot be written");
}

std::string describe(const std::vector<ObjectIntersections> &found)
{
  constexpr std::size_t most = 4;
  std::string text;
  for (std::size_t k = 0; k < std::min(found.size(), most); ++k) {
    const ObjectIntersections &pair = found[k];
    const Piercing &p = pair.piercings.front();
    const std::string &edge_name = p.edge_object == pair.first ? pair.first_name : pair.second_name;
    const std::string &face_name = p.face_object == pair.first ? pair.first_name : pair.second_name;
    char place[80];
    std::snprintf(place, sizeof place, "(%.4g, %.4g, %.4g)", p.place.x, p.place.y, p.place.z);
    text += (text.empty() ? "" : "; ") + std::to_string(pair.piercings.size()) + " of " + pair.first_name +
            (pair.first == pair.second ? " with itself" : " with " + pair.second_name) + ", the first: edge " +
            std::to_string(p.edge[0]) + "-" + std::to_string(p.edge[1]) + " of " + edge_name + " and face " +
            std::to_string(p.face) + " of " + face_name + " at " + place;
  }
  if (found.size() > most) text += "; and " + std::to_string(found.size() - most) + " more pairs of objects";
  return text;
}

}  // namespace cama
