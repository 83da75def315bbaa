// SPDX-License-Identifier: Apache-2.0
// Obstacles and cloths of a scene file.
#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <optional>
#include <utility>

#include "scene/constants.hpp"
#include "scene/reading/obj_reader.hpp"
#include "scene/reading/scene_reader.hpp"
#include "scene/shapes/exact_obstacle.hpp"
#include "scene/shapes/quaternion.hpp"

namespace cama {
namespace {

/// The single shape key that an object has.
std::string one_of(const Field &f, std::initializer_list<const char *> keys)
{
  std::string found, list;
  for (const char *k : keys) {
    list += (list.empty() ? "" : ", ") + std::string(k);
    if (!f.has(k)) continue;
    if (!found.empty()) f.fail("has both \"" + found + "\" and \"" + k + "\"; give one shape");
    found = k;
  }
  if (found.empty()) f.fail("has no shape; give one of: " + list);
  return found;
}

/// The ending of a file in lower case, with its dot.
std::string ending_of(const std::filesystem::path &p)
{
  std::string ending = p.extension().string();
  for (char &c : ending) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return ending;
}

std::pair<double, double> size2(const Field &f)
{
  const auto s = f.at("size").numbers(2);
  if (!(s[0] > 0) || !(s[1] > 0)) f.at("size").fail("both sides must be greater than 0, got " + f.at("size").brief());
  return {s[0], s[1]};
}

/// Grids are made in the xy plane; "xz" turns them upright, with the second side along z.
void turn_to_plane(const Field &f, std::vector<dvec3> &position)
{
  const std::string plane = f.text("plane", "xy");
  for (dvec3 &x : position) {
    if (plane == "xz")
      x = {x.x, -x.z, x.y};
    else if (plane == "yz")
      x = {x.z, x.x, x.y};
    else if (plane != "xy")
      f.at("plane").fail("must be \"xy\", \"xz\" or \"yz\"");
  }
}

void ripple(const Field &f, std::vector<dvec3> &position)
{
  if (!f.has("ripple")) return;
  const Field r = f.at("ripple");
  r.only({"amplitude", "wavelength"});
  const double a = r.at("amplitude").finite(), k = 2 * pi / r.positive("wavelength", 0.25);
  for (dvec3 &x : position) x.z += a * std::sin(k * x.x) * std::sin(0.7 * k * x.y + 1);
}

/// Rest shape of a mesh file and, if it is uv, the length of a texture unit in `material_scale`, m.
RestShape read_rest(const Field &f, double &material_scale)
{
  if (f.has("material_space"))
    f.at("material_space")
        .fail(f.at("material_space").json() == false
                  ? "is \"rest\" now; leave it out, for the start is the rest shape unless texture coordinates are "
                    "asked for"
                  : "is \"rest\" now; write \"rest\": \"uv\" in its place");
  const std::string rest = f.text("rest", "start");
  if (rest != "start" && rest != "uv") f.at("rest").fail("must be \"start\" or \"uv\", got " + f.at("rest").brief());
  if (rest == "start" && f.has("material_scale"))
    f.at("material_scale")
        .fail("is the length of a texture unit, and texture coordinates are not the rest shape; write \"rest\": "
              "\"uv\" beside it, or leave it out");
  material_scale = f.positive("material_scale", 1);
  return rest == "uv" ? RestShape::uv : RestShape::start;
}

/// Length, m, of the unit that a mesh file is in.
double read_units(const Field &f)
{
  const std::string unit = f.text("units", "m");
  for (const auto &[name, length] : {std::pair("m", 1.0),
                                     {"metre", 1.0},
                                     {"cm", 0.01},
                                     {"centimetre", 0.01},
                                     {"mm", 0.001},
                                     {"millimetre", 0.001},
                                     {"in", 0.0254},
                                     {"inch", 0.0254},
                                     {"ft", 0.3048},
                                     {"foot", 0.3048}})
    if (unit == name) return length;
  f.at("units").fail(
      "must be \"m\", \"cm\", \"mm\", \"in\" or \"ft\", or metre, centimetre, millimetre, inch or foot, got " +
      f.at("units").brief());
}

/// Whether a mesh file is to be turned so that its y axis is up.
bool read_y_up(const Field &f, const std::filesystem::path &path)
{
  const std::string up = f.text("up", "z"), ending = ending_of(path);
  if (up != "y" && up != "z") f.at("up").fail("must be \"y\" or \"z\", got " + f.at("up").brief());
  if (f.has("up") && (ending == ".glb" || ending == ".gltf" || ending == ".fbx" || ending == ".dae"))
    f.at("up").fail("is for OBJ, PLY and STL files; in " + ending + " y is up, and it is turned already; leave it out");
  return up == "y";
}

/// Welds a mesh if its source in the file says so; returns the new vertex of each old one, or nothing.
std::optional<std::vector<int>> weld_if_asked(const Field &source, Mesh &mesh)
{
  if (!source.has("weld")) return {};
  const Field f = source.at("weld");
  const WeldDistances range = weld_distances(mesh);
  double distance = range.coincident;
  if (!f.json().is_boolean()) {
    if (!f.json().is_number()) f.fail("expected true, false or a distance in m, got " + f.brief());
    distance = f.finite();
    char largest[32];
    std::snprintf(largest, sizeof largest, "%.4g", range.largest);
    if (distance < 0 || distance > range.largest)
      f.fail(f.brief() + " is not a distance from 0 to " + largest +
             " m, a tenth of the mesh's extent; give true, or a distance in m");
  } else if (!f.boolean())
    return {};
  WeldedMesh welded = weld(mesh, distance);
  mesh = std::move(welded.mesh);
  return std::move(welded.vertex);
}

/// The part of an object of a scene file that describes its mesh, if it is one that can be welded.
std::optional<Field> mesh_source(const Field &f)
{
  for (const char *key : {"file", "mesh"})
    if (f.has(key)) return f.at(key);
  return {};
}

/// Shrinkage of a cloth: a number, one for warp and one for weft, or such a pair for each triangle.
std::vector<Shrinkage> read_shrinkage(const Field &f)
{
  if (f.json().is_number()) return {{f.finite(), f.finite()}};
  if (!f.json().is_array() || f.json().empty())
    f.fail("expected a number, a list of two (warp and weft), or such a list for each triangle, got " + f.brief());
  const auto pair = [](const Field &p) {
    const auto values = p.numbers(2);
    return Shrinkage{values[0], values[1]};
  };
  if (!f.json()[0].is_array()) return {pair(f)};
  std::vector<Shrinkage> all;
  for (const Field &p : f.items()) all.push_back(pair(p));
  return all;
}

}  // namespace

double cloth_area(const Field &f)
{
  if (f.has("grid")) {
    const auto [w, h] = size2(f.at("grid"));
    return w * h;
  }
  if (f.has("tube")) {
    const Field t = f.at("tube");
    const double r = t.positive("radius", 0.2);
    return pi * (r + t.positive("top_radius", r)) * t.positive("height", 1);
  }
  if (f.has("garment")) {
    const Field g = f.at("garment"), s = g.has("skirt") ? g.at("skirt") : g.at("dress");
    return s.positive("length", 0.5) * (0.9 + pi * s.finite("flare", 0.12));
  }
  return 0;
}

std::filesystem::path SceneReader::file_path(const Field &f) const
{
  const std::filesystem::path p = f.text();
  return p.is_absolute() ? p : folder_ / p;
}

/// The mesh of a file; for cloth with its rest shape, which is noted there, and its stitches.
Mesh SceneReader::read_mesh_file(const Field &f, Cloth *cloth, std::vector<MeshStitch> *stitches) const
{
  const bool plain = f.json().is_string();
  double material_scale = 1;
  RestShape rest = RestShape::start;
  if (!plain && cloth) {
    rest = read_rest(f, material_scale);
    f.only({"path", "units", "up", "scale", "rest", "material_scale", "positions", "stitches", "weld"});
    if (rest == RestShape::uv) cloth->material_scale = material_scale;
  } else if (!plain)
    f.only({"path", "units", "up", "scale", "positions", "weld"});
  const std::filesystem::path path = file_path(plain ? f : f.at("path"));
  const double scale = plain ? 1 : f.positive("scale", 1) * read_units(f);
  const bool y_up = !plain && read_y_up(f, path);
  Mesh m;
  try {
    if (ending_of(path) == ".obj") {
      ObjFile file = read_obj(path, scale, rest, material_scale);
      m = std::move(file.mesh);
      if (stitches && (plain || f.boolean("stitches", true))) *stitches = std::move(file.stitches);
    } else
      m = load_mesh(path, scale, rest, material_scale);
  } catch (const MeshError &e) {
    f.fail(e.what());
  }
  if (!plain && f.has("positions")) {
    const Mesh other = load_mesh(file_path(f.at("positions")), scale);
    if (other.position.size() < m.position.size())
      f.at("positions")
          .fail("has " + std::to_string(other.position.size()) + " vertices, needs at least " +
                std::to_string(m.position.size()));
    std::copy_n(other.position.begin(), m.position.size(), m.position.begin());
  }
  if (y_up)
    for (dvec3 &x : m.position) x = {x.x, -x.z, x.y};
  return m;
}

Character SceneReader::read_character(const Field &f) const
{
  f.only({"file", "clip", "animation_file", "units", "scale", "samples_per_second", "y_up", "lead_in", "loops",
          "leave_out"});
  const std::filesystem::path animation =
      f.has("animation_file") ? file_path(f.at("animation_file")) : std::filesystem::path();
  std::vector<std::string> leave_out;
  if (f.has("leave_out"))
    for (const Field &joint : f.at("leave_out").items()) leave_out.push_back(joint.text());
  return load_character(file_path(f.at("file")), f.text("clip", ""), animation, f.positive("scale", 1) * read_units(f),
                        f.positive("samples_per_second", 60), f.boolean("y_up", true), f.finite("lead_in", 0),
                        f.integer("loops", 1), leave_out);
}

Mesh SceneReader::obstacle_shape(const Field &f, Motion &motion, std::string &source) const
{
  source = one_of(f, {"shape", "sphere", "box", "capsule", "plane", "funnel", "walker", "file", "character", "mesh"});
  const Field s = f.at(source);
  if (source == "shape") return {};   // read_exact makes its mesh
  if (source == "sphere") {
    s.only({"radius", "triangles"});
    return make_sphere(s.positive("radius", 0.25), s.integer("triangles", 6480));
  }
  if (source == "box") {
    s.only({"size", "triangles"});
    return make_box(s.at("size").vector(), s.integer("triangles", 1200));
  }
  if (source == "capsule") {
    s.only({"radius", "length", "triangles"});
    return make_capsule(s.positive("radius", 0.1), s.finite("length", 0.5), s.integer("triangles", 6000));
  }
  if (source == "plane") {
    s.only({"size", "triangles", "plane"});
    const auto [w, h] = size2(s);
    Mesh m = make_grid(w, h, s.integer("triangles", 2000)).mesh;
    m.material_position.clear();
    m.material_face.clear();
    turn_to_plane(s, m.position);
    return m;
  }
  if (source == "funnel") {
    s.only({"top_radius", "throat_radius", "cone_height", "tube_length", "wall", "triangles"});
    Funnel shape;
    shape.top_radius = s.positive("top_radius", shape.top_radius);
    shape.throat_radius = s.positive("throat_radius", shape.throat_radius);
    shape.cone_height = s.positive("cone_height", shape.cone_height);
    shape.tube_length = s.positive("tube_length", shape.tube_length);
    shape.wall = s.positive("wall", shape.wall);
    return make_funnel(shape, s.integer("triangles", 9000));
  }
  if (source == "walker") {
    s.only({"height", "cell", "rest", "period", "duration", "samples_per_second", "stride"});
    Walker w;
    w.height = s.positive("height", w.height);
    w.cell = s.positive("cell", w.cell);
    w.rest = s.finite("rest", w.rest);
    w.period = s.positive("period", w.period);
    w.duration = s.positive("duration", w.duration);
    w.samples_per_second = s.positive("samples_per_second", w.samples_per_second);
    w.stride = s.finite("stride", w.stride);
    Character c = make_walker(w);
    motion.sampled = c.motion.sampled;
    return c.mesh;
  }
  if (source == "character") {
    Character c = read_character(s);
    motion.sampled = c.motion.sampled;
    source = "character " + s.at("file").text();
    return c.mesh;
  }
  if (source == "mesh") return read_inline_mesh(s);
  Mesh m = read_mesh_file(s, nullptr, nullptr);
  source = s.json().is_string() ? s.text() : s.at("path").text();
  return m;
}

Rigid SceneReader::read_rigid(const Field &f) const
{
  f.only({"mass", "density", "center", "inertia", "velocity", "angular_velocity"});
  Rigid r;
  r.mass = f.finite("mass", r.mass);
  r.density = f.finite("density", r.density);
  if (f.has("center")) r.center = f.at("center").vector();
  if (f.has("inertia")) {
    const std::vector<double> values = f.at("inertia").numbers(6);
    r.inertia.emplace();
    std::copy(values.begin(), values.end(), r.inertia->begin());
  }
  r.velocity = f.vector("velocity", r.velocity);
  r.angular_velocity = f.vector("angular_velocity", r.angular_velocity);
  return r;
}

void SceneReader::read_obstacle(const Field &f, std::size_t index)
{
  f.only({"name", "source", "shape", "sphere", "box", "capsule", "plane", "funnel", "walker", "file", "character",
          "mesh", "transform", "motion", "friction", "static_friction", "thickness", "contact_stiffness", "rigid"});
  Obstacle o;
  o.name = f.text("name", "obstacle " + std::to_string(index));
  o.friction = f.finite("friction", o.friction);
  o.static_friction = f.finite("static_friction", o.static_friction);
  o.thickness = f.finite("thickness", o.thickness);
  o.contact_stiffness = f.finite("contact_stiffness", o.contact_stiffness);
  Motion shape_motion;
  Mesh mesh = obstacle_shape(f, shape_motion, o.source);
  if (o.source == "shape") {
    Obstacle made = read_exact(f.at("shape"));
    o.shape = made.shape;
    o.radius = made.radius;
    o.source = made.source;
    mesh = std::move(made.mesh);
  }
  o.mesh = std::move(mesh);
  o.source = f.text("source", o.source);
  if (f.has("motion")) o.motion = read_motion(f.at("motion"));
  if (f.has("rigid")) o.rigid = read_rigid(f.at("rigid"));
  if (shape_motion.sampled) {
    if (o.motion.sampled) f.at("motion").fail("has \"sampled\", but the shape brings its own animation");
    o.motion.sampled = shape_motion.sampled;
  }
  if (f.has("transform")) {
    const RigidTransform t = read_transform(f.at("transform"));
    if (o.shape == ObstacleShape::mesh)
      apply_transform(t, o.mesh.position);
    else
      place_exact(t, o);
    if (o.motion.sampled) {
      auto moved = std::make_shared<Motion::Sampled>(*o.motion.sampled);
      for (auto &positions : moved->position) apply_transform(t, positions);
      o.motion.sampled = std::move(moved);
    }
  }
  if (const auto from = mesh_source(f); from && weld_if_asked(*from, o.mesh) && o.motion.sampled)
    from->at("weld").fail("its motion gives positions of every vertex; weld the mesh and them before");
  scene_.obstacles.push_back(std::move(o));
}

/// Divides the number of triangles among generated cloths, by "share" or else by area.
void SceneReader::plan_cloths(const std::vector<Field> &all)
{
  std::vector<double> weight;
  double total = 0;
  for (const Field &f : all) {
    const double area = cloth_area(f);
    weight.push_back(area > 0 && !(f.has("grid") && f.at("grid").has("cells")) ? f.positive("share", area) : 0);
    total += weight.back();
  }
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (weight[i] > 0 && resolution_ > 0)
      triangles_.push_back(std::max(2, static_cast<int>(std::lround(resolution_ * weight[i] / total))));
    else
      triangles_.push_back(all[i].integer("triangles", 2000));
  }
}

Pattern SceneReader::read_garment(const Field &f, int triangles) const
{
  const std::string kind = one_of(f, {"skirt", "dress"});
  f.only({"skirt", "dress"});
  const Field g = f.at(kind);
  g.only(
      {"body", "waist", "chest", "waist_fraction", "chest_fraction", "hip", "length", "panels", "flare", "clearance"});
  const Obstacle &body = scene_.obstacles[find_obstacle(g.at("body"))];
  if (body.shape != ObstacleShape::mesh)
    g.at("body").fail("\"" + body.name + "\" has no mesh; a garment is made around a meshed body");
  double lo = 1e300, hi = -1e300;
  for (const dvec3 &x : body.mesh.position) {
    lo = std::min(lo, x.z);
    hi = std::max(hi, x.z);
  }
  Garment shape;
  const std::string key = kind == "skirt" ? "waist" : "chest";
  const double fraction = g.positive((key + "_fraction").c_str(), kind == "skirt" ? 0.60 : 0.72);
  shape.top = g.has(key.c_str()) ? g.at(key).finite() : lo + fraction * (hi - lo);
  shape.length = g.positive("length", kind == "skirt" ? 0.30 * (hi - lo) : 0.45 * (hi - lo));
  shape.panels = g.integer("panels", 6);
  shape.flare = g.finite("flare", 0.12);
  shape.clearance = g.positive("clearance", 0.008);
  shape.hip = g.finite("hip", kind == "dress" ? lo + 0.50 * (hi - lo) : 0.0);
  try {
    return make_garment(body.mesh, shape, triangles);
  } catch (const MeshError &e) {
    g.fail(e.what());
  }
}

Pattern SceneReader::cloth_shape(const Field &f, int triangles, Cloth &cloth, std::vector<MeshStitch> &stitches) const
{
  std::string &source = cloth.source;
  source = one_of(f, {"grid", "tube", "garment", "file", "mesh"});
  const Field s = f.at(source);
  Pattern p;
  if (source == "grid") {
    s.only({"size", "cells", "plane", "ripple"});
    const auto [w, h] = size2(s);
    if (s.has("cells")) {
      const auto items = s.at("cells").items();
      if (items.size() != 2 || items[0].integer() < 1 || items[1].integer() < 1)
        s.at("cells").fail("expected two whole numbers greater than 0");
      p = make_grid_cells(w, h, items[0].integer(), items[1].integer());
    } else
      p = make_grid(w, h, triangles);
    ripple(s, p.mesh.position);
    turn_to_plane(s, p.mesh.position);
  } else if (source == "tube") {
    s.only({"radius", "top_radius", "height", "seams"});
    const double r = s.positive("radius", 0.2);
    p = make_tube(r, s.positive("top_radius", r), s.positive("height", 1), triangles, s.integer("seams", 1));
  } else if (source == "garment")
    p = read_garment(s, triangles);
  else if (source == "mesh")
    p.mesh = read_inline_mesh(s);
  else {
    p.mesh = read_mesh_file(s, &cloth, &stitches);
    source = s.json().is_string() ? s.text() : s.at("path").text();
  }
  return p;
}

void SceneReader::read_cloth(const Field &f, std::size_t index)
{
  f.only({"name", "source", "grid", "tube", "garment", "file", "mesh", "material", "thickness", "transform", "velocity",
          "pressure", "gas", "shrinkage", "share", "triangles", "stitch_stiffness"});
  Cloth c;
  c.name = f.text("name", "cloth " + std::to_string(index));
  std::vector<MeshStitch> stitches;
  Pattern p = cloth_shape(f, triangles_[index], c, stitches);
  c.source = f.text("source", c.source);
  c.mesh = std::move(p.mesh);
  if (f.has("transform")) {
    const RigidTransform t = read_transform(f.at("transform"));
    apply_transform(t, c.mesh.position);
    for (MaterialPoint &u : c.mesh.material_position) u = {t.scale * u[0], t.scale * u[1]};
  }
  if (const auto from = mesh_source(f))
    if (const auto vertex = weld_if_asked(*from, c.mesh)) stitches = renumber(stitches, *vertex);
  c.velocity = f.vector("velocity", c.velocity);
  c.pressure = f.finite("pressure", c.pressure);
  if (f.has("gas")) {
    const Field g = f.at("gas");
    g.only({"pressure", "volume", "ambient"});
    c.gas = Gas();
    c.gas->pressure = g.finite("pressure", c.gas->pressure);
    c.gas->volume = g.finite("volume", c.gas->volume);
    c.gas->ambient = g.finite("ambient", c.gas->ambient);
  }
  if (f.has("shrinkage")) c.shrinkage = read_shrinkage(f.at("shrinkage"));
  if (!f.has("material"))
    c.material = Material::fabric("cotton");
  else {
    const Field m = f.at("material");
    const auto known = m.json().is_string() ? materials_.find(m.text()) : materials_.end();
    c.material = known != materials_.end() ? known->second : read_material(m, c.name);
  }
  if (f.has("thickness")) {
    c.material.thickness = f.at("thickness").finite();
    if (c.material.thickness < 0)
      f.at("thickness").fail("must be 0 or more, m (0: the scene's), got " + f.at("thickness").brief());
  }
  const int here = static_cast<int>(scene_.cloths.size());
  for (const MeshStitch &s : stitches)
    scene_.stitches.push_back({here, s.a, here, s.b, s.c, s.ratio, f.positive("stitch_stiffness", 1e3)});
  scene_.cloths.push_back(std::move(c));
  group_.push_back(std::move(p.group));
}

}  // namespace cama
