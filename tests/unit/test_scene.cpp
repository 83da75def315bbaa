// SPDX-License-Identifier: Apache-2.0
#include "../catch.hpp"

#include <cmath>
#include <cstring>
#include <fstream>
#include <set>

#include "cama/error.hpp"
#include "cama/scene.hpp"
#include "cama/simulation.hpp"

using namespace cama;
namespace fs = std::filesystem;

namespace {

const char *shipped[] = {"drape", "sphere", "funnel", "twisting", "flag", "garment", "shapes", "pile"};
fs::path scene_folder(const std::string &name) { return fs::path(CAMA_SOURCE_DIR) / "scenes" / name; }

double distance(const dvec3 &a, const dvec3 &b) { return kernels::dnorm(kernels::dsub(a, b)); }

/// Distance of a point from a triangle by projecting on the plane, the edges and the corners.
double distance(const dvec3 &p, const dvec3 &a, const dvec3 &b, const dvec3 &c)
{
  using namespace kernels;
  double best = 1e300;
  const dvec3 corner[3] = {a, b, c}, n = dnormalize(dcross(dsub(b, a), dsub(c, a)));
  bool inside = true;
  for (int k = 0; k < 3; ++k) {
    const dvec3 x = corner[k], e = dsub(corner[(k + 1) % 3], x), d = dsub(p, x);
    inside = inside && ddot(dcross(n, e), d) >= 0;
    best = std::min(best, dnorm(daxpy(d, -clamp_double(ddot(d, e) / ddot(e, e), 0, 1), e)));
  }
  return inside ? std::abs(ddot(dsub(p, a), n)) : best;
}

std::string parse_error(const std::string &json)
{
  return thrown<Error>([&] { Scene::parse(json, ".").validate(); });
}

bool same(const std::vector<dvec3> &a, const std::vector<dvec3> &b)
{
  return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), sizeof(dvec3) * a.size()) == 0);
}

Scene small_scene()
{
  return Scene::parse(R"({
    "name": "small", "description": "a \"quoted\" text", "time_step": 0.01, "gravity": [0, 0.1, -9.81], "frames": 7, "frame_time": 0.02,
    "wind": {"velocity": [1, 2, 3], "drag": 0.1},
    "contact": {"thickness": 0.002, "self": false, "friction": 0.33, "static_friction": 0.4},
    "materials": {"mine": {"isotropic": {"youngs_modulus": 1000, "poisson_ratio": 0.3, "bending": 1e-5}, "density": 0.15, "damping": 0.001, "friction": 0.3, "static_friction": 0.35, "contact_stiffness": 3e5}},
    "cloth": [
      {"name": "a", "grid": {"size": [1, 1]}, "triangles": 72, "material": "mine", "velocity": [0, 0, -1], "transform": {"translate": [0.1, 0.2, 1], "rotate": {"axis": [1, 2, 3], "angle_deg": 37}}},
      {"name": "b", "mesh": {"position": [[0, 0, 2], [1, 0, 2], [0, 1, 2]], "face": [[0, 1, 2]]}, "material": "silk"}
    ],
    "obstacles": [
      {"name": "ball", "sphere": {"radius": 0.3, "triangles": 320}, "motion": {"rotation_rate": [0, 0, 1], "oscillation": {"amplitude": [0.1, 0, 0], "period": 3}, "start": 0.5, "stop": 2}, "friction": 0.7, "static_friction": 0.9,
       "thickness": 0.003, "contact_stiffness": 4e6},
      {"name": "key", "box": {"size": [0.1, 0.1, 0.1]}, "transform": {"translate": [3, 0, 0]},
       "motion": {"keys": [{"time": 0}, {"time": 1, "translate": [0, 0, 1], "rotate": {"axis": [0, 0, 1], "angle_deg": 90}, "center": [3, 0, 0]}]}}
    ],
    "pins": [{"cloth": "a", "corners": ["top_left"], "vertices": [0], "release": 1.5, "motion": {"velocity": [0, 0, 0.1]}}, {"cloth": "b", "vertices": [1], "attach": "ball"}],
    "stitches": [{"a": {"cloth": "a", "vertex": 3}, "b": {"cloth": "b", "vertex": 0, "other": 2, "ratio": 0.25}, "stiffness": 500}]
  })",
                      ".");
}

}  // namespace

TEST_CASE("shipped scenes load, validate and meet the triangle count", "[scene]")
{
  for (const char *name : shipped)
    for (int resolution : {0, 5000, 50000}) {
      CAPTURE(name, resolution);
      const Scene s = Scene::load(scene_folder(name), resolution);
      CHECK(s.name == name);
      CHECK_NOTHROW(s.validate());
      if (resolution) CHECK(std::abs(s.cloth_triangle_count() - resolution) < 0.05 * resolution);
      CHECK(s.gravity.z == -9.81);
    }
  const auto step_of_the_paper = [](const char *name) {
    return chosen_time_step(Options::at(Accuracy::paper), Scene::load(scene_folder(name)));
  };
  CHECK(step_of_the_paper("funnel") == Approx(1.0 / 300));
  for (const char *name : {"drape", "sphere", "twisting"}) CHECK(step_of_the_paper(name) == Approx(1.0 / 200));
  for (const char *name : {"drape", "sphere", "funnel", "twisting"})
    CHECK(Scene::load(scene_folder(name)).cloths.size() == 3);
  const Scene large = Scene::load(scene_folder("drape"), 1000000);
  CHECK(std::abs(large.cloth_triangle_count() - 1000000) < 50000);
  CHECK_NOTHROW(large.validate());
}

TEST_CASE("shipped scenes start free of contact: gaps of at least 2.5 thicknesses", "[scene]")
{
  for (const char *name : shipped) {
    CAPTURE(name);
    const Scene s = Scene::load(scene_folder(name), 2000);
    double gap = 1;
    for (std::size_t i = 0; i < s.cloths.size(); ++i)
      for (const dvec3 &x : s.cloths[i].mesh.position) {
        const auto against = [&](const Mesh &m) {
          for (const Triangle &t : m.face)
            gap = std::min(gap, distance(x, m.position[t[0]], m.position[t[1]], m.position[t[2]]));
        };
        for (std::size_t j = 0; j < s.cloths.size(); ++j)
          if (j != i) against(s.cloths[j].mesh);
        for (const Obstacle &o : s.obstacles) against(o.mesh);
      }
    CHECK(gap >= 2.5 * s.contact.thickness);
  }
}

TEST_CASE("the garment is sewn from panels and sits around the body", "[scene]")
{
  const Scene s = Scene::load(scene_folder("garment"));
  REQUIRE(s.cloths.size() == 1);
  REQUIRE(s.pins.size() == 1);
  const Mesh &m = s.cloths[0].mesh;
  CHECK(m.material_position.size() > m.position.size());   // seams: shared in the world, separate in material space
  double lo = 9, hi = 0, top = -9;
  for (std::size_t f = 0; f < m.face.size(); ++f)
    for (int k = 0; k < 3; ++k) {
      const MaterialPoint &p = m.material_position[m.material_face[f][k]],
                          &q = m.material_position[m.material_face[f][(k + 1) % 3]];
      const double ratio =
          distance(m.position[m.face[f][k]], m.position[m.face[f][(k + 1) % 3]]) / std::hypot(p[0] - q[0], p[1] - q[1]);
      lo = std::min(lo, ratio);
      hi = std::max(hi, ratio);
    }
  CHECK(lo > 0.95);   // the gores fit the shape that they are sewn to
  CHECK(hi < 1.05);
  for (const dvec3 &x : m.position) top = std::max(top, x.z);
  for (int v : s.pins[0].vertices) CHECK(m.position[v].z == Approx(top));
  CHECK(s.pins[0].obstacle == 0);
  CHECK(s.obstacles[0].motion.sampled->time.back() >= s.frames * s.frame_time - 1e-9);
}

TEST_CASE("save and parse give the same scene, bit for bit", "[scene]")
{
  const Scene a = small_scene();
  a.validate();
  const std::string text = a.save();
  const Scene b = Scene::parse(text, "/nowhere");
  b.validate();
  CHECK(b.save() == text);
  CHECK(b.description == a.description);
  CHECK(b.time_step == a.time_step);
  CHECK(b.wind->velocity.z == 3);
  CHECK(b.contact.self == false);
  REQUIRE(b.cloths.size() == 2);
  CHECK(same(a.cloths[0].mesh.position, b.cloths[0].mesh.position));
  CHECK(a.cloths[0].mesh.material_position == b.cloths[0].mesh.material_position);
  CHECK(a.cloths[0].material.stretching == b.cloths[0].material.stretching);
  CHECK(b.cloths[1].material.name == "silk");
  CHECK(b.cloths[1].mesh.material_face.empty());
  CHECK(same(a.obstacles[0].mesh.position, b.obstacles[0].mesh.position));
  std::vector<dvec3> x, y;
  for (double t : {0.0, 0.7, 1.9, 5.0})
    for (int o : {0, 1}) {
      a.obstacles[o].motion.evaluate(t, a.obstacles[o].mesh.position, x);
      b.obstacles[o].motion.evaluate(t, b.obstacles[o].mesh.position, y);
      CHECK(same(x, y));
    }
  CHECK(b.pins[0].vertices == a.pins[0].vertices);
  CHECK(b.pins[0].release == 1.5);
  CHECK(std::isinf(b.pins[1].release));
  CHECK(b.pins[1].obstacle == 0);
  CHECK(b.stitches[0].ratio == 0.25);
  CHECK(b.stitches[0].vertex_c == 2);

  Scene odd = small_scene();   // doubles that are hard to print
  odd.cloths[1].mesh.position[0] = {-0.0, 0.1 + 0.2, 5e-324};
  odd.cloths[1].mesh.position[1] = {1152921504606846976.0, 1.7976931348623157e308, 1.0 / 3};
  CHECK(same(Scene::parse(odd.save(), ".").cloths[1].mesh.position, odd.cloths[1].mesh.position));
  odd.cloths[1].mesh.position[0].x = std::nan("");
  CHECK_THROWS_AS(odd.save(), SceneError);
}

TEST_CASE("selections find what they say", "[scene]")
{
  const Scene s = Scene::parse(
      R"({"cloth": [{"name": "c", "grid": {"size": [2, 1], "cells": [4, 2], "plane": "xz"}, "transform": {"translate": [0, 0, 3]}}],
    "pins": [{"cloth": "c", "edge": "top"}, {"cloth": 0, "corners": ["bottom_left", "top_right"]}, {"cloth": "c", "box": {"min": [-1.1, -1, 2], "max": [-0.9, 1, 4]}}]})",
      ".");
  CHECK(s.pins[0].vertices.size() == 5);
  for (int v : s.pins[0].vertices) CHECK(s.cloths[0].mesh.position[v].z == 3.5);
  REQUIRE(s.pins[1].vertices.size() == 2);
  CHECK(distance(s.cloths[0].mesh.position[s.pins[1].vertices[0]], {-1, 0, 2.5}) < 1e-12);
  CHECK(distance(s.cloths[0].mesh.position[s.pins[1].vertices[1]], {1, 0, 3.5}) < 1e-12);
  CHECK(s.pins[2].vertices.size() == 3);   // the left column
}

TEST_CASE("the triangle budget is shared by area, or as told", "[scene]")
{
  const char *text =
      R"({"cloth": [{"name": "a", "grid": {"size": [1, 1]}}, {"name": "b", "grid": {"size": [3, 1]} %s }]})";
  const auto counts = [&](const char *share) {
    char b[400];
    std::snprintf(b, sizeof b, text, share);
    const Scene s = Scene::parse(b, ".", 40000);
    return static_cast<double>(s.cloths[1].mesh.face.size()) / static_cast<double>(s.cloths[0].mesh.face.size());
  };
  CHECK(counts("") == Approx(3).epsilon(0.05));
  CHECK(counts(", \"share\": 1") == Approx(1).epsilon(0.05));
}

TEST_CASE("errors name the field", "[scene]")
{
  struct Case {
    const char *json, *part;
  };
  const char *cloth = R"("cloth": [{"name": "c", "grid": {"size": [1, 1]}}])";
  const auto with = [&](const std::string &more) { return "{" + std::string(cloth) + ", " + more + "}"; };
  CHECK(contains(parse_error("{"), "not JSON"));
  CHECK(contains(parse_error("{\"frames\": 1e400}"), "not JSON"));
  CHECK(contains(parse_error("{\"frames\": \"\xff\xfe\"}"), "UTF-8"));
  CHECK(contains(parse_error("{\"frames\": 1, \"gravity\": [0, 0, 0], \"frames\": 2}"), "\"frames\" appears twice"));
  CHECK(contains(parse_error(with("\"obstacles\": [{\"name\": \"o\", \"sphere\": {\"radius\": 1}}], \"pins\": "
                                  "[{\"cloth\": \"c\", \"vertices\": [0], "
                                  "\"attach\": \"o\", \"motion\": {\"velocity\": [1, 0, 0]}}]")),
                 "pins[0].motion: a pin that is attached"));
  CHECK(contains(parse_error(with("\"pins\": [{\"cloth\": \"c\", \"box\": {\"min\": [5, 5, 5], \"max\": [6, 6, 6]}}]")),
                 "pins[0].box: has no vertex in it; cloth \"c\" reaches from ("));
  CHECK(contains(parse_error("[]"), "expected an object"));
  CHECK(contains(parse_error("{}"), "the scene is empty"));
  CHECK(contains(parse_error(with("\"gravitty\": 1")), "unknown key \"gravitty\"; known keys: name, "));
  CHECK(contains(parse_error(R"({"cloth": [{"grid": {"size": [1, 1]}}, {"grid": {"size": [1]}}]})"),
                 "cloth[1].grid.size: expected a list of 2 numbers"));
  CHECK(contains(parse_error(R"({"cloth": [{"grid": {"size": [1, -1]}}]})"), "cloth[0].grid.size"));
  CHECK(contains(parse_error(R"({"cloth": [{"grid": {"size": [1, 1]}, "tube": {}}]})"), "give one shape"));
  CHECK(contains(parse_error(R"({"cloth": [{"name": "x"}]})"), "cloth[0]: has no shape"));
  CHECK(contains(parse_error(R"({"cloth": [{"grid": {"size": [1, 1]}, "material": "kevlar"}]})"),
                 "cloth[0].material: no fabric \"kevlar\""));
  CHECK(contains(parse_error(R"({"cloth": [{"file": "no_such.obj"}]})"), "no_such.obj: no such file"));
  CHECK(contains(parse_error(with("\"time_step\": 0")), "time_step: must be greater than 0"));
  CHECK(contains(parse_error(with("\"time_step\": \"fast\"")), "time_step: expected a number"));
  CHECK(contains(parse_error(with("\"contact\": {\"friction\": -1}")), "contact.friction"));
  CHECK(contains(parse_error(with("\"contact\": {\"thickness\": 0}")), "contact.thickness"));
  CHECK(contains(parse_error(with("\"pins\": [{\"cloth\": \"d\", \"vertices\": [0]}]")),
                 "pins[0].cloth: no cloth \"d\"; there are: \"c\""));
  CHECK(contains(parse_error(with("\"pins\": [{\"cloth\": \"c\", \"vertices\": [5, 99999]}]")),
                 "pins[0].vertices[1]: cloth \"c\" has no vertex 99999"));
  CHECK(contains(parse_error(with("\"pins\": [{\"cloth\": \"c\", \"edge\": \"rim\"}]")), "pins[0].edge"));
  CHECK(contains(parse_error(with("\"pins\": [{\"cloth\": \"c\"}]")), "pins[0]: selects no vertex"));
  CHECK(contains(parse_error(with("\"pins\": [{\"cloth\": \"c\", \"vertices\": [0], \"attach\": \"x\"}]")),
                 "pins[0].attach: no obstacle \"x\""));
  CHECK(contains(parse_error(with("\"obstacles\": [{\"sphere\": {\"radius\": 0}}]")), "obstacles[0].sphere.radius"));
  CHECK(contains(parse_error(with("\"obstacles\": [{\"sphere\": {}, \"friction\": -0.1}]")), "friction"));
  CHECK(contains(parse_error(with("\"obstacles\": [{\"sphere\": {}, \"transform\": {\"quaternion\": [1, 1, 0, 0]}}]")),
                 "transform.quaternion: must have length 1"));
  CHECK(contains(
      parse_error(with("\"obstacles\": [{\"sphere\": {}, \"motion\": {\"keys\": [{\"time\": 1}, {\"time\": 1}]}}]")),
      "motion.keys[1].time"));
  CHECK(contains(
      parse_error(with(
          "\"stitches\": [{\"a\": {\"cloth\": \"c\", \"vertex\": 999999}, \"b\": {\"cloth\": \"c\", \"vertex\": 0}}]")),
      "stitches[0].a.vertex"));
  CHECK(contains(parse_error(R"({"cloth": [{"mesh": {"position": [[0,0,0],[1,0,0],[0,1,0]], "face": [[0, 1, 7]]}}]})"),
                 "face 0 (0 1 7) uses vertex 7"));
  CHECK(contains(parse_error(R"({"cloth": [{"mesh": {"position": [], "face": []}}]})"), "is empty"));
  CHECK(contains(
      parse_error(R"({"cloth": [{"name": "c", "grid": {"size": [1, 1]}}, {"name": "c", "grid": {"size": [1, 1]}}]})"),
      "two cloths are named \"c\""));
  CHECK(
      contains(parse_error(R"({"materials": {"m": {"isotropic": {"youngs_modulus": 1}, "density": -1}}})"), "density"));
  CHECK(contains(parse_error(R"({"cloth": [{"garment": {"skirt": {"body": "b"}}}]})"),
                 "cloth[0].garment.skirt.body: no obstacle \"b\""));
  CHECK(contains(
      parse_error(
          R"({"obstacles": [{"name": "b", "sphere": {"radius": 0.2}}], "cloth": [{"garment": {"skirt": {"body": "b", "waist": 5}}}]})"),
      "no body at height 5"));
  CHECK(contains(thrown<FileError>([] { Scene::load("/no/such/scene"); }), "/no/such/scene"));
  CHECK_THROWS_AS(Scene::load(scene_folder("drape"), -5), SceneError);
}

TEST_CASE("what a material or obstacle leaves out of contact comes from the scene", "[scene]")
{
  // Cloth a and ball give all but a's thickness; cloth b is of a fabric, the key gives nothing.
  Scene s = small_scene();
  const ContactProperties a = s.contact_properties(0), ball = s.contact_properties(2), key = s.contact_properties(3);
  CHECK((a.thickness == 0.002 && a.stiffness == 3e5 && a.friction == 0.3 && a.static_friction == 0.35));
  CHECK((ball.thickness == 0.003 && ball.stiffness == 4e6 && ball.friction == 0.7 && ball.static_friction == 0.9));
  CHECK((key.thickness == 0.002 && key.stiffness == 1e6 && key.friction == 0.3 && key.static_friction == 0.3));
  s.cloths[0].material.friction = s.cloths[0].material.static_friction = -1;
  CHECK((s.contact_properties(0).friction == 0.33 && s.contact_properties(0).static_friction == 0.4));
  s.cloths[0].material.friction = 0.5;   // its own, so the scene's static one does not apply
  CHECK(s.contact_properties(0).static_friction == 0.5);
}

TEST_CASE("scenes made by a program are checked too", "[scene]")
{
  const auto broken = [](auto change) {
    Scene s = small_scene();
    change(s);
    return thrown<Error>([&] { s.validate(); });
  };
  CHECK(contains(broken([](Scene &s) { s.time_step = -1; }), "time_step"));
  CHECK(contains(broken([](Scene &s) { s.time_step = std::nan(""); }), "time_step"));
  CHECK(contains(broken([](Scene &s) { s.gravity.x = std::nan(""); }), "gravity"));
  CHECK(contains(broken([](Scene &s) { s.cloths.clear(); }), "empty"));
  CHECK(contains(broken([](Scene &s) { s.cloths[0].velocity.x = INFINITY; }), "velocity"));
  CHECK(contains(broken([](Scene &s) { s.cloths[0].mesh.position[3].x = std::nan(""); }), "cloth \"a\""));
  CHECK(contains(broken([](Scene &s) { s.cloths[0].material.density = -1; }), "density is -1"));
  CHECK(contains(broken([](Scene &s) { s.obstacles[0].friction = -1; }), "obstacle \"ball\": friction"));
  CHECK(
      contains(broken([](Scene &s) { s.obstacles[0].static_friction = 0.69; }), "obstacle \"ball\": static_friction"));
  CHECK(contains(broken([](Scene &s) { s.obstacles[0].static_friction = INFINITY; }),
                 "obstacle \"ball\": static_friction"));
  CHECK(contains(broken([](Scene &s) { s.obstacles[0].thickness = -1e-3; }), "obstacle \"ball\": thickness"));
  CHECK(
      contains(broken([](Scene &s) { s.obstacles[0].contact_stiffness = 0; }), "obstacle \"ball\": contact_stiffness"));
  CHECK(contains(broken([](Scene &s) { s.contact.static_friction = 0.32; }), "contact.static_friction"));
  CHECK(contains(broken([](Scene &s) { s.cloths[0].material.static_friction = 0.29; }), "static_friction"));
  CHECK(contains(broken([](Scene &s) {
                   s.cloths[0].material.friction = -1;
                   s.cloths[0].material.static_friction = 0.32;  // below the scene's 0.33
                 }),
                 "cloth \"a\": material.static_friction"));
  CHECK(contains(broken([](Scene &s) { s.obstacles[1].mesh.face[0][0] = 100000; }), "obstacle \"key\""));
  CHECK(contains(broken([](Scene &s) { s.pins[0].vertices[0] = -1; }), "pins[0].vertices[0]"));
  CHECK(contains(broken([](Scene &s) { s.pins[0].cloth = 9; }), "pins[0].cloth"));
  CHECK(contains(broken([](Scene &s) { s.pins[1].obstacle = 9; }), "pins[1].attach"));
  CHECK(contains(broken([](Scene &s) { s.stitches[0].vertex_a = 100000; }), "stitches[0].a.vertex"));
  CHECK(contains(broken([](Scene &s) { s.stitches[0].ratio = 2; }), "stitches[0].b.ratio"));
  CHECK(contains(broken([](Scene &s) { s.obstacles[0].motion.period = 0; }), "period"));
  CHECK(contains(broken([](Scene &s) {
                   auto a = std::make_shared<Motion::Sampled>();
                   a->time = {0};
                   a->position = {{{0, 0, 0}}};
                   s.obstacles[0].motion.sampled = a;
                 }),
                 "1 vertices"));
}

TEST_CASE("cloth from a file starts at rest unless its texture coordinates are asked for", "[scene]")
{
  const fs::path folder = fs::temp_directory_path();
  std::ofstream(folder / "cama_test_scene.obj")
      << "v 0 0 0\nv 0.5 0 0\nv 0 0.5 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n";
  const auto read = [&](const std::string &keys, const std::string &more = "") {
    return Scene::parse(R"({"cloth": [{"file": {"path": "cama_test_scene.obj")" + keys + "}" + more + "}]}", folder);
  };
  const Scene start = read("");
  CHECK(start.cloths[0].mesh.material_face.empty());
  CHECK(start.cloths[0].material_scale == 0);
  CHECK(read(R"(, "rest": "start")").cloths[0].mesh.material_face.empty());
  CHECK(read("", R"(, "transform": {"scale": 2})").cloths[0].mesh.position[1].x == 1);
  const Scene uv = read(R"(, "rest": "uv", "material_scale": 0.75)");
  CHECK(uv.cloths[0].mesh.material_position == std::vector<MaterialPoint>{{0, 0}, {0.75, 0}, {0, 0.75}});
  CHECK(uv.cloths[0].material_scale == 0.75);
  const Scene again = Scene::parse(uv.save(), ".");
  CHECK(again.cloths[0].mesh.material_position == uv.cloths[0].mesh.material_position);
  CHECK(again.cloths[0].mesh.material_face == uv.cloths[0].mesh.material_face);
  CHECK(Scene::parse(start.save(), ".").cloths[0].mesh.material_face.empty());
  CHECK(contains(thrown<SceneError>([&] { read(R"(, "material_space": true)"); }), "write \"rest\": \"uv\""));
  CHECK(contains(thrown<SceneError>([&] { read(R"(, "material_scale": 2)"); }), "cloth[0].file.material_scale"));
  CHECK(contains(thrown<SceneError>([&] { read(R"(, "weld": 0.06)"); }), "from 0 to 0.05 m"));
}

TEST_CASE("sewing lines of a file become stitches of the scene", "[scene][data]")
{
  const auto folder = test_data("garments/codim");
  if (!folder) return;
  const Scene s = Scene::parse(R"({"cloth": [{"name": "dress", "stitch_stiffness": 700, "file":
    {"path": "dress_knife_stage.obj", "rest": "uv", "positions": "dress_knife_drape_with_body.obj"}}]})",
                               *folder);
  CHECK_NOTHROW(s.validate());
  CHECK(s.cloths[0].material_scale == 1);
  CHECK(s.cloths[0].mesh.material_face.size() == 29456);
  REQUIRE(s.stitches.size() == 851);
  CHECK(s.stitches[0].stiffness == 700);
  const auto &x = s.cloths[0].mesh.position;   // draped by another solver, which kept the stitches closed
  double worst = 0;
  for (const Stitch &t : s.stitches)
    worst = std::max(worst, distance(x[t.vertex_a], kernels::dlerp(x[t.vertex_b], x[t.vertex_c], t.ratio)));
  CHECK(worst < 5e-4);
}

#if CAMA_HAS_ASSIMP
TEST_CASE("garments fit characters from files", "[scene][data]")
{
  const auto folder = test_data("characters");
  if (!folder) return;
  const auto scene = [&](const std::string &character, const std::string &garment) {
    return R"({"resolution": 4000, "contact": {"thickness": 1.5e-3}, "obstacles": [{"name": "body", "character": )" +
           character + R"(}], "cloth": [{"name": "skirt", "garment": {"skirt": {"body": "body", )" + garment +
           R"(}}, "material": "wool"}], "pins": [{"cloth": "skirt", "edge": "waist", "attach": "body"}]})";
  };
  for (const std::string &text :
       {scene(R"({"file": "makehuman_body.glb", "samples_per_second": 20})",
              R"("waist": 1.0, "length": 0.4, "panels": 8)"),
        scene(R"({"file": "ozz_arnaud.fbx", "animation_file": "ozz_pab_walk.fbx", "scale": 0.01, "lead_in": 1})",
              R"("waist": 1.1, "hip": 1.02, "length": 0.42, "panels": 8)"),
        scene(R"({"file": "CesiumMan.glb", "lead_in": 1})", R"("waist": 0.85, "length": 0.38)")}) {
    CAPTURE(text);
    const Scene s = Scene::parse(text, *folder);
    CHECK_NOTHROW(s.validate());
    double gap = 1;
    const Mesh &body = s.obstacles[0].mesh;
    for (const dvec3 &x : s.cloths[0].mesh.position)
      for (const Triangle &t : body.face)
        gap = std::min(gap, distance(x, body.position[t[0]], body.position[t[1]], body.position[t[2]]));
    CHECK(gap > 0.005);
  }
  // Arms beside the hips are in the way of a wide skirt: an error reports that, and they are not sewn in.
  const std::string walking =
      scene(R"({"file": "ozz_arnaud.fbx", "animation_file": "ozz_pab_walk.fbx", "scale": 0.01})",
            R"("waist": 1.05, "length": 0.5, "flare": 0.3)");
  CHECK(contains(thrown<SceneError>([&] { Scene::parse(walking, *folder); }), "in the way"));
}
#endif

TEST_CASE("a material space that is the start in other units is refused", "[scene]")
{
  Scene scene = small_scene();
  Mesh &m = scene.cloths[0].mesh;
  // The grid's own axes: with both factors 1 and no shear the rest shape is the start.
  const dvec3 o = m.position[0], side = kernels::dsub(m.position[m.face[0][2]], m.position[m.face[0][0]]);
  const dvec3 x = kernels::dnormalize(kernels::dsub(m.position[m.face[0][1]], m.position[m.face[0][0]]));
  const dvec3 y = kernels::dnormalize(kernels::daxpy(side, -kernels::ddot(side, x), x));
  const auto rest = [&](double along, double across, double shear) {
    m.material_face = m.face;
    m.material_position.clear();
    for (const dvec3 &p : m.position) {
      const double u = kernels::ddot(kernels::dsub(p, o), x), v = kernels::ddot(kernels::dsub(p, o), y);
      m.material_position.push_back({along * (u + shear * v), across * v});
    }
  };
  for (const auto &[factor, text] :
       {std::pair(100.0, "is 100 times as large"), std::pair(0.001, "is 1000 times as small"),
        std::pair(25.4, "is 25.4 times as large")}) {
    rest(factor, factor, 0);
    const std::string error = thrown<MeshError>([&] { scene.validate(); });
    CHECK(contains(error, "cloth \"a\""));
    CHECK(contains(error, text));
  }
  CHECK(contains((rest(100, 100, 0), thrown<MeshError>([&] { scene.validate(); })), "coordinates times 0.01 would"));
  scene.cloths[0].material_scale = 2;  // of texture coordinates: the unit that is right
  CHECK(contains(thrown<MeshError>([&] { scene.validate(); }), "material_scale 0.02 would"));
  for (const auto &[along, across, shear] :
       {std::tuple(1.0, 1.0, 0.0), std::tuple(2.9, 2.9, 0.0), std::tuple(1e6, 1e6, 0.0), std::tuple(2.9, 0.4, 0.0),
        std::tuple(1.0, 1.0, 1.0)}) {
    rest(along, across, shear);
    CHECK_NOTHROW(scene.validate());
  }
  for (const auto &[along, across, text] : {std::tuple(0.02, 0.04, "50 times as long one way and 25 times the other"),
                                            std::tuple(1.0, 4.0, "1 times as long one way and 0.25 times the other")}) {
    rest(along, across, 0);
    CHECK(contains(thrown<MeshError>([&] { scene.validate(); }), text));
  }
}
