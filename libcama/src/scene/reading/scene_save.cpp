// SPDX-License-Identifier: Apache-2.0
// Writes a scene as text, directly into one string: a scene of a million triangles would be too large a JSON tree.
#include <charconv>
#include <cmath>
#include <cstdio>

#include "cama/error.hpp"
#include "cama/scene.hpp"
#include "scene/reading/material_json.hpp"
#include "scene/shapes/exact_obstacle.hpp"

namespace cama {
namespace {

class Writer {
public:
  std::string text;

  void number(double x)
  {
    if (!std::isfinite(x))
      throw SceneError("save: a value is not finite, which JSON cannot hold; run validate() to find it");
    if (x == 0 && std::signbit(x)) {
      text += "-0.0";
      return;
    }
    char b[40];
    const auto r = std::to_chars(b, b + sizeof b, x);
    text.append(b, r.ptr);
  }
  void number(int x) { text += std::to_string(x); }
  void quoted(const std::string &s) { text += Json(s).dump(); }
  void vector(const dvec3 &v) { list3(v.x, v.y, v.z); }
  void list3(double a, double b, double c)
  {
    text += '[';
    number(a);
    text += ',';
    number(b);
    text += ',';
    number(c);
    text += ']';
  }
  /// Writes `, "key": `, with the comma if it is needed.
  void key(const char *k)
  {
    if (!text.empty() && text.back() != '{') text += ',';
    text += '"';
    text += k;
    text += "\":";
  }
  template <class Items, class Write> void list(const Items &items, Write write)
  {
    text += '[';
    bool first = true;
    for (const auto &i : items) {
      if (!first) text += ',';
      first = false;
      write(i);
    }
    text += ']';
  }
  void points(const std::vector<dvec3> &p)
  {
    text += '[';
    for (std::size_t i = 0; i < p.size(); ++i) {
      if (i) text += ',';
      number(p[i].x);
      text += ',';
      number(p[i].y);
      text += ',';
      number(p[i].z);
    }
    text += ']';
  }
  template <class Rows> void flat(const Rows &rows)
  {
    text += '[';
    bool first = true;
    for (const auto &row : rows)
      for (auto x : row) {
        if (!first) text += ',';
        first = false;
        number(x);
      }
    text += ']';
  }
};

void write_mesh(Writer &w, const Mesh &m)
{
  w.text += '{';
  w.key("position");
  w.points(m.position);
  w.key("face");
  w.flat(m.face);
  if (!m.material_face.empty()) {
    w.key("material_position");
    w.flat(m.material_position);
    w.key("material_face");
    w.flat(m.material_face);
  }
  w.text += '}';
}

void write_transform(Writer &w, const RigidTransform &t)
{
  w.key("translate");
  w.vector(t.translation);
  w.key("quaternion");
  w.list(t.rotation, [&](double x) { w.number(x); });
  w.key("scale");
  w.number(t.scale);
  w.key("center");
  w.vector(t.center);
}

void write_motion(Writer &w, const Motion &m)
{
  w.text += '{';
  if (!m.keys.empty()) {
    w.key("keys");
    w.list(m.keys, [&](const Motion::Key &k) {
      w.text += '{';
      w.key("time");
      w.number(k.time);
      write_transform(w, k.transform);
      w.text += '}';
    });
  }
  w.key("velocity");
  w.vector(m.velocity);
  w.key("rotation_rate");
  w.vector(m.rotation_rate);
  w.key("oscillation");
  w.text += '{';
  w.key("amplitude");
  w.vector(m.oscillation);
  w.key("period");
  w.number(m.period);
  w.text += '}';
  w.key("center");
  w.vector(m.center);
  w.key("start");
  w.number(m.start);
  w.key("stop");
  w.number(m.stop);
  if (m.sampled) {
    w.key("sampled");
    w.text += '{';
    w.key("time");
    w.list(m.sampled->time, [&](double t) { w.number(t); });
    w.key("position");
    w.list(m.sampled->position, [&](const std::vector<dvec3> &p) { w.points(p); });
    w.text += '}';
  }
  w.text += '}';
}

void write_cloth(Writer &w, const Cloth &c)
{
  w.text += "\n{";
  w.key("name");
  w.quoted(c.name);
  w.key("source");
  w.quoted(c.source);
  w.key("velocity");
  w.vector(c.velocity);
  if (c.pressure != 0) {
    w.key("pressure");
    w.number(c.pressure);
  }
  if (c.gas) {
    w.key("gas");
    w.text += '{';
    w.key("pressure");
    w.number(c.gas->pressure);
    w.key("volume");
    w.number(c.gas->volume);
    w.key("ambient");
    w.number(c.gas->ambient);
    w.text += '}';
  }
  if (!c.shrinkage.empty()) {
    w.key("shrinkage");
    w.list(c.shrinkage, [&](const Shrinkage &s) { w.list(s, [&](double x) { w.number(x); }); });
  }
  w.key("material");
  w.text += material_json(c.material).dump();
  w.key("mesh");
  write_mesh(w, c.mesh);
  w.text += '}';
}

void write_rigid(Writer &w, const Rigid &r)
{
  w.text += '{';
  w.key(r.mass > 0 ? "mass" : "density");
  w.number(r.mass > 0 ? r.mass : r.density);
  if (r.center) {
    w.key("center");
    w.vector(*r.center);
  }
  if (r.inertia) {
    w.key("inertia");
    w.list(*r.inertia, [&](double x) { w.number(x); });
  }
  w.key("velocity");
  w.vector(r.velocity);
  w.key("angular_velocity");
  w.vector(r.angular_velocity);
  w.text += '}';
}

void write_obstacle(Writer &w, const Obstacle &o)
{
  w.text += "\n{";
  w.key("name");
  w.quoted(o.name);
  w.key("source");
  w.quoted(o.source);
  w.key("friction");
  w.number(o.friction);
  const auto optional = [&](const char *key, double value) {
    if (value == -1) return;
    w.key(key);
    w.number(value);
  };
  optional("static_friction", o.static_friction);
  optional("contact_stiffness", o.contact_stiffness);
  w.key("thickness");
  w.number(o.thickness);
  w.key("motion");
  write_motion(w, o.motion);
  if (o.rigid) {
    w.key("rigid");
    write_rigid(w, *o.rigid);
  }
  if (o.shape == ObstacleShape::mesh) {
    w.key("mesh");
    write_mesh(w, o.mesh);
  } else {
    w.key("shape");
    w.text += std::string("{\"") + shape_name(o.shape) + "\":{";
    if (o.radius != 0) {
      w.key("radius");
      w.number(o.radius);
    }
    w.key("points");
    w.list(o.mesh.position, [&](const dvec3 &x) { w.vector(x); });
    w.text += "}}";
  }
  w.text += '}';
}

void write_pin(Writer &w, const Pin &p)
{
  w.text += "\n{";
  w.key("cloth");
  w.number(p.cloth);
  w.key("vertices");
  w.list(p.vertices, [&](int v) { w.number(v); });
  if (p.obstacle) {
    w.key("attach");
    w.number(*p.obstacle);
  } else {
    w.key("motion");
    write_motion(w, p.motion);
  }
  if (!std::isinf(p.release)) {
    w.key("release");
    w.number(p.release);
  }
  w.text += '}';
}

void write_stitch(Writer &w, const Stitch &s)
{
  w.text += "\n{";
  w.key("a");
  w.text += "{\"cloth\":" + std::to_string(s.cloth_a) + ",\"vertex\":" + std::to_string(s.vertex_a) + "}";
  w.key("b");
  w.text += "{\"cloth\":" + std::to_string(s.cloth_b) + ",\"vertex\":" + std::to_string(s.vertex_b) +
            ",\"other\":" + std::to_string(s.vertex_c) + ",\"ratio\":";
  w.number(s.ratio);
  w.text += '}';
  w.key("stiffness");
  w.number(s.stiffness);
  if (s.length != 0) {
    w.key("length");
    w.number(s.length);
  }
  w.text += '}';
}

void write_crease(Writer &w, const Crease &c)
{
  w.text += "\n{";
  w.key("cloth");
  w.text += std::to_string(c.cloth);
  w.key("vertices");
  w.list(c.vertices, [&](int v) { w.text += std::to_string(v); });
  w.key("angle");
  w.number(c.angle);
  w.text += '}';
}

/// Options by name, those of the paper in an object.
Json options_json(const OptionOverrides &options)
{
  Json all = Json::object();
  for (const auto &[name, value] : options.values()) {
    const std::size_t dot = name.find('.');
    Json &place = dot == std::string::npos ? all[name] : all[name.substr(0, dot)][name.substr(dot + 1)];
    std::visit([&place = place](const auto &v) { place = v; }, value);
  }
  return all;
}

}  // namespace

std::string Scene::save() const
{
  Writer w;
  w.text += '{';
  w.key("name");
  w.quoted(name);
  w.key("description");
  w.quoted(description);
  if (time_step > 0) {
    w.key("time_step");
    w.number(time_step);
  }
  w.key("frame_time");
  w.number(frame_time);
  w.key("frames");
  w.number(frames);
  w.key("gravity");
  w.vector(gravity);
  if (wind) {
    w.key("wind");
    w.text += '{';
    w.key("velocity");
    w.vector(wind->velocity);
    w.key("density");
    w.number(wind->density);
    w.key("drag");
    w.number(wind->drag);
    w.text += '}';
  }
  w.key("contact");
  w.text += '{';
  w.key("enabled");
  w.text += contact.enabled ? "true" : "false";
  w.key("self");
  w.text += contact.self ? "true" : "false";
  w.key("thickness");
  w.number(contact.thickness);
  w.key("stiffness");
  w.number(contact.stiffness);
  w.key("friction");
  w.number(contact.friction);
  if (contact.static_friction != -1) {
    w.key("static_friction");
    w.number(contact.static_friction);
  }
  w.text += '}';
  if (!options.empty()) {
    w.key("options");
    w.text += options_json(options).dump();
  }
  w.key("obstacles");
  w.list(obstacles, [&](const Obstacle &o) { write_obstacle(w, o); });
  w.key("cloth");
  w.list(cloths, [&](const Cloth &c) { write_cloth(w, c); });
  w.key("pins");
  w.list(pins, [&](const Pin &p) { write_pin(w, p); });
  w.key("stitches");
  w.list(stitches, [&](const Stitch &s) { write_stitch(w, s); });
  if (!creases.empty()) {
    w.key("creases");
    w.list(creases, [&](const Crease &c) { write_crease(w, c); });
  }
  w.text += "}\n";
  return std::move(w.text);
}

}  // namespace cama
