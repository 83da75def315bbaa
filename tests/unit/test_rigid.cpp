// SPDX-License-Identifier: Apache-2.0
// Rigid obstacles that cloth and gravity move: mass properties, free motion, and momentum that cloth and bodies
// exchange.
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "../backends.hpp"
#include "../catch.hpp"
#include "../engine.hpp"
#include "../meshes.hpp"
#include "cama/error.hpp"
#include "cama/generators.hpp"
#include "cama/simulation.hpp"

using namespace cama;
using namespace cama::kernels;

namespace {

constexpr double pi = 3.14159265358979323846;

Mesh moved(Mesh mesh, const dvec3 &by)
{
  for (dvec3 &x : mesh.position) x = dadd(x, by);
  return mesh;
}

Obstacle rigid(Mesh mesh, double mass, const std::string &name = "body")
{
  Obstacle o = meshes::obstacle(std::move(mesh), {}, name);
  o.rigid.emplace();
  o.rigid->mass = mass;
  return o;
}

/// A body far from a small cloth, which every scene must have.
Scene alone(Obstacle body)
{
  Scene s;
  s.time_step = 0.005;
  s.gravity = {0, 0, -9.81};
  s.cloths.push_back(meshes::cloth(meshes::grid(2, 2, 0.1, 0.1, 20, 20, 20)));
  s.obstacles.push_back(std::move(body));
  return s;
}

Options options(const std::string &integrator = "bdf2")
{
  Options o = serial();
  o.time_step = 0.005;
  o.integrator = integrator == "bdf2" ? Integrator::bdf2 : Integrator::backward_euler;
  return o;
}

double largest(const dvec3 &v) { return std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)}); }

/// Linear and angular momentum about the origin of all cloth, and of the first obstacle.
struct Momentum {
  dvec3 linear{0, 0, 0}, angular{0, 0, 0};
};
Momentum momentum(const Simulation &s, double mass)
{
  Momentum m;
  const std::vector<dvec3> x = s.positions(), v = s.velocities();
  const std::vector<double> masses = s.masses();
  for (std::size_t i = 0; i < masses.size(); ++i) {
    m.linear = daxpy(m.linear, masses[i], v[i]);
    m.angular = daxpy(m.angular, masses[i], dcross(x[i], v[i]));
  }
  const RigidPose p = s.rigid_pose(0);
  m.linear = daxpy(m.linear, mass, p.velocity);
  m.angular = dadd(m.angular, dadd(p.angular_momentum, dscale(mass, dcross(p.center, p.velocity))));
  return m;
}

/// A ball of 0.1 kg flies into a free sheet, off its centre.
Scene ball_into_sheet()
{
  Scene s;
  s.time_step = 0.005;
  s.gravity = {0, 0, 0};
  s.contact.thickness = 2e-3;
  s.cloths.push_back(meshes::cloth(meshes::grid(16, 16, 0.4, 0.4, -0.2, -0.2, 0)));
  s.obstacles.push_back(rigid(make_sphere(0.06, 320), 0.1));
  for (dvec3 &x : s.obstacles[0].mesh.position) x = dadd(x, {0.03, 0.01, 0.07});
  s.obstacles[0].rigid->velocity = {0, 0, -1};
  s.obstacles[0].rigid->angular_velocity = {2, 0, 5};
  return s;
}

/// A ball of 0.5 kg above a sheet that hangs by its four corners.
Scene hammock()
{
  Scene s;
  s.time_step = 0.005;
  s.contact.thickness = 2e-3;
  s.cloths.push_back(meshes::cloth(meshes::grid(20, 20, 0.5, 0.5, -0.25, -0.25, 0)));
  s.cloths[0].material.damping = 0.1;
  Pin pin;
  pin.vertices = {0, 20, 420, 440};
  s.pins.push_back(pin);
  s.obstacles.push_back(rigid(moved(make_sphere(0.08, 500), {0, 0, 0.085}), 0.5));
  return s;
}

}  // namespace

TEST_CASE("the mass properties of a box, off the origin and turned inside out, are those of the closed form", "[rigid]")
{
  const dvec3 size{0.2, 0.3, 0.5}, center{3, -2, 1};
  Mesh mesh = moved(make_box(size, 300), center);
  for (int inside_out = 0; inside_out < 2; ++inside_out) {
    const MassProperties p = solid_properties("box", mesh, 700);
    const double m = 700 * size.x * size.y * size.z;
    CHECK(p.mass == Approx(m).epsilon(1e-12));
    CHECK(largest(dsub(p.center, center)) < 1e-12);
    const double expected[6] = {m / 12 * (size.y * size.y + size.z * size.z),
                                m / 12 * (size.z * size.z + size.x * size.x),
                                m / 12 * (size.x * size.x + size.y * size.y),
                                0,
                                0,
                                0};
    for (std::size_t k = 0; k < 6; ++k) CHECK(std::abs(p.inertia[k] - expected[k]) < 1e-10 * m);
    for (Triangle &f : mesh.face) std::swap(f[1], f[2]);
  }
}

TEST_CASE("the products of inertia of a tetrahedron are those of the closed form", "[rigid]")
{
  Mesh mesh;  // corners at the origin and at 1 on each axis: integrals of x y are 1/120, of x x 1/60, the centre 1/4
  mesh.position = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  mesh.face = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  const MassProperties p = solid_properties("tetrahedron", mesh, 6);
  CHECK(p.mass == Approx(1).epsilon(1e-13));
  CHECK(largest(dsub(p.center, {0.25, 0.25, 0.25})) < 1e-14);
  for (std::size_t k = 0; k < 3; ++k) CHECK(p.inertia[k] == Approx(2 * (6.0 / 60 - 1.0 / 16)).epsilon(1e-12));
  for (std::size_t k = 3; k < 6; ++k) CHECK(p.inertia[k] == Approx(-(6.0 / 120 - 1.0 / 16)).epsilon(1e-12));
}

TEST_CASE("a body alone falls as the integrator's closed form says", "[rigid]")
{
  Obstacle ball = rigid(make_sphere(0.1, 80), 2.5);
  ball.rigid->velocity = {0.3, 0, 1};
  const Scene scene = alone(ball);
  for (const std::string integrator : {"bdf2", "backward_euler"}) {
    Simulation s(scene, options(integrator));
    const int steps = 40;
    for (int i = 0; i < steps; ++i) s.step();
    const double h = 0.005, t = steps * h, g = 9.81;
    // The first step of either is backward Euler's, which is g h^2 / 2 off; BDF2 adds half as much in all.
    const double off = integrator == "bdf2" ? 0.75 * g * h * h * (1 - std::pow(3.0, -steps)) : g * h * t / 2;
    const RigidPose p = s.rigid_pose(0);
    CHECK(largest(dsub(p.velocity, {0.3, 0, 1 - g * t})) < 1e-12);
    CHECK(largest(dsub(p.center, {0.3 * t, 0, t - g * t * t / 2 - off})) < 1e-12);
    const dvec3 top = s.positions()[9];   // the first vertex of the ball
    CHECK(largest(dsub(dsub(top, p.center), scene.obstacles[0].mesh.position[0])) < 1e-12);
  }
}

TEST_CASE("a free body keeps its angular momentum, and its axis precesses about it as a symmetric top's", "[rigid]")
{
  Obstacle top = rigid(make_box({0.2, 0.2, 0.05}), 1);
  top.rigid->angular_velocity = {3, 0, 8};
  Scene scene = alone(top);
  scene.gravity = {0, 0, 0};
  const double lateral = (0.2 * 0.2 + 0.05 * 0.05) / 12, axial = 2 * 0.2 * 0.2 / 12;
  const dvec3 momentum{lateral * 3, 0, axial * 8};
  const double duration = 0.4, rate = dnorm(momentum) / lateral;
  // Rodrigues: the axis z turns about the momentum.
  const dvec3 k = dnormalize(momentum), z{0, 0, 1};
  const double c = std::cos(rate * duration), s = std::sin(rate * duration);
  const dvec3 expected = dadd(dadd(dscale(c, z), dscale(s, dcross(k, z))), dscale(ddot(k, z) * (1 - c), k));
  double error[2];
  for (int fine = 0; fine < 2; ++fine) {
    Options o = options();
    o.time_step = fine ? 0.001 : 0.002;
    Simulation sim(scene, o);
    while (sim.time() < duration - 1e-9) sim.step();
    const RigidPose p = sim.rigid_pose(0);
    CHECK(largest(dsub(p.angular_momentum, momentum)) < 1e-15);  // rounding of the first product alone
    const auto [w, x, y, zz] = p.rotation;
    const dvec3 axis{2 * (x * zz + w * y), 2 * (y * zz - w * x), 1 - 2 * (x * x + y * y)};
    error[fine] = dnorm(dsub(axis, expected));
  }
  CHECK(error[1] < 2e-3);
  CHECK(error[0] / error[1] > 3);  // of second order: 4
}

TEST_CASE("a ball that flies into a free sheet and the sheet keep their momentum", "[rigid]")
{
  for (const std::string integrator : {"backward_euler", "bdf2"}) {
    INFO(integrator);
    Simulation s(ball_into_sheet(), options(integrator));
    const Momentum start = momentum(s, 0.1);
    double linear = 0, angular = 0;
    for (int i = 0; i < 40; ++i) {
      s.step();
      const Momentum now = momentum(s, 0.1);
      linear = std::max(linear, largest(dsub(now.linear, start.linear)));
      angular = std::max(angular, largest(dsub(now.angular, start.angular)));
    }
    CHECK(0.1 * std::abs(s.rigid_pose(0).velocity.z + 1) > 0.005);  // it has struck
    CHECK(linear < 1e-5 * dnorm(start.linear));   // the solves end at 3e-5
    CHECK(angular < 1e-2 * dnorm(start.angular));  // contacts move within a step
    CHECK(s.count_intersections() == 0);
  }
}

TEST_CASE("a ball in a hammock comes to rest, and the cloth carries its weight", "[rigid]")
{
  for (const std::string integrator : {"bdf2", "backward_euler"}) {
    INFO(integrator);
    Simulation s(hammock(), options(integrator));
    while (s.time() < 2) s.step();
    CHECK(dnorm(s.rigid_pose(0).velocity) < 5e-3);
    CHECK(s.rigid_pose(0).center.z < -0.03);
    const double weight = 0.5 * 9.81;
    dvec3 mean{0, 0, 0};
    for (int i = 0; i < 20; ++i) {
      s.step();
      const dvec3 force = s.force_on_obstacle(0).force;
      CHECK(std::abs(force.z - weight) < 1e-2 * weight);
      mean = dadd(mean, dscale(1.0 / 20, force));
    }
    CHECK(std::abs(mean.z - weight) < 1e-3 * weight);
    CHECK(s.count_intersections() == 0);
  }
}

TEST_CASE("a strip around a stick drags it along", "[rigid]")
{
  // Weightless: the strip lies around the stick as a U, and its ends are drawn away at a constant speed.
  Scene s;
  s.time_step = 0.005;
  s.gravity = {0, 0, 0};
  s.contact.thickness = 2e-3;
  const double radius = 0.02, length = 0.2;
  Mesh strip = meshes::grid(40, 4, 0.4, 0.04, -0.2, -0.02, 0);
  strip.material_position.clear();
  for (const dvec3 &x : strip.position) strip.material_position.push_back({x.x, x.y});
  strip.material_face = strip.face;
  const double bend = radius + 0.003, half = pi * bend / 2;
  for (dvec3 &x : strip.position) {
    const double side = x.x < 0 ? -1 : 1, along = std::abs(x.x);
    x.z = along < half ? bend * (1 - std::cos(along / bend)) : bend + along - half;
    x.x = side * (along < half ? bend * std::sin(along / bend) : bend);
  }
  s.cloths.push_back(meshes::cloth(strip));
  s.cloths[0].material.damping = 0.05;
  Pin pin;
  for (int j = 0; j <= 4; ++j) {
    pin.vertices.push_back(41 * j);
    pin.vertices.push_back(41 * j + 40);
  }
  pin.motion.velocity = {0, 0, 0.5};
  s.pins.push_back(pin);
  Mesh stick = make_box({2 * radius * 0.7, length, 2 * radius * 0.7}, 200);
  s.obstacles.push_back(rigid(moved(stick, {0, 0, radius + 0.003}), 0.2, "stick"));
  Simulation sim(s, options());
  double impulse = 0;
  sim.begin_interval();
  for (int i = 0; i < 100; ++i) sim.step();
  impulse = sim.force_on_obstacle(0).impulse.z;
  const RigidPose p = sim.rigid_pose(0);
  CHECK(p.velocity.z > 0.3);
  CHECK(p.center.z > radius + 0.1);
  CHECK(0.2 * p.velocity.z == Approx(impulse).epsilon(0.02));  // what it has, the strip has given it
  CHECK(std::abs(p.velocity.x) < 0.1);
  CHECK(sim.count_intersections() == 0);
}

TEST_CASE("cloth that is attached to a body carries it", "[rigid]")
{
  Scene s;
  s.time_step = 0.005;
  s.contact.enabled = false;
  s.cloths.push_back(meshes::cloth(meshes::grid(8, 8, 0.2, 0.2, -0.1, 0, 0)));
  for (dvec3 &x : s.cloths[0].mesh.position) x = {x.x, 0, x.y};
  s.cloths[0].material.damping = 0.1;
  s.cloths[0].material.mass_damping = 2;
  s.obstacles.push_back(rigid(moved(make_box({0.24, 0.02, 0.02}, 100), {0, 0, -0.0105}), 0.3, "bar"));
  Pin top, bottom;
  for (int i = 0; i <= 8; ++i) {
    top.vertices.push_back(72 + i);
    bottom.vertices.push_back(i);
  }
  bottom.obstacle = 0;
  s.pins = {top, bottom};
  Simulation sim(s, options());
  while (sim.time() < 4) sim.step();
  const RigidPose p = sim.rigid_pose(0);
  CHECK(dnorm(p.velocity) < 2e-3);
  double above = 0.3;
  for (std::size_t v = 0; v < 81; ++v) above += sim.masses()[v];
  CHECK(-sim.force_on_vertices(top.vertices).force.z == Approx(9.81 * above).epsilon(2e-3));
}

TEST_CASE("bodies move in the same bits on every backend, with two threads, and after a checkpoint", "[rigid]")
{
  const auto poses = [](const Simulation &s) {
    const RigidPose p = s.rigid_pose(0);
    std::vector<double> numbers{p.center.x,   p.center.y,    p.center.z,    p.velocity.x,         p.velocity.y,
                                p.velocity.z, p.rotation[0], p.rotation[1], p.angular_momentum.x, p.angular_momentum.y};
    return numbers;
  };
  for (const char *precision : {"mixed", "single"}) {
    INFO(precision);
    Options o = options();
    o.precision = precision_of(precision);
    Simulation whole(ball_into_sheet(), o);
    for (int i = 0; i < 6; ++i) whole.step();
    const Checkpoint kept = whole.checkpoint();
    for (int i = 0; i < 6; ++i) whole.step();
    CHECK(whole.report().rigid_solves > 0);
    for (const std::string &backend : backends_here()) {
      INFO(backend);
      Options other = o;
      other.backend = backend;
      other.threads = backend == "cpu" ? 2 : 0;
      Simulation again(ball_into_sheet(), other);
      for (int i = 0; i < 12; ++i) again.step();
      CHECK(again.state_hash() == whole.state_hash());
      CHECK(poses(again) == poses(whole));
      Simulation continued(ball_into_sheet(), other);
      continued.restore(kept);
      for (int i = 0; i < 6; ++i) continued.step();
      CHECK(continued.state_hash() == whole.state_hash());
      CHECK(poses(continued) == poses(whole));
      CHECK(largest(dsub(continued.forces().back(), whole.forces().back())) == 0);
    }
  }
}

TEST_CASE("what cannot be a rigid body is named, and so is a call that does not fit one", "[rigid]")
{
  const Scene good = alone(rigid(make_sphere(0.1, 80), 1));
  good.validate();
  const auto refused = [&](const char *message, const std::function<void(Obstacle &)> &spoil) {
    Scene bad = good;
    spoil(bad.obstacles[0]);
    CHECK(contains(thrown<Error>([&] { bad.validate(); }), message));
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  refused("obstacle \"body\": rigid: has mass 0", [](Obstacle &o) { o.rigid->mass = 0; });
  refused("obstacle \"body\": rigid: has mass -1", [](Obstacle &o) { o.rigid->mass = -1; });
  refused("give one of them", [](Obstacle &o) { o.rigid->density = 100; });
  refused("give one of them", [&](Obstacle &o) { o.rigid->mass = nan; });
  refused("it is open, or faces are turned differently, at the edge of vertices",
          [](Obstacle &o) { o.mesh.face.pop_back(); });
  refused("rigid: needs a mesh or a box", [](Obstacle &o) {
    const Rigid r = *o.rigid;
    o = exact_sphere({0, 0, 0}, 0.1);
    o.name = "body";
    o.rigid = r;
  });
  refused("give one of rigid and motion", [](Obstacle &o) { o.motion.velocity = {1, 0, 0}; });
  refused("rigid.inertia: is not positive definite",
          [](Obstacle &o) { o.rigid->inertia = SymmetricMatrix{1, 1, 1, 2, 0, 0}; });
  refused("larger than the sum of the other two",
          [](Obstacle &o) { o.rigid->inertia = SymmetricMatrix{1, 1, 3, 0, 0, 0}; });
  refused("rigid.velocity: is not finite", [&](Obstacle &o) { o.rigid->velocity.y = nan; });
  refused("rigid.angular_velocity: is not finite", [&](Obstacle &o) { o.rigid->angular_velocity.y = nan; });
  refused("rigid.center: is not finite", [&](Obstacle &o) { o.rigid->center = dvec3{nan, 0, 0}; });

  Scene open = good;  // with everything given, a mesh may be open
  open.obstacles[0].mesh.face.pop_back();
  open.obstacles[0].rigid->center = dvec3{0, 0, 0};
  open.obstacles[0].rigid->inertia = SymmetricMatrix{1, 1, 1, 0, 0, 0};
  open.validate();

  Simulation s(good, options());
  CHECK(contains(thrown<SceneError>([&] { s.set_obstacle_pose(0, {0, 0, 1}); }), "is rigid: forces move it"));
  CHECK(contains(thrown<SceneError>([&] { s.rigid_pose(1); }), "obstacle 1 is not there"));
  Scene still = good;
  still.obstacles[0].rigid.reset();
  Simulation other(still, options());
  CHECK(contains(thrown<SceneError>([&] { other.rigid_pose(0); }), "is not rigid"));
  CHECK(contains(thrown<SceneError>([&] { s.restore(other.checkpoint()); }),
                 "an obstacle that is rigid here was not in its run"));
}

TEST_CASE("a scene file keeps what makes an obstacle rigid", "[rigid]")
{
  Scene scene = alone(rigid(make_box({0.1, 0.2, 0.3}), 2));
  Rigid &r = *scene.obstacles[0].rigid;
  r.center = dvec3{0.01, 0.02, 0.03};
  r.inertia = SymmetricMatrix{1, 1.5, 2, 0.1, 0.2, 0.3};
  r.velocity = {1, 2, 3};
  r.angular_velocity = {4, 5, 6};
  const Scene again = Scene::parse(scene.save(), ".");
  REQUIRE(again.obstacles[0].rigid);
  const Rigid &read = *again.obstacles[0].rigid;
  CHECK(read.mass == 2);
  CHECK(read.density == 0);
  CHECK(largest(dsub(*read.center, *r.center)) == 0);
  CHECK(*read.inertia == *r.inertia);
  CHECK(largest(dsub(read.velocity, r.velocity)) == 0);
  CHECK(largest(dsub(read.angular_velocity, r.angular_velocity)) == 0);
}
