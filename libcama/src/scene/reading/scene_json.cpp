// SPDX-License-Identifier: Apache-2.0
// A scene file as a whole: its values, options, materials, pins and stitches. The format is described in
// scenes/schema.json.
#include <algorithm>
#include <set>

#include "scene/reading/material_json.hpp"
#include "scene/reading/scene_reader.hpp"
#include "scene/reading/text_file.hpp"

namespace cama {

namespace {

/// {"tolerance": 1e-4, "paper": {"search": "fronts"}}
void read_options(const Field &f, const std::string &group, OptionOverrides &options)
{
  if (!f.json().is_object()) f.fail("expected an object that maps options to values, got " + f.brief());
  for (auto it = f.json().begin(); it != f.json().end(); ++it) {
    const Field own = f.at(it.key());
    if (group.empty() && it->is_object()) {
      read_options(own, it.key() + ".", options);
      continue;
    }
    OptionValue value;
    if (it->is_boolean())
      value = own.boolean();
    else if (it->is_number_integer())
      value = own.integer();
    else if (it->is_number())
      value = own.finite();
    else if (it->is_string())
      value = own.text();
    else
      own.fail("expected a text, a number, true or false, got " + own.brief());
    try {
      options.set(group + it.key(), value);
    } catch (const SceneError &problem) {
      throw SceneError(std::string("options: ") + problem.what());
    }
  }
}

}  // namespace

Scene SceneReader::read(const Field &top)
{
  top.only({"name", "description", "time_step", "frame_time", "frames", "gravity", "wind", "contact", "resolution",
            "materials", "cloth", "obstacles", "pins", "stitches", "elastics", "creases", "options"});
  read_settings(top);
  if (top.has("materials")) {
    const Field all = top.at("materials");
    if (!all.json().is_object()) all.fail("expected an object that maps names to materials");
    for (auto it = all.json().begin(); it != all.json().end(); ++it)
      materials_.emplace(it.key(), read_material(all.at(it.key()), it.key()));
  }
  if (top.has("obstacles")) {
    const auto items = top.at("obstacles").items();
    for (std::size_t i = 0; i < items.size(); ++i) read_obstacle(items[i], i);
  }
  if (top.has("cloth")) {
    const auto items = top.at("cloth").items();
    plan_cloths(items);
    for (std::size_t i = 0; i < items.size(); ++i) read_cloth(items[i], i);
  }
  if (top.has("pins"))
    for (const Field &f : top.at("pins").items()) read_pin(f);
  if (top.has("stitches"))
    for (const Field &f : top.at("stitches").items()) read_stitch(f);
  if (top.has("elastics"))
    for (const Field &f : top.at("elastics").items()) read_elastic(f);
  if (top.has("creases"))
    for (const Field &f : top.at("creases").items()) read_crease(f);
  return std::move(scene_);
}

void SceneReader::read_settings(const Field &f)
{
  scene_.name = f.text("name", scene_.name);
  scene_.description = f.text("description", "");
  if (f.has("time_step")) scene_.time_step = f.positive("time_step", scene_.time_step);
  scene_.frame_time = f.finite("frame_time", 0);
  scene_.frames = f.integer("frames", scene_.frames);
  scene_.gravity = f.vector("gravity", scene_.gravity);
  if (resolution_ < 0) throw SceneError("resolution: must be 0 or more, got " + std::to_string(resolution_));
  if (resolution_ == 0) resolution_ = f.integer("resolution", 0);
  if (f.has("wind")) {
    const Field w = f.at("wind");
    w.only({"velocity", "density", "drag"});
    scene_.wind = Wind();
    scene_.wind->velocity = w.vector("velocity", scene_.wind->velocity);
    scene_.wind->density = w.finite("density", scene_.wind->density);
    scene_.wind->drag = w.finite("drag", scene_.wind->drag);
  }
  if (f.has("options")) {
    read_options(f.at("options"), "", scene_.options);
    check_scene_options(scene_.options);
  }
  if (f.has("contact")) {
    const Field c = f.at("contact");
    c.only({"enabled", "self", "thickness", "stiffness", "friction", "static_friction"});
    Contact &k = scene_.contact;
    k.enabled = c.boolean("enabled", k.enabled);
    k.self = c.boolean("self", k.self);
    k.thickness = c.positive("thickness", k.thickness);
    k.stiffness = c.positive("stiffness", k.stiffness);
    k.friction = c.finite("friction", k.friction);
    k.static_friction = c.finite("static_friction", k.static_friction);
  }
}

Material SceneReader::read_material(const Field &f, const std::string &name) const
{
  try {
    if (f.json().is_string()) return Material::fabric(f.text());
    if (f.has("file")) {
      f.only({"file"});
      return Material::load(file_path(f.at("file")));
    }
    if (!f.has("fabric")) return parse_material(f, name);
    f.only({"fabric", "density", "damping", "mass_damping", "strain_limit", "limit_stiffening", "yield_curvature",
            "hardening", "friction", "static_friction", "thickness", "contact_stiffness"});
    Material m = Material::fabric(f.at("fabric").text());
    m.density = f.finite("density", m.density);
    m.damping = f.finite("damping", m.damping);
    m.mass_damping = f.finite("mass_damping", m.mass_damping);
    m.strain_limit = f.finite("strain_limit", m.strain_limit);
    m.limit_stiffening = f.finite("limit_stiffening", m.limit_stiffening);
    m.yield_curvature = f.finite("yield_curvature", m.yield_curvature);
    m.hardening = f.finite("hardening", m.hardening);
    m.friction = f.finite("friction", m.friction);
    m.static_friction = f.finite("static_friction", m.static_friction);
    m.thickness = f.finite("thickness", m.thickness);
    m.contact_stiffness = f.finite("contact_stiffness", m.contact_stiffness);
    m.validate(name);
    return m;
  } catch (const MaterialError &e) {
    throw MaterialError(f.path() + ": " + e.what());
  }
}

namespace {

template <class Objects> int find_named(const Field &f, const Objects &all, const char *kind)
{
  std::string names;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (f.json().is_string() ? all[i].name == f.text() : f.integer() == static_cast<int>(i)) return static_cast<int>(i);
    names += (i ? ", \"" : "\"") + all[i].name + "\"";
  }
  f.fail("no " + std::string(kind) + " " + f.brief() + "; there are: " + (names.empty() ? "none" : names));
}

}  // namespace

int SceneReader::find_cloth(const Field &f) const { return find_named(f, scene_.cloths, "cloth"); }
int SceneReader::find_obstacle(const Field &f) const { return find_named(f, scene_.obstacles, "obstacle"); }

const std::vector<int> &SceneReader::named_vertices(const Field &name, int cloth) const
{
  const auto &groups = group_[cloth];
  const auto g = groups.find(name.text());
  std::string names;
  for (const auto &[n, vertices] : groups) names += (names.empty() ? "" : ", ") + n;
  if (g == groups.end())
    name.fail("cloth \"" + scene_.cloths[cloth].name +
              "\" has no vertices of that name; it has: " + (names.empty() ? "none (not generated)" : names));
  return g->second;
}

void SceneReader::read_pin(const Field &f)
{
  f.only({"cloth", "vertices", "box", "corners", "edge", "all", "motion", "attach", "release"});
  Pin p;
  p.cloth = find_cloth(f.at("cloth"));
  const Mesh &mesh = scene_.cloths[p.cloth].mesh;
  std::set<int> chosen;
  if (f.has("vertices"))
    for (const Field &v : f.at("vertices").items()) {
      const int i = v.integer();
      if (i < 0 || i >= static_cast<int>(mesh.position.size()))
        v.fail("cloth \"" + scene_.cloths[p.cloth].name + "\" has no vertex " + std::to_string(i) + "; it has " +
               std::to_string(mesh.position.size()) + ", counted from 0");
      chosen.insert(i);
    }
  if (f.has("box")) {
    const Field b = f.at("box");
    b.only({"min", "max"});
    const dvec3 lo = b.at("min").vector(), hi = b.at("max").vector();
    for (std::size_t v = 0; v < mesh.position.size(); ++v) {
      const dvec3 &x = mesh.position[v];
      if (x.x >= lo.x && x.y >= lo.y && x.z >= lo.z && x.x <= hi.x && x.y <= hi.y && x.z <= hi.z)
        chosen.insert(static_cast<int>(v));
    }
  }
  const auto add_group = [&](const Field &name) {
    const std::vector<int> &group = named_vertices(name, p.cloth);
    chosen.insert(group.begin(), group.end());
  };
  if (f.has("edge")) add_group(f.at("edge"));
  if (f.has("corners"))
    for (const Field &c : f.at("corners").items()) add_group(c);
  if (f.boolean("all", false))
    for (std::size_t v = 0; v < mesh.position.size(); ++v) chosen.insert(static_cast<int>(v));
  if (chosen.empty() && f.has("box") && !mesh.position.empty()) {
    dvec3 lo = mesh.position.front(), hi = lo;
    for (const dvec3 &x : mesh.position) {
      lo = {std::min(lo.x, x.x), std::min(lo.y, x.y), std::min(lo.z, x.z)};
      hi = {std::max(hi.x, x.x), std::max(hi.y, x.y), std::max(hi.z, x.z)};
    }
    const auto corner = [](const dvec3 &x) {
      char text[96];
      std::snprintf(text, sizeof text, "(%.4g, %.4g, %.4g)", x.x, x.y, x.z);
      return std::string(text);
    };
    f.at("box").fail("has no vertex in it; cloth \"" + scene_.cloths[p.cloth].name + "\" reaches from " + corner(lo) +
                     " to " + corner(hi));
  }
  if (chosen.empty()) f.fail("selects no vertex; give vertices, box, corners or edge");
  p.vertices.assign(chosen.begin(), chosen.end());
  if (f.has("motion")) p.motion = read_motion(f.at("motion"));
  if (p.motion.sampled) f.at("motion").fail("pins move rigidly; \"sampled\" is for obstacles");
  if (f.has("attach") && f.has("motion"))
    f.at("motion").fail("a pin that is attached moves with its obstacle; give one of attach and motion");
  if (f.has("attach")) p.obstacle = find_obstacle(f.at("attach"));
  p.release = f.number("release", p.release);
  scene_.pins.push_back(std::move(p));
}

void SceneReader::read_stitch(const Field &f)
{
  f.only({"a", "b", "stiffness", "length"});
  const Field a = f.at("a"), b = f.at("b");
  a.only({"cloth", "vertex"});
  b.only({"cloth", "vertex", "other", "ratio"});
  Stitch s;
  s.cloth_a = find_cloth(a.at("cloth"));
  s.vertex_a = a.at("vertex").integer();
  s.cloth_b = find_cloth(b.at("cloth"));
  s.vertex_b = b.at("vertex").integer();
  s.vertex_c = b.integer("other", s.vertex_b);
  s.ratio = b.finite("ratio", 0);
  s.stiffness = f.positive("stiffness", s.stiffness);
  s.length = f.finite("length", s.length);
  scene_.stitches.push_back(s);
}

void SceneReader::read_elastic(const Field &f)
{
  f.only({"cloth", "vertices", "edge", "length", "stiffness"});
  const int cloth = find_cloth(f.at("cloth"));
  if (f.has("vertices") == f.has("edge")) f.fail("needs one of edge and vertices");
  std::vector<int> line;
  if (f.has("edge")) {
    line = named_vertices(f.at("edge"), cloth);
    const auto edges = unique_edges(scene_.cloths[cloth].mesh.face);
    const int low = std::min(line.front(), line.back()), high = std::max(line.front(), line.back());
    const bool closed = std::find(edges.begin(), edges.end(), std::array<int, 2>{low, high}) != edges.end();
    if (line.size() > 2 && closed) line.push_back(line.front());
  } else
    for (const Field &v : f.at("vertices").items()) line.push_back(v.integer());
  try {
    scene_.add_elastic(cloth, line, f.at("length").finite(), f.at("stiffness").finite());
  } catch (const SceneError &e) {
    f.fail(e.what());
  }
}

void SceneReader::read_crease(const Field &f)
{
  f.only({"cloth", "vertices", "edge", "line", "angle"});
  Crease c;
  c.cloth = find_cloth(f.at("cloth"));
  if (f.has("vertices") + f.has("edge") + f.has("line") != 1) f.fail("needs one of vertices, edge and line");
  try {
    if (f.has("edge")) {
      c.vertices = named_vertices(f.at("edge"), c.cloth);
    } else if (f.has("line")) {
      const auto ends = f.at("line").items();
      if (ends.size() != 2) f.at("line").fail("expected two points");
      c.vertices = scene_.vertices_along(c.cloth, ends[0].vector(), ends[1].vector());
    } else {
      for (const Field &v : f.at("vertices").items()) c.vertices.push_back(v.integer());
    }
  } catch (const SceneError &e) {
    f.fail(e.what());
  }
  c.angle = f.at("angle").finite();
  scene_.creases.push_back(std::move(c));
}

Scene Scene::load(const std::filesystem::path &path, int resolution)
{
  const std::filesystem::path file = std::filesystem::is_directory(path) ? path / "scene.json" : path;
  try {
    return parse(read_text(file), file.parent_path(), resolution);
  } catch (const SceneError &e) {
    throw SceneError(file.string() + ": " + e.what());
  } catch (const MaterialError &e) {
    throw MaterialError(file.string() + ": " + e.what());
  } catch (const MeshError &e) {
    throw MeshError(file.string() + ": " + e.what());
  }
}

Scene Scene::parse(const std::string &json, const std::filesystem::path &folder, int resolution)
{
  const Json value = parse_json(json, raise_scene_error);
  return SceneReader(folder, resolution).read(Field(value, "", raise_scene_error));
}

}  // namespace cama
