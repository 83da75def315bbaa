// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <set>
#include <vector>

#include "cama/error.hpp"
#include "cama/scene.hpp"
#include "scene/rigid.hpp"
#include "scene/shapes/exact_obstacle.hpp"

namespace cama {
namespace {

bool finite(const dvec3 &v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

void require(bool good, const std::string &field, const std::string &value, const std::string &advice)
{
  if (!good) throw SceneError(field + ": is " + value + "; " + advice);
}
void require(bool good, const std::string &field, double value, const std::string &advice)
{
  require(good, field, std::to_string(value), advice);
}

void check_motion(const std::string &field, const Motion &m, std::size_t vertices)
{
  require(finite(m.velocity) && finite(m.rotation_rate) && finite(m.oscillation) && finite(m.center), field,
          "not finite", "give finite velocity, rotation_rate, oscillation and center");
  require(std::isfinite(m.period) && m.period > 0, field + ".oscillation.period", m.period,
          "give seconds, greater than 0");
  require(!std::isnan(m.start) && !std::isnan(m.stop), field + ".start", "not a number", "give seconds");
  for (std::size_t k = 0; k < m.keys.size(); ++k) {
    const std::string key = field + ".keys[" + std::to_string(k) + "]";
    const RigidTransform &t = m.keys[k].transform;
    const auto &q = t.rotation;
    require(std::isfinite(m.keys[k].time) && (k == 0 || m.keys[k].time > m.keys[k - 1].time), key + ".time",
            m.keys[k].time, "times must be finite and increase");
    require(finite(t.translation) && finite(t.center) && std::isfinite(t.scale) && t.scale > 0, key, "not a placement",
            "give finite numbers and a scale greater than 0");
    require(std::abs(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1) < 1e-5, key + ".quaternion",
            "not of length 1", "give a unit quaternion (w, x, y, z)");
  }
  if (!m.sampled) return;
  const auto &s = *m.sampled;
  require(!s.time.empty() && s.time.size() == s.position.size(), field + ".sampled",
          std::to_string(s.time.size()) + " times and " + std::to_string(s.position.size()) + " frames",
          "give one frame for each time, at least one");
  for (std::size_t i = 0; i < s.time.size(); ++i) {
    const std::string frame = field + ".sampled.position[" + std::to_string(i) + "]";
    require(std::isfinite(s.time[i]) && (i == 0 || s.time[i] > s.time[i - 1]),
            field + ".sampled.time[" + std::to_string(i) + "]", s.time[i], "times must be finite and increase");
    require(s.position[i].size() == vertices, frame, std::to_string(s.position[i].size()) + " vertices",
            "the mesh has " + std::to_string(vertices));
    for (std::size_t v = 0; v < s.position[i].size(); ++v)
      if (!finite(s.position[i][v]))
        throw SceneError(frame + ", vertex " + std::to_string(v) + ": is not finite; give finite coordinates");
  }
}

/// `friction`: the corresponding coefficient of sliding.
void check_static_friction(const std::string &field, double value, double friction)
{
  require(value == -1 || (std::isfinite(value) && value >= friction), field, value,
          "give a Coulomb coefficient not below that of sliding (" + std::to_string(friction) +
              "), or leave it out for the same");
}

void check_settings(const Scene &s)
{
  require(std::isfinite(s.time_step) && s.time_step >= 0, "time_step", s.time_step,
          "give seconds, for example 0.005, or 0 for the accuracy level's");
  require(std::isfinite(s.frame_time) && s.frame_time >= 0, "frame_time", s.frame_time,
          "give seconds, or 0 for one frame per time_step");
  require(s.frames >= 0, "frames", s.frames, "give 0 or more");
  require(finite(s.gravity), "gravity", "not finite", "give three finite numbers, m/s^2");
  require(std::isfinite(s.contact.thickness) && s.contact.thickness > 0, "contact.thickness", s.contact.thickness,
          "give metres, greater than 0");
  require(std::isfinite(s.contact.stiffness) && s.contact.stiffness > 0, "contact.stiffness", s.contact.stiffness,
          "give N/m^3, greater than 0");
  require(std::isfinite(s.contact.friction) && s.contact.friction >= 0, "contact.friction", s.contact.friction,
          "give a Coulomb coefficient, 0 or more");
  check_static_friction("contact.static_friction", s.contact.static_friction, s.contact.friction);
  if (!s.wind) return;
  require(finite(s.wind->velocity), "wind.velocity", "not finite", "give three finite numbers, m/s");
  require(std::isfinite(s.wind->density) && s.wind->density >= 0, "wind.density", s.wind->density,
          "give kg/m^3, 0 or more");
  require(std::isfinite(s.wind->drag) && s.wind->drag >= 0, "wind.drag", s.wind->drag, "give 0 or more");
}

void check_pin(const Scene &s, std::size_t i)
{
  const Pin &p = s.pins[i];
  const std::string field = "pins[" + std::to_string(i) + "]";
  require(p.cloth >= 0 && p.cloth < static_cast<int>(s.cloths.size()), field + ".cloth", std::to_string(p.cloth),
          "there are " + std::to_string(s.cloths.size()) + " cloths, counted from 0");
  const Cloth &c = s.cloths[p.cloth];
  require(!p.vertices.empty(), field + ".vertices", "empty", "name at least one vertex, or leave the pin out");
  for (std::size_t k = 0; k < p.vertices.size(); ++k)
    require(p.vertices[k] >= 0 && p.vertices[k] < static_cast<int>(c.mesh.position.size()),
            field + ".vertices[" + std::to_string(k) + "]", std::to_string(p.vertices[k]),
            "cloth \"" + c.name + "\" has " + std::to_string(c.mesh.position.size()) + " vertices, counted from 0");
  if (p.obstacle)
    require(*p.obstacle >= 0 && *p.obstacle < static_cast<int>(s.obstacles.size()), field + ".attach",
            std::to_string(*p.obstacle),
            "there are " + std::to_string(s.obstacles.size()) + " obstacles, counted from 0");
  if (p.obstacle && s.obstacles[*p.obstacle].mesh.face.empty())
    throw SceneError(field + ".attach: obstacle \"" + s.obstacles[*p.obstacle].name +
                     "\" has no mesh to follow; use a meshed one");
  require(!std::isnan(p.release), field + ".release", "not a number", "give seconds, or leave it out");
  require(!p.motion.sampled, field + ".motion", "vertex animation", "pins move rigidly");
  check_motion(field + ".motion", p.motion, 0);
}

/// Checks that each vertex belongs to one pin only.
void check_pins_disjoint(const Scene &s)
{
  std::vector<std::pair<std::array<int, 2>, std::size_t>> held;
  for (std::size_t i = 0; i < s.pins.size(); ++i)
    for (int v : s.pins[i].vertices) held.push_back({{s.pins[i].cloth, v}, i});
  std::sort(held.begin(), held.end());
  for (std::size_t k = 1; k < held.size(); ++k)
    require(held[k].first != held[k - 1].first || held[k].second == held[k - 1].second,
            "pins[" + std::to_string(held[k].second) + "].vertices", std::to_string(held[k].first[1]),
            "pins[" + std::to_string(held[k - 1].second) + "] holds this vertex already; leave it to one of them");
}

void check_stitch(const Scene &s, std::size_t i)
{
  const Stitch &t = s.stitches[i];
  const std::string field = "stitches[" + std::to_string(i) + "]";
  const auto vertex = [&](int cloth, int v, const char *end) {
    require(cloth >= 0 && cloth < static_cast<int>(s.cloths.size()), field + "." + end + ".cloth",
            std::to_string(cloth), "there are " + std::to_string(s.cloths.size()) + " cloths, counted from 0");
    const auto count = s.cloths[cloth].mesh.position.size();
    require(v >= 0 && static_cast<std::size_t>(v) < count, field + "." + end + ".vertex", std::to_string(v),
            "cloth \"" + s.cloths[cloth].name + "\" has " + std::to_string(count) + " vertices, counted from 0");
  };
  vertex(t.cloth_a, t.vertex_a, "a");
  vertex(t.cloth_b, t.vertex_b, "b");
  vertex(t.cloth_b, t.vertex_c, "b");
  require(t.ratio >= 0 && t.ratio <= 1, field + ".b.ratio", t.ratio, "give a number from 0 to 1");
  require(std::isfinite(t.stiffness) && t.stiffness > 0, field + ".stiffness", t.stiffness, "give N/m, greater than 0");
  require(std::isfinite(t.length) && t.length >= 0, field + ".length", t.length, "give metres, 0 or more");
  require(!(t.cloth_a == t.cloth_b && (t.vertex_a == t.vertex_b || t.vertex_a == t.vertex_c)), field,
          "a stitch of vertex " + std::to_string(t.vertex_a) + " to itself", "remove it");
}

/// Each edge of a closed cloth is between two faces, which pass along it in opposite directions.
void check_closed(const std::string &object, const Cloth &c)
{
  std::vector<std::array<int, 3>> sides;  // lower and higher vertex, 1: the face passes from the lower to the higher
  for (const Triangle &f : c.mesh.face)
    for (int k = 0; k < 3; ++k) {
      const int a = f[k], b = f[(k + 1) % 3];
      sides.push_back({std::min(a, b), std::max(a, b), a < b});
    }
  std::sort(sides.begin(), sides.end());
  for (std::size_t i = 0; i < sides.size();) {
    std::size_t end = i;
    int turn = 0;
    for (; end < sides.size() && sides[end][0] == sides[i][0] && sides[end][1] == sides[i][1]; ++end)
      turn += sides[end][2] ? 1 : -1;
    const std::string edge =
        "edge between vertices " + std::to_string(sides[i][0]) + " and " + std::to_string(sides[i][1]);
    require(end - i != 1, object + ": gas", "in an open mesh, with a border at the " + edge,
            "close the mesh, or weld vertices that coincide");
    require(end - i == 2, object + ": gas", "in a mesh with " + std::to_string(end - i) + " faces at the " + edge,
            "leave two faces there");
    require(turn == 0, object + ": gas", "in a mesh whose faces at the " + edge + " have opposite sides outside",
            "turn one of them");
    i = end;
  }
}

void check_gas(const std::string &object, const Cloth &c)
{
  const Gas &g = *c.gas;
  require(c.pressure == 0, object + ": pressure", c.pressure, "the gas has its own; leave one of the two out");
  require(std::isfinite(g.ambient) && g.ambient >= 0, object + ": gas.ambient", g.ambient, "give Pa, 0 or more");
  require(std::isfinite(g.pressure) && g.ambient + g.pressure > 0, object + ": gas.pressure", g.pressure,
          "give Pa above the ambient pressure of " + std::to_string(g.ambient) + "; the sum must be above 0");
  require(std::isfinite(g.volume) && g.volume >= 0, object + ": gas.volume", g.volume,
          "give m^3, or 0 for what the mesh encloses");
  check_closed(object, c);
  const double volume = c.enclosed_volume(), flat = 1e-9 * g.volume;  // what rounding leaves of a flat mesh
  require(volume >= -flat, object + ": gas", "in a mesh whose faces point inwards", "reverse the faces");
  require(volume > 0 || g.volume > 0, object + ": gas", "in a mesh that encloses no volume",
          "give gas.volume, at which the gas has its pressure, m^3");
}

/// Number of faces at each edge of a cloth, by its lower and its higher vertex.
using EdgeFaces = std::map<std::array<int, 2>, int>;

EdgeFaces edge_faces(const Mesh &mesh)
{
  EdgeFaces faces;
  for (const Triangle &f : mesh.face)
    for (int k = 0; k < 3; ++k) ++faces[{std::min(f[k], f[(k + 1) % 3]), std::max(f[k], f[(k + 1) % 3])}];
  return faces;
}

void check_crease(const std::string &field, const Crease &crease, const Cloth &c, const EdgeFaces &faces)
{
  require(std::abs(crease.angle) < 180, field + ".angle", crease.angle, "give degrees between -180 and 180");
  require(crease.vertices.size() >= 2, field + ".vertices", std::to_string(crease.vertices.size()) + " vertices",
          "give two or more in order along the line");
  require(c.material.has_bending(), field, "on a cloth without bending stiffness",
          "give the material of cloth \"" + c.name + "\" one");
  for (std::size_t k = 0; k < crease.vertices.size(); ++k)
    require(crease.vertices[k] >= 0 && crease.vertices[k] < static_cast<int>(c.mesh.position.size()),
            field + ".vertices[" + std::to_string(k) + "]", std::to_string(crease.vertices[k]),
            "cloth \"" + c.name + "\" has " + std::to_string(c.mesh.position.size()) + " vertices, counted from 0");
  for (std::size_t k = 1; k < crease.vertices.size(); ++k) {
    const int a = crease.vertices[k - 1], b = crease.vertices[k];
    const auto edge = faces.find({std::min(a, b), std::max(a, b)});
    const std::string place = field + ": the pair of vertices " + std::to_string(a) + " and " + std::to_string(b);
    require(edge != faces.end(), place, "not joined by an edge",
            "name all vertices along edges of cloth \"" + c.name + "\", in order");
    require(edge->second >= 2, place, "at the border of cloth \"" + c.name + "\"",
            "a crease needs a face on both sides");
  }
}

void check_creases(const Scene &s)
{
  std::map<int, EdgeFaces> faces;  // of cloths with creases
  for (std::size_t i = 0; i < s.creases.size(); ++i) {
    const int cloth = s.creases[i].cloth;
    const std::string field = "creases[" + std::to_string(i) + "]";
    require(cloth >= 0 && cloth < static_cast<int>(s.cloths.size()), field + ".cloth", std::to_string(cloth),
            "there are " + std::to_string(s.cloths.size()) + " cloths, counted from 0");
    const Cloth &c = s.cloths[static_cast<std::size_t>(cloth)];
    if (!faces.count(cloth)) faces[cloth] = edge_faces(c.mesh);
    check_crease(field, s.creases[i], c, faces[cloth]);
  }
}

void check_shrinkage(const std::string &object, const Cloth &c)
{
  const std::size_t triangles = c.mesh.face.size();
  require(c.shrinkage.size() <= 1 || c.shrinkage.size() == triangles, object + ": shrinkage",
          std::to_string(c.shrinkage.size()) + " pairs",
          "give one for warp and weft, or one for each of the " + std::to_string(triangles) + " triangles");
  for (std::size_t i = 0; i < c.shrinkage.size(); ++i)
    for (const double share : c.shrinkage[i])
      require(share >= -1 && share <= 0.9, object + ": shrinkage[" + std::to_string(i) + "]", share,
              "give a share from -1 (twice as long) to 0.9");
}

/// Rejects a cloth whose rest shape is the start at another scale, as happens with texture coordinates in other units
/// or of an image: it would snap to that size. Cloth that starts crumpled, sheared or collapsed is not stretched
/// uniformly everywhere, nor by factors that units explain.
void check_material_scale(const std::string &object, const Cloth &cloth)
{
  const Mesh &m = cloth.mesh;
  constexpr double least = 3, most = 1e5, same = 0.1, share = 0.9;
  if (m.material_face.empty()) return;
  std::vector<double> large, small;  // principal stretches of each face, from the rest shape to the start
  for (std::size_t f = 0; f < m.face.size(); ++f) {
    const Triangle &t = m.face[f], &u = m.material_face[f];
    const dvec3 a = kernels::dsub(m.position[t[1]], m.position[t[0]]),
                b = kernels::dsub(m.position[t[2]], m.position[t[0]]);
    const MaterialPoint &o = m.material_position[u[0]], &q = m.material_position[u[1]], &r = m.material_position[u[2]];
    const double ax = q[0] - o[0], ay = q[1] - o[1], bx = r[0] - o[0], by = r[1] - o[1], area = ax * by - ay * bx;
    const double aa = kernels::ddot(a, a), ab = kernels::ddot(a, b), bb = kernels::ddot(b, b);
    // Trace of C = F'F and, from the areas, its determinant.
    const double trace =
        (aa * (bx * bx + by * by) - 2 * ab * (ax * bx + ay * by) + bb * (ax * ax + ay * ay)) / (area * area);
    const double determinant = (aa * bb - ab * ab) / (area * area);
    const double root = std::sqrt(std::max(0.0, trace * trace / 4 - determinant));
    large.push_back(std::sqrt(trace / 2 + root));
    small.push_back(std::sqrt(std::max(0.0, trace / 2 - root)));
  }
  const auto median = [](std::vector<double> values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
  };
  const double factor[2] = {median(large), median(small)}, away = std::max(factor[0], 1 / factor[1]);
  std::size_t uniform = 0;
  for (std::size_t f = 0; f < large.size(); ++f)
    uniform += std::abs(large[f] - factor[0]) <= same * factor[0] && std::abs(small[f] - factor[1]) <= same * factor[1];
  if (!(away > least && away < most) || static_cast<double>(uniform) < share * static_cast<double>(large.size()))
    return;
  char what[240];
  if (factor[0] <= (1 + same) * factor[1]) {
    const double times = std::sqrt(factor[0] * factor[1]);
    const bool texture = cloth.material_scale > 0;
    std::snprintf(what, sizeof what,
                  "%.4g times as %s as its start, in every direction; check the units (%s %.4g would make them equal), "
                  "or take the start as rest shape",
                  std::max(times, 1 / times), times < 1 ? "large" : "small",
                  texture ? "material_scale" : "material coordinates times",
                  texture ? times * cloth.material_scale : times);
  } else {
    std::snprintf(what, sizeof what,
                  "not its start's: that is %.4g times as long one way and %.4g times the other; texture coordinates "
                  "of an image are no rest shape: take the start as rest shape",
                  factor[0], factor[1]);
  }
  throw MeshError("mesh of " + object + ": its material space is " + what);
}

/// Where a mesh is from, if that is a file.
std::string from_file(const std::string &source)
{
  return source.find('.') == std::string::npos ? "" : " from " + source;
}

}  // namespace

void Scene::validate() const
{
  check_settings(*this);
  if (cloths.empty()) throw SceneError("cloth: the scene is empty; add at least one cloth");
  std::set<std::string> names;
  for (const Cloth &c : cloths) {
    const std::string object = "cloth \"" + c.name + "\"";
    if (!names.insert(c.name).second)
      throw SceneError("cloth: two cloths are named \"" + c.name + "\"; give each its own name");
    c.mesh.validate(object + from_file(c.source));
    check_material_scale(object, c);
    c.material.validate(object);
    if (c.material.static_friction != -1 && c.material.friction == -1)
      check_static_friction(object + ": material.static_friction", c.material.static_friction, contact.friction);
    require(finite(c.velocity), object + ": velocity", "not finite", "give three finite numbers, m/s");
    check_shrinkage(object, c);
    require(std::isfinite(c.pressure), object + ": pressure", c.pressure, "give a finite number, Pa");
    if (c.gas) check_gas(object, c);
  }
  names.clear();
  for (const Obstacle &o : obstacles) {
    const std::string object = "obstacle \"" + o.name + "\"";
    if (!names.insert(o.name).second)
      throw SceneError("obstacles: two obstacles are named \"" + o.name + "\"; give each its own name");
    if (o.shape == ObstacleShape::mesh)
      o.mesh.validate(object + from_file(o.source));
    else
      validate_exact(object, o);
    require(std::isfinite(o.friction) && o.friction >= 0, object + ": friction", o.friction,
            "give a Coulomb coefficient, 0 or more");
    check_static_friction(object + ": static_friction", o.static_friction, o.friction);
    require(std::isfinite(o.thickness) && o.thickness >= 0, object + ": thickness", o.thickness,
            "give metres, 0 or more (0: the scene's)");
    require(o.contact_stiffness == -1 || (std::isfinite(o.contact_stiffness) && o.contact_stiffness > 0),
            object + ": contact_stiffness", o.contact_stiffness,
            "give N/m^3, greater than 0, or leave it out for the scene's");
    check_motion(object + ": motion", o.motion, o.mesh.position.size());
    if (o.rigid) mass_properties(o);
  }
  for (std::size_t i = 0; i < pins.size(); ++i) check_pin(*this, i);
  check_pins_disjoint(*this);
  for (std::size_t i = 0; i < stitches.size(); ++i) check_stitch(*this, i);
  check_creases(*this);
}

ContactProperties Scene::contact_properties(std::size_t object) const
{
  const auto combine = [&](double thickness, double stiffness, double friction, double static_friction) {
    const bool own = friction >= 0;
    const double kinetic = own ? friction : contact.friction, inherited = own ? -1 : contact.static_friction;
    const double sticking = static_friction >= 0 ? static_friction : (inherited >= 0 ? inherited : kinetic);
    return ContactProperties{thickness > 0 ? thickness : contact.thickness,
                             stiffness >= 0 ? stiffness : contact.stiffness, kinetic, sticking};
  };
  if (object < cloths.size()) {
    const Material &m = cloths[object].material;
    return combine(m.thickness, m.contact_stiffness, m.friction, m.static_friction);
  }
  const Obstacle &o = obstacles[object - cloths.size()];
  return combine(o.thickness, o.contact_stiffness, o.friction, o.static_friction);
}

int Scene::cloth_vertex_count() const
{
  std::size_t n = 0;
  for (const Cloth &c : cloths) n += c.mesh.position.size();
  return static_cast<int>(n);
}

int Scene::cloth_triangle_count() const
{
  std::size_t n = 0;
  for (const Cloth &c : cloths) n += c.mesh.face.size();
  return static_cast<int>(n);
}

}  // namespace cama
