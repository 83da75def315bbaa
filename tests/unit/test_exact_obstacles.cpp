// SPDX-License-Identifier: Apache-2.0
// Exact obstacles: where cloth rests on them, friction on a plane, no cloth inside them whatever they do, and which are
// rejected. Distances are measured by tests/judge.hpp, in long double, or by the code here.
#include "../catch.hpp"

#include <algorithm>
#include <cmath>

#include "../backends.hpp"
#include "../judge.hpp"
#include "../meshes.hpp"
#include "cama/error.hpp"
#include "cama/simulation.hpp"

using namespace cama;
using namespace cama::kernels;

namespace {

constexpr double pi = 3.14159265358979323846, gravity = 9.81;

using judge::Vec;
Vec wide(const dvec3 &x) { return {x.x, x.y, x.z}; }

/// The smallest distance of the cloth from the segment a b (a = b: from a point).
double cloth_to_segment(const Simulation &sim, const dvec3 &a, const dvec3 &b)
{
  const auto x = sim.positions();
  judge::Real least = 1e30L;
  const auto &faces = sim.faces();
  for (int f = 0; f < sim.cloth_triangle_count(); ++f) {
    const Vec t[3] = {wide(x[faces[f][0]]), wide(x[faces[f][1]]), wide(x[faces[f][2]])}, p = wide(a), q = wide(b);
    least = std::min({least, judge::point_triangle(p, t[0], t[1], t[2]), judge::point_triangle(q, t[0], t[1], t[2])});
    for (int k = 0; k < 3 && judge::length(q - p) > 0; ++k)
      least = std::min(least, judge::segment_segment(p, q, t[k], t[(k + 1) % 3]));
  }
  return static_cast<double>(least);
}

Options serial_options(LinearSolver solver = LinearSolver::conjugate_gradient)
{
  Options o;
  o.backend = "cpu";
  o.threads = 1;
  o.solver = solver;
  return o;
}

Scene with(Obstacle o, Mesh mesh, double time_step = 1.0 / 200)
{
  Scene s;
  s.time_step = time_step;
  s.cloths.push_back(meshes::cloth(std::move(mesh)));
  o.name = "body";
  s.obstacles.push_back(std::move(o));
  return s;
}

/// A sheet of 0.4 m in the xz plane that hangs by its upper corners, with its centre at the origin.
Scene curtain(Obstacle o, int cells)
{
  Mesh m = meshes::grid(cells, cells, 0.4, 0.4, -0.2, -0.2);
  for (dvec3 &x : m.position) x = {x.x, 0.002 * std::sin(20 * x.x) * std::sin(17 * x.y), x.y};
  Scene s = with(std::move(o), std::move(m));
  Pin pin;
  pin.vertices = {cells * (cells + 1), (cells + 1) * (cells + 1) - 1};
  s.pins.push_back(pin);
  return s;
}

struct Course {
  double least = 1e30;
  int intersections = 0, truncated = 0;
};

/// Takes steps and measures `distance` after each.
template <class Distance> Course follow(Simulation &sim, int steps, Distance distance)
{
  Course c;
  for (int n = 0; n < steps; ++n) {
    sim.step();
    c.least = std::min(c.least, distance());
    c.intersections += sim.count_intersections();
    c.truncated += sim.report().truncated;
  }
  return c;
}

dvec3 obstacle_point(const Simulation &sim, int k)
{
  return sim.positions()[static_cast<std::size_t>(sim.obstacle_ranges()[0].first + k)];
}

}  // namespace

TEST_CASE("a sheet rests on a plane where the penalty carries its weight", "[surfaces]")
{
  // Every vertex has one contact with its own area, on any mesh and in any frame: density g cos = k (thickness - gap).
  for (const double angle : {0.0, 0.3}) {
    const dvec3 normal{std::sin(angle), 0, std::cos(angle)}, down{std::cos(angle), 0, -std::sin(angle)},
        point{0.3, -0.2, 1.7};
    Mesh m = meshes::grid(6, 5, 0.3, 0.25);
    for (dvec3 &x : m.position) x = dadd(point, dadd(dadd(dscale(x.x, down), {0, x.y, 0}), dscale(1e-3, normal)));
    Obstacle plane = exact_plane(point, dscale(3, normal));
    plane.friction = 5;
    plane.contact_stiffness = 3e5;
    Scene s = with(plane, m);
    Simulation sim(s, serial_options(LinearSolver::direct));
    for (int n = 0; n < 400; ++n) sim.step();
    const double expected =
        s.contact.thickness - s.cloths[0].material.density * gravity * std::cos(angle) / (2 * 3e5 * 1e6 / 1.3e6);
    double off = 0;
    for (int v = 0; v < sim.cloth_vertex_count(); ++v)
      off = std::max(off, std::abs(ddot(normal, dsub(sim.positions()[static_cast<std::size_t>(v)], point)) - expected));
    CAPTURE(angle, expected, off);
    CHECK(off < 1e-3 * (s.contact.thickness - expected));
    CHECK(sim.report().contacts == sim.cloth_vertex_count());
    CHECK(sim.min_gap() == Approx(expected).epsilon(1e-5));
  }
}

TEST_CASE("on a plane a sheet of any mesh sticks up to the static coefficient and slides with the kinetic one",
          "[surfaces][friction]")
{
  const double angle = 26.57 * pi / 180, turn = 0.3, tangent = std::tan(angle);
  const dvec3 down{std::cos(angle), 0, -std::sin(angle)}, normal{std::sin(angle), 0, std::cos(angle)};
  struct Slide {
    double moved, acceleration;
  };
  const auto slide = [&](double friction, double static_friction, double duration,
                         bool loaded) {  // as in test_dynamics.cpp
    Mesh m = meshes::grid(6, 6, 0.05, 0.05, -0.025, -0.025);
    Scene s = with(exact_plane({0, 0, 0}, normal), {});
    const double gap = s.contact.thickness -
                       (loaded ? s.cloths[0].material.density * gravity * std::cos(angle) / s.contact.stiffness : 0);
    for (dvec3 &x : m.position) {
      const double u = x.x * std::cos(turn) - x.y * std::sin(turn), v = x.x * std::sin(turn) + x.y * std::cos(turn);
      x = dadd(dadd(dscale(u, down), {0, v, 0}), dscale(gap, normal));
    }
    s.cloths[0].mesh = m;
    s.obstacles[0].friction = friction;
    s.obstacles[0].static_friction = static_friction;
    Simulation sim(s, serial_options(LinearSolver::direct));
    const auto mean = [&](const std::vector<dvec3> &x) {
      double sum = 0;
      for (int v = 0; v < sim.cloth_vertex_count(); ++v)
        sum += ddot(x[static_cast<std::size_t>(v)], down) / sim.cloth_vertex_count();
      return sum;
    };
    for (int n = 0; n < 20; ++n) sim.step();
    const double x = mean(sim.positions()), v = mean(sim.velocities()), start = sim.time();
    while (sim.time() < start + duration - 1e-9) sim.step();
    return Slide{mean(sim.positions()) - x, (mean(sim.velocities()) - v) / (sim.time() - start)};
  };
  const Slide stick = slide(0.5 * tangent, 1.01 * tangent, 1, true),
              slip = slide(0.5 * tangent, 0.99 * tangent, 0.3, true);
  const Slide equal = slide(0.98 * tangent, -1, 0.5, false);
  const double g = gravity * std::sin(angle);
  CAPTURE(stick.moved, slip.acceleration / g, equal.acceleration / g);
  CHECK(std::abs(stick.moved) < 1e-3);
  CHECK(slip.acceleration == Approx(0.5 * g).epsilon(0.01));
  CHECK(std::abs(equal.acceleration - 0.02 * g) < 0.01 * g);
}

TEST_CASE("cloth falls on a sphere and never reaches into it", "[surfaces]")
{
  const double radius = 0.1;
  Scene s = with(exact_sphere({0, 0, -radius - 0.002}, radius), meshes::grid(16, 16, 0.4, 0.4, -0.2, -0.2));
  Simulation sim(s, serial_options());
  double highest = -1;
  const Course c =
      follow(sim, 120, [&] { return cloth_to_segment(sim, obstacle_point(sim, 0), obstacle_point(sim, 0)); });
  for (int v = 0; v < sim.cloth_vertex_count(); ++v)
    highest = std::max(highest, sim.positions()[static_cast<std::size_t>(v)].z);
  CAPTURE(c.least - radius, c.truncated, highest);
  CHECK(c.least >= radius);
  CHECK(c.least < radius + s.contact.thickness);  // it rests on it
  CHECK(c.intersections == 0);
  CHECK(highest > -0.01);
  CHECK(sim.min_gap() ==
        Approx(cloth_to_segment(sim, obstacle_point(sim, 0), obstacle_point(sim, 0)) - radius).epsilon(1e-6));
}

TEST_CASE("a ball at 100 m/s carries the cloth that it meets", "[surfaces]")
{
  const double radius = 0.05;
  Obstacle ball = exact_sphere({0.013, -0.3, 0.007}, radius);
  ball.motion.velocity = {0, 100, 0};
  ball.motion.stop = 0.02;  // 2 m
  for (const bool pinned : {true, false}) {
    Scene s = curtain(ball, 12);
    if (!pinned) s.pins.clear();
    Simulation sim(s, serial_options());
    const Course c =
        follow(sim, 8, [&] { return cloth_to_segment(sim, obstacle_point(sim, 0), obstacle_point(sim, 0)); });
    double front = -1;  // the cloth in front of the ball
    for (int v = 0; v < sim.cloth_vertex_count(); ++v)
      front = std::max(front, sim.positions()[static_cast<std::size_t>(v)].y);
    CAPTURE(pinned, c.least - radius, c.truncated, front);
    CHECK(obstacle_point(sim, 0).y == Approx(1.7));
    CHECK(c.least >= radius);
    CHECK(c.intersections == 0);
    CHECK(front > 1.7 + radius);
  }
}

TEST_CASE("a turning capsule sweeps through a curtain without reaching into it", "[surfaces]")
{
  const double radius = 0.03;
  Obstacle o = exact_capsule({-0.1, -0.15, -0.05}, {0.12, -0.15, 0.02}, radius);
  o.motion.velocity = {0, 1.5, 0};
  o.motion.rotation_rate = {1, 2, 8};
  o.motion.center = {0, -0.15, 0};
  Scene s = curtain(o, 14);
  Simulation sim(s, serial_options());
  const Course c =
      follow(sim, 60, [&] { return cloth_to_segment(sim, obstacle_point(sim, 0), obstacle_point(sim, 1)); });
  CAPTURE(c.least - radius, c.truncated);
  CHECK(c.least >= radius);
  CHECK(c.least < radius + s.contact.thickness);
  CHECK(c.intersections == 0);
  CHECK(dnorm(dsub(obstacle_point(sim, 0), obstacle_point(sim, 1))) == Approx(std::sqrt(0.22 * 0.22 + 0.07 * 0.07)));
}

TEST_CASE("a turning box sweeps through a curtain", "[surfaces]")
{
  Obstacle o = exact_box({0, -0.15, 0}, {0.12, 0.1, 0.14});
  o.motion.velocity = {0, 1.5, 0};
  o.motion.rotation_rate = {1, 2, 8};
  o.motion.center = {0, -0.15, 0};
  Scene s = curtain(o, 14);
  Simulation sim(s, serial_options());
  bool met = false;
  const Course c = follow(sim, 60, [&] {
    // Vertices of the cloth inside the box, in its own frame, and edges of the box through cloth triangles.
    const auto x = sim.positions();
    const std::size_t first = static_cast<std::size_t>(sim.obstacle_ranges()[0].first);
    double least = 1;
    for (int v = 0; v < sim.cloth_vertex_count(); ++v) {
      double outside = -1;
      for (int axis = 0; axis < 3; ++axis) {
        const dvec3 side = dsub(x[first + (1u << axis)], x[first]);
        const double h = ddot(dsub(x[static_cast<std::size_t>(v)], x[first]), side) / ddot(side, side);
        outside = std::max(outside, std::max(-h, h - 1) * dnorm(side));
      }
      least = std::min(least, outside);
    }
    met = met || least < s.contact.thickness;
    return least;
  });
  CAPTURE(c.least, c.truncated);
  CHECK(met);
  CHECK(c.least > 0);
  CHECK(c.intersections == 0);
}

TEST_CASE("a plane that rises carries a sheet, and nothing falls through one", "[surfaces]")
{
  Obstacle o = exact_plane({2, 1, -0.05}, {0.1, -0.2, 1});
  o.motion.velocity = {0.5, 0, 20};
  o.motion.stop = 0.05;
  Scene s = with(o, meshes::grid(10, 10, 0.4, 0.4, -0.2, -0.2, 0.1));
  s.cloths[0].velocity = {0, 0, -30};
  Simulation sim(s, serial_options());
  const dvec3 n = dnormalize({0.1, -0.2, 1});
  const Course c = follow(sim, 30, [&] {
    double least = 1;
    for (int v = 0; v < sim.cloth_vertex_count(); ++v)
      least = std::min(least, ddot(n, dsub(sim.positions()[static_cast<std::size_t>(v)], obstacle_point(sim, 0))));
    return least;
  });
  CAPTURE(c.least, c.truncated);
  CHECK(c.least >= 0.0099 * s.contact.thickness);
  CHECK(c.intersections == 0);
}

namespace {

/// All four exact shapes and a mesh at once, in motion.
Scene everything_exact(int cells = 12)
{
  Scene s = with(exact_plane({0, 0, -0.06}, {0, 0.1, 1}), meshes::grid(cells, cells, 0.3, 0.3, -0.15, -0.15, 0.004));
  s.cloths[0].velocity = {0.1, 0, -1};
  const auto add = [&](Obstacle o, const char *name, const dvec3 &velocity) {
    o.name = name;
    o.motion.velocity = velocity;
    s.obstacles.push_back(o);
  };
  add(exact_sphere({-0.08, 0, -0.042}, 0.04), "sphere", {0.2, 0.1, 0.3});
  add(exact_capsule({0.05, -0.1, -0.032}, {0.06, 0.02, -0.035}, 0.03), "capsule", {0, 0, 0.1});
  add(exact_box({0.03, 0.1, -0.03}, {0.05, 0.05, 0.05}), "box", {0, -0.1, 0.2});
  add(meshes::obstacle(meshes::sphere(8, 6, 0.03, {-0.1, 0.1, -0.04})), "mesh", {0, 0, 0.1});
  s.obstacles[2].static_friction = 0.6;
  return s;
}

}  // namespace

// A roof with its ridge along y; what is above it is closest to the ridge, between whose ends no vertex is near.
TEST_CASE("a sphere and the end of a capsule touch the ridge of a fold", "[surfaces]")
{
  const double radius = 0.05, gap = 1e-3;
  for (const bool capsule : {false, true}) {
    INFO((capsule ? "capsule" : "sphere"));
    const dvec3 center = {0.002, 0.03, radius + gap};
    Mesh roof;
    roof.position = {{0, -0.1, 0}, {0, 0.1, 0}, {-0.1, 0, -0.1}, {0.1, 0, -0.1}};
    roof.face = {{0, 1, 2}, {1, 0, 3}};
    Scene s = with(capsule ? exact_capsule(center, {0.002, 0.03, 0.3}, radius) : exact_sphere(center, radius), roof);
    s.contact.thickness = 4e-3;
    s.time_step = 1e-5;
    Simulation sim(s, serial_options());
    sim.step();
    const ContactArrays c = sim.contacts();
    REQUIRE(c.kind.size() == 2);  // one for each side of the ridge
    const double height = std::hypot(0.002, radius + gap);
    for (std::size_t i = 0; i < 2; ++i) {
      CHECK(c.kind[i] == 0);
      CHECK(c.distance[i] == Approx(height - radius).epsilon(1e-9));
      CHECK(dnorm(dsub(c.normal[i], dvec3{0.002 / height, 0, (radius + gap) / height})) < 1e-9);
      for (int k = 1; k < 4; ++k) {
        const int v = c.vertices[i][static_cast<std::size_t>(k)];  // at y = 0.03 of -0.1 to 0.1
        CHECK(c.weights[i][static_cast<std::size_t>(k)] == Approx(v == 0 ? -0.35 : v == 1 ? -0.65 : 0).margin(1e-9));
      }
    }
  }
}

TEST_CASE("contacts of vertices with exact obstacles are those of points with spheres, capsules and planes",
          "[surfaces]")
{
  const Scene s = everything_exact(24);
  Simulation sim(s, serial_options());
  int seen[5] = {0, 0, 0, 0, 0};
  for (int n = 0; n < 60; ++n) {
    const auto x = sim.positions();  // at which the contacts of the next step are found
    sim.step();
    const ContactArrays c = sim.contacts();
    const auto ranges = sim.obstacle_ranges();
    std::vector<std::array<int, 2>> have;
    for (std::size_t i = 0; i < c.kind.size(); ++i) {
      const int v = c.vertices[i][0];
      std::size_t o = 0;
      while (o < ranges.size() && !(c.vertices[i][1] >= ranges[o].first && c.vertices[i][1] < ranges[o].second)) ++o;
      if (c.kind[i] != 0 || o == ranges.size() || s.obstacles[o].shape == ObstacleShape::mesh ||
          s.obstacles[o].shape == ObstacleShape::box)
        continue;
      const Obstacle &body = s.obstacles[o];
      const dvec3 p = x[static_cast<std::size_t>(v)], a = x[static_cast<std::size_t>(ranges[o].first)];
      dvec3 away;
      double distance;
      if (body.shape == ObstacleShape::plane) {
        away = dnormalize({0, 0.1, 1});
        distance = ddot(away, dsub(p, a));
      } else {
        const dvec3 u = dsub(x[static_cast<std::size_t>(ranges[o].second - 1)], a);  // zero for a sphere
        const double t = ddot(u, u) > 0 ? std::clamp(ddot(dsub(p, a), u) / ddot(u, u), 0.0, 1.0) : 0;
        const dvec3 off = dsub(p, daxpy(a, t, u));
        away = dnormalize(off);
        distance = dnorm(off) - body.radius;
      }
      REQUIRE(std::abs(c.distance[i] - distance) < 1e-14);
      REQUIRE(dnorm(dsub(c.normal[i], away)) < 1e-12);
      ++seen[static_cast<int>(body.shape)];
      have.push_back({static_cast<int>(o), v});
    }
    for (std::size_t o = 0; o < ranges.size(); ++o)  // and none is missing
      if (s.obstacles[o].shape == ObstacleShape::sphere)
        for (int v = 0; v < sim.cloth_vertex_count(); ++v) {
          const double distance =
              dnorm(dsub(x[static_cast<std::size_t>(v)], x[static_cast<std::size_t>(ranges[o].first)])) -
              s.obstacles[o].radius;
          if (distance < s.contact.thickness)
            REQUIRE(std::count(have.begin(), have.end(), std::array<int, 2>{static_cast<int>(o), v}) == 1);
        }
  }
  CAPTURE(seen[1], seen[2], seen[4]);
  CHECK((seen[1] > 10 && seen[2] > 10 && seen[4] > 100));
}

TEST_CASE("exact obstacles give the same bits on every backend and number of threads", "[surfaces]")
{
  std::vector<std::string> names;
  std::vector<std::uint64_t> hashes;
  for (const std::string &name : {std::string("cpu"), std::string("opencl")})
    for (const int threads : {1, 3}) {
      if (name != "cpu" && (threads > 1 || !backend_here(name))) continue;
      Options o = serial_options();
      o.backend = name;
      o.threads = threads;
      Simulation sim(everything_exact(), o);
      int contacts = 0;
      for (int n = 0; n < 25; ++n) {
        sim.step();
        contacts = std::max(contacts, sim.report().contacts);
      }
      CHECK(contacts > 50);
      CHECK(sim.count_intersections() == 0);
      hashes.push_back(sim.state_hash());
    }
  for (std::uint64_t h : hashes) CHECK(h == hashes[0]);
}

TEST_CASE("the commit keeps each pair a hundredth of its own smallest thickness apart", "[surfaces][commit]")
{
  // A thick and a thin sheet are thrown at a plane with almost no penalty and no projection: they stop at the certified
  // distance. No weight presses them, since that would stiffen the contacts.
  Scene s = with(exact_plane({0, 0, 0}, {0, 0, 1}), meshes::grid(3, 3, 0.1, 0.1, 0, 0, 0.01));
  s.cloths.push_back(meshes::cloth(meshes::grid(3, 3, 0.1, 0.1, 0.3, 0, 0.01), meshes::cotton(), "thin"));
  s.contact.stiffness = 1e-3;
  s.gravity = {0, 0, 0};
  s.cloths[0].material.thickness = s.obstacles[0].thickness = 4e-3;
  s.cloths[1].material.thickness = 1e-4;
  s.cloths[0].velocity = s.cloths[1].velocity = {0, 0, -5};
  Options o = serial_options();
  o.max_impact_passes = 0;
  Simulation sim(s, o);
  double lowest_of[2] = {1, 1};
  for (int n = 0; n < 40; ++n) {
    sim.step();
    const std::vector<dvec3> x = sim.positions();
    for (std::size_t cloth = 0; cloth < 2; ++cloth)
      for (int v = sim.cloth_ranges()[cloth].first; v < sim.cloth_ranges()[cloth].second; ++v)
        lowest_of[cloth] = std::min(lowest_of[cloth], x[static_cast<std::size_t>(v)].z);
  }
  for (const auto &[cloth, thickness] : {std::pair{0, 4e-3}, std::pair{1, 1e-4}}) {
    const double lowest = lowest_of[cloth];
    CAPTURE(cloth, lowest);
    CHECK(lowest >= 0.00999 * thickness);
    CHECK(lowest < 0.012 * thickness);
  }
}

TEST_CASE("exact obstacles far away do not change the cloth by one bit", "[surfaces]")
{
  Scene far = everything_exact();
  for (const auto &[name, o] :
       {std::pair{"deep", exact_plane({0, 0, -50}, {0.2, 0, 1})}, std::pair{"moon", exact_sphere({0, 30, 40}, 7)}}) {
    far.obstacles.push_back(o);
    far.obstacles.back().name = name;
  }
  Simulation a(everything_exact(), serial_options()), b(far, serial_options());
  for (int n = 0; n < 25; ++n) {
    a.step();
    b.step();
  }
  CHECK(a.state_hash() == b.state_hash());
}

TEST_CASE("every way of assembly takes exact obstacles", "[surfaces]")
{
  for (const char *accuracy : {"production", "paper"})
    for (const Assembly assembly : {Assembly::gather, Assembly::algorithm1, Assembly::sorted}) {
      Options o = Options::at(accuracy_level(accuracy));
      if (o.paper.contact_form == ContactForm::star && assembly == Assembly::gather) continue;
      o.backend = "cpu";
      o.threads = 1;
      o.paper.assembly = assembly;
      o.commit = true;
      Simulation sim(everything_exact(), o);
      for (int n = 0; n < 25; ++n) sim.step();
      CAPTURE(accuracy, static_cast<int>(assembly));
      CHECK(sim.count_intersections() == 0);
    }
}

TEST_CASE("starts inside exact obstacles are refused and counted", "[surfaces]")
{
  const Mesh sheet = meshes::grid(4, 4, 0.4, 0.4, -0.2, -0.2);
  const auto refused = [&](const Obstacle &o) {
    const Scene s = with(o, sheet);
    Options unchecked = serial_options();
    unchecked.intersections = StartPolicy::exempt;
    CHECK(Simulation(s, unchecked).count_intersections() > 0);
    return thrown<CollisionError>([&] { Simulation(s, serial_options()); });
  };
  CHECK(contains(refused(exact_sphere({0.01, 0.02, 0.04}, 0.05)), "triangle"));
  // It passes through a triangle.
  CHECK(contains(refused(exact_capsule({0.01, 0.02, -0.3}, {0.02, 0.02, 0.3}, 0.001)), "reaches into obstacle 'body'"));
  CHECK(contains(refused(exact_box({0, 0, 0}, {0.1, 0.1, 0.1})), "body"));
  CHECK(contains(refused(exact_plane({5, 5, 0.001}, {0, 0, 1})), "below obstacle 'body'"));
  CHECK_NOTHROW(Simulation(with(exact_plane({5, 5, -0.001}, {0, 0, 1}), sheet), serial_options()));
  CHECK_NOTHROW(Simulation(with(exact_sphere({0.01, 0.02, 0.051}, 0.05), sheet), serial_options()));
}

TEST_CASE("exact obstacles from a file: placed, scaled, saved, and rejected with the field", "[surfaces][scene]")
{
  const auto scene = [](const std::string &obstacle) {
    return R"({"cloth": [{"name": "c", "grid": {"size": [1, 1]}, "triangles": 8}], "obstacles": [{"name": "o", )" +
           obstacle + "}]}";
  };
  const auto parse = [&](const std::string &obstacle) { return Scene::parse(scene(obstacle), "."); };
  const std::string place =
      R"(, "transform": {"translate": [1, 2, 3], "scale": 2, "rotate": {"axis": [1, 0, 0], "angle_deg": 90}})";
  const Obstacle sphere = parse(R"("shape": {"sphere": {"radius": 0.3}})" + place).obstacles[0];
  CHECK((sphere.shape == ObstacleShape::sphere && sphere.radius == 0.6 && sphere.mesh.position[0].y == 2));
  const Obstacle capsule = parse(R"("shape": {"capsule": {"radius": 0.1, "length": 1}})" + place).obstacles[0];
  CHECK(capsule.mesh.position[1].y - capsule.mesh.position[0].y == Approx(-2));
  const Obstacle plane = parse(R"("shape": {"plane": {"normal": [0, 0, 2]}})" + place).obstacles[0];
  const auto &p = plane.mesh.position;
  CHECK(dnorm(dsub(dnormalize(dcross(dsub(p[1], p[0]), dsub(p[2], p[0]))), {0, -1, 0})) < 1e-12);
  for (const char *shape : {R"("sphere": {"radius": 0.3})", R"("capsule": {"radius": 0.1, "length": 1})",
                            R"("plane": {})", R"("box": {"size": [1, 2, 3]})"}) {
    const Scene first = parse("\"shape\": {" + std::string(shape) + "}" + place);
    first.validate();
    CHECK(Scene::parse(first.save(), ".").save() == first.save());
    CHECK(Scene::parse(first.save(), ".").obstacles[0].shape == first.obstacles[0].shape);
  }
  const auto error = [&](const std::string &obstacle) {
    return thrown<SceneError>([&] { parse(obstacle).validate(); });
  };
  CHECK(contains(error(R"("shape": {"sphere": {"radius": 0}})"), "obstacles[0].shape.sphere.radius"));
  CHECK(contains(error(R"("shape": {"cone": {}})"), "unknown key \"cone\""));
  CHECK(contains(error(R"("shape": {"plane": {}, "sphere": {}})"), "exactly one"));
  CHECK(contains(error(R"("shape": {"plane": {"normal": [0, 0, 0]}})"), "normal"));
  CHECK(contains(
      error(R"("shape": {"box": {"points": [[0,0,0],[1,0,0],[0,1,0],[1,1,0],[0,0,1],[1,0,1],[0,1,1],[1,1,1.01]]}})"),
      "corners"));
  CHECK(contains(error(R"("shape": {"plane": {}}, "motion": {"rotation_rate": [0, 0, 1]})"), "use a box"));
  CHECK(contains(
      error(
          R"("shape": {"plane": {}}, "motion": {"keys": [{"time": 0}, {"time": 1, "rotate": {"axis": [1, 0, 0], "angle_deg": 5}}]})"),
      "use a box"));
  CHECK(contains(error(R"("shape": {"sphere": {}}, "motion": {"keys": [{"time": 0}, {"time": 1, "scale": 2}]})"),
                 "cannot be scaled"));
  CHECK(contains(thrown<SceneError>([&] {
                   Scene s = parse(R"("shape": {"sphere": {}})");
                   Pin pin;
                   pin.vertices = {0};
                   pin.obstacle = 0;
                   s.pins.push_back(pin);
                   s.validate();
                 }),
                 "has no mesh to follow"));
}
