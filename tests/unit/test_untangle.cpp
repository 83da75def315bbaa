// SPDX-License-Identifier: Apache-2.0
// Starts that intersect: the report by objects, and untangling checked by the exact audit, displacements and bits.
#include "../catch.hpp"

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>

#include "../meshes.hpp"
#include "cama/error.hpp"
#include "cama/intersections.hpp"
#include "cama/simulation.hpp"
#include "cama/untangle.hpp"

using namespace cama;

namespace {

constexpr int cells = 16;
constexpr double size = 0.4, edge = size / cells;

class Random {
public:
  explicit Random(unsigned seed) : engine_(seed) {}
  double operator()(double lo, double hi) { return lo + (hi - lo) * static_cast<double>(engine_()) / 4294967295.0; }

private:
  std::mt19937 engine_;
};

/// A square sheet around the origin, vertices shifted by up to `noise`.
Mesh sheet(Random &random, double noise)
{
  Mesh m = meshes::grid(cells, cells, size, size, -size / 2, -size / 2);
  for (dvec3 &x : m.position)
    x = {x.x + random(-noise, noise), x.y + random(-noise, noise), x.z + random(-noise, noise)};
  return m;
}

template <class Move> Mesh moved(Mesh m, Move &&move)
{
  for (dvec3 &x : m.position) x = move(x);
  return m;
}

/// About the y axis, then about the z axis.
dvec3 turned(dvec3 x, double y_angle, double z_angle)
{
  const double c = std::cos(y_angle), s = std::sin(y_angle), px = c * x.x + s * x.z, pz = c * x.z - s * x.x;
  return {std::cos(z_angle) * px - std::sin(z_angle) * x.y, std::sin(z_angle) * px + std::cos(z_angle) * x.y, pz};
}

Scene tangled(const std::string &kind, unsigned seed)
{
  Random random(seed);
  Scene s;
  s.time_step = 1.0 / 200;
  Mesh a = sheet(random, 0.04 * edge), b = sheet(random, 0.04 * edge);
  if (kind == "line") {   // b passes through the middle of a, one and a half edges deep
    const double tilt = random(0.3, 1.2), spin = random(-0.2, 0.2);
    b = moved(b, [&](dvec3 x) { return turned({x.x + size / 2 - 1.5 * edge, x.y, x.z}, tilt, spin); });
  } else if (kind == "corner") {   // b stands on a corner of a, two edges deep
    const double tilt = random(0.8, 1.5);
    b = moved(b, [&](dvec3 x) {
      const double d = std::sqrt(0.5);
      const dvec3 y = turned({d * (x.x - x.y) + d * size, d * (x.x + x.y), x.z}, -tilt, 0);
      return dvec3{y.x + 1.2 * edge, y.y + 0.8 * edge, y.z - 2.2 * edge};
    });
  } else if (kind == "fold") {   // bent by more than a half turn, until the flap passes through the rest
    const double radius = 0.03, angle = 3.14159 + random(0.9, 1.0);
    a = moved(a, [&](dvec3 x) {
      const double arc = std::min(std::max(x.x, 0.0), radius * angle), rest = std::max(x.x - radius * angle, 0.0),
                   p = arc / radius;
      const double px = std::min(x.x, 0.0) + radius * std::sin(p) + rest * std::cos(p);
      return dvec3{px, x.y + 0.03 * px, radius * (1 - std::cos(p)) + rest * std::sin(p) + x.z};
    });
  } else if (kind == "sphere") {
    const double depth = random(0.3, 1.5) * edge;
    a = moved(a, [&](dvec3 x) { return dvec3{x.x, x.y, x.z + 0.15 - depth}; });
    s.obstacles.push_back(meshes::obstacle(meshes::sphere(24, 14, 0.15), {}, "ball"));
  } else if (kind == "poke") {
    b = moved(b, [&](dvec3 x) { return dvec3{x.x, x.y, x.z + 0.25 * edge}; });
    for (int k = 0; k < 6; ++k) b.position[static_cast<std::size_t>(random(0, 288.99))].z -= 0.6 * edge;
  } else {   // "slit": each cuts into the other from its border
    b = moved(b, [&](dvec3 x) { return dvec3{x.x + size - 1.6 * edge, 0.01 - x.z, x.y + 0.013}; });
  }
  s.cloths.push_back(meshes::cloth(a, meshes::cotton(), "a"));
  if (kind != "fold" && kind != "sphere") s.cloths.push_back(meshes::cloth(b, meshes::cotton(), "b"));
  return s;
}

int count(const Scene &s)
{
  std::size_t n = 0;
  for (const ObjectIntersections &pair : start_intersections(s)) n += pair.piercings.size();
  return static_cast<int>(n);
}

bool same_bits(const dvec3 &a, const dvec3 &b) { return std::memcmp(&a, &b, sizeof a) == 0; }

}  // namespace

TEST_CASE("crossing sheets, corners, folds, spheres, pokes and slits are untangled", "[untangle]")
{
  for (const std::string kind : {"line", "corner", "fold", "sphere", "poke", "slit"})
    for (unsigned seed = 0; seed < 25; ++seed) {
      INFO(kind << ", seed " << seed);
      const Scene start = tangled(kind, seed);
      Scene scene = start;
      const UntangleReport report = untangle(scene);
      REQUIRE(report.before == count(start));
      REQUIRE(report.before > 0);
      REQUIRE(report.clean);
      REQUIRE(report.after == 0);
      REQUIRE(count(scene) == 0);
      REQUIRE(report.smallest_gap > 0);
      // No crossing here is deeper than two and a half edges; a contour without a smaller side may need twice that.
      REQUIRE(report.largest_move < 5 * edge);
      int moved_vertices = 0;
      for (std::size_t c = 0; c < scene.cloths.size(); ++c)
        for (std::size_t v = 0; v < scene.cloths[c].mesh.position.size(); ++v)
          moved_vertices += !same_bits(scene.cloths[c].mesh.position[v], start.cloths[c].mesh.position[v]);
      REQUIRE(moved_vertices == report.moved);
    }
}

TEST_CASE("far vertices keep every bit, pins stay, and the result repeats", "[untangle]")
{
  Scene start = tangled("line", 3);
  Pin pin;
  pin.cloth = 0;
  for (int j = 0; j <= cells; ++j) pin.vertices.push_back(j * (cells + 1) + 5);  // beside the contour
  Scene free = start;
  untangle(free);
  CHECK_FALSE(same_bits(free.cloths[0].mesh.position[pin.vertices[8]], start.cloths[0].mesh.position[pin.vertices[8]]));
  start.pins.push_back(pin);
  Scene scene = start, again = start;
  REQUIRE(untangle(scene).clean);
  untangle(again);
  for (int v : pin.vertices) CHECK(same_bits(scene.cloths[0].mesh.position[v], start.cloths[0].mesh.position[v]));
  for (int j = 0; j <= cells; ++j)  // the contour is between b's columns 1 and 2; columns from 8 on are far
    for (int i = 8; i <= cells; ++i) {
      const std::size_t v = static_cast<std::size_t>(j * (cells + 1) + i);
      REQUIRE(same_bits(scene.cloths[1].mesh.position[v], start.cloths[1].mesh.position[v]));
    }
  for (std::size_t c = 0; c < 2; ++c)
    for (std::size_t v = 0; v < scene.cloths[c].mesh.position.size(); ++v)
      REQUIRE(same_bits(scene.cloths[c].mesh.position[v], again.cloths[c].mesh.position[v]));
}

TEST_CASE("a clean start is left alone", "[untangle]")
{
  Scene scene = meshes::pile(6);
  const Scene start = scene;
  const UntangleReport report = untangle(scene);
  CHECK(report.clean);
  CHECK(report.before == 0);
  CHECK(report.moved == 0);
  CHECK(same_bits(scene.cloths[0].mesh.position[7], start.cloths[0].mesh.position[7]));
}

TEST_CASE("what cannot move is reported and refused", "[untangle]")
{
  Scene scene = tangled("poke", 1);
  for (int c = 0; c < 2; ++c) {
    Pin pin;
    pin.cloth = c;
    for (std::size_t v = 0; v < scene.cloths[c].mesh.position.size(); ++v) pin.vertices.push_back(static_cast<int>(v));
    scene.pins.push_back(pin);
  }
  Options options;
  options.backend = "cpu";
  options.intersections = StartPolicy::untangle;
  CHECK_THROWS_AS(Simulation(scene, options), CollisionError);
  const int before = count(scene);
  UntangleOptions few;
  few.max_rounds = 20;
  const UntangleReport report = untangle(scene, few);
  CHECK_FALSE(report.clean);
  CHECK(report.after == before);
  CHECK(report.moved == 0);
}

TEST_CASE("the policies at the start of a simulation", "[untangle]")
{
  const Scene scene = tangled("sphere", 2);
  Options options;
  options.backend = "cpu";
  options.threads = 1;
  try {
    Simulation refused(scene, options);
    FAIL("not refused");
  } catch (const CollisionError &e) {
    const std::string text = e.what();
    CHECK(text.find(std::to_string(count(scene)) + " of cloth 'a' with obstacle 'ball'") != std::string::npos);
    CHECK(text.find("cama check SCENE --mesh") != std::string::npos);
    CHECK(text.find("untangle") != std::string::npos);
  }
  options.intersections = StartPolicy::exempt;
  CHECK(Simulation(scene, options).count_intersections() == count(scene));
  options.intersections = StartPolicy::untangle;
  Simulation simulation(scene, options);
  CHECK(simulation.untangled().clean);
  CHECK(simulation.untangled().before == count(scene));
  for (int step = 0; step < 5; ++step) {
    simulation.step();
    CHECK(simulation.count_intersections() == 0);
  }
}

TEST_CASE("intersections by objects, in the objects' own numbers", "[untangle]")
{
  // One triangle stands through another: edges 0-1 and 0-2 of "up" (its face 0) pass through face 0 of "flat", at x =
  // 0.4 and 0.6.
  Scene scene;
  scene.time_step = 1.0 / 200;
  Mesh far = meshes::grid(2, 2, 1, 1, 10, 10), flat, up;
  flat.position = {{0, -1, 0}, {1, 1, 0}, {-1, 1, 0}};
  flat.face = {{0, 1, 2}};
  up.position = {{0, 0.5, -1}, {0.2, 0.5, 1}, {-0.2, 0.5, 1}};
  up.face = {{0, 1, 2}};
  scene.cloths = {meshes::cloth(far, meshes::cotton(), "far"), meshes::cloth(up, meshes::cotton(), "up")};
  scene.obstacles.push_back(meshes::obstacle(flat, {}, "flat"));
  const auto found = start_intersections(scene);
  REQUIRE(found.size() == 1);
  CHECK(found[0].first_name == "cloth 'up'");
  CHECK(found[0].second_name == "obstacle 'flat'");
  CHECK(found[0].first == 1);
  CHECK(found[0].second == 2);
  REQUIRE(found[0].piercings.size() == 2);
  CHECK(found[0].piercings[0].edge == std::array<int, 2>{0, 1});
  CHECK(found[0].piercings[1].edge == std::array<int, 2>{0, 2});
  CHECK(found[0].piercings[0].face == 0);
  CHECK(found[0].mean.x == Approx(0).margin(1e-15));
  CHECK(found[0].lower.x == Approx(-0.1));
  CHECK(found[0].upper.x == Approx(0.1));
  CHECK(found[0].mean.y == Approx(0.5));

  const auto folder = std::filesystem::temp_directory_path();
  for (const std::string suffix : {".obj", ".ply"}) {
    const auto file = folder / ("cama_test_untangle" + suffix);
    save_intersections(file, scene, found);
    std::stringstream text;
    text << std::ifstream(file).rdbuf();
    CHECK(text.str().find(suffix == ".obj" ? "g cloth__up__with_obstacle__flat_\nf " : "element face 2\n") !=
          std::string::npos);
    std::filesystem::remove(file);
  }
  CHECK_THROWS_AS(save_intersections(folder / "x.stl", scene, found), FileError);
  CHECK_THROWS_AS(save_intersections(folder / "no_such_folder" / "x.ply", scene, found), FileError);
}
