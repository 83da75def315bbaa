// SPDX-License-Identifier: Apache-2.0
// Rigid obstacles that cloth and gravity move: mass properties, free motion, and momentum that cloth and bodies exchange.
#include <cmath>
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
  Pin pin;
  pin.vertices = {0, 20, 420, 440};
  s.pins.push_back(pin);
  s.obstacles.push_back(rigid(moved(make_sphere(0.08, 500), {0.01, 0, 0.09}), 0.5));
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
    const double expected[6] = {m / 12 * (size.y * size.y + size.z * size.z), m / 12 * (size.z * size.z + size.x * size.x),
                                m / 12 * (size.x * size.x + size.y * size.y), 0, 0, 0};
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
    CHECK(largest(dsub(p.angular_momentum, momentum)) == 0);
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
    for (int i = 0; i < 60; ++i) {
      s.step();
      const Momentum now = momentum(s, 0.1);
      linear = std::max(linear, largest(dsub(now.linear, start.linear)));
      angular = std::max(angular, largest(dsub(now.angular, start.angular)));
    }
    const double given = 0.1 * std::abs(s.rigid_pose(0).velocity.z + 1);
    CHECK(given > 0.005);  // it has struck
    CHECK(linear < 1e-9 * 0.1);
    CHECK(angular < 0.02 * given * 0.2);
  }
}

TEST_CASE("a ball in a hammock comes to rest, and the cloth carries its weight", "[rigid]")
{
  Scene scene = hammock();
  Simulation s(scene, options());
  for (int i = 0; i < 600; ++i) s.step();
  const RigidPose p = s.rigid_pose(0);
  CHECK(dnorm(p.velocity) < 2e-3);
  s.begin_interval();
  for (int i = 0; i < 100; ++i) s.step();
  const Wrench w = s.force_on_obstacle(0);
  const double weight = 0.5 * 9.81;
  CHECK(std::abs(w.impulse.z / s.interval() - weight) < 1e-3 * weight);
  CHECK(largest({w.impulse.x / s.interval(), w.impulse.y / s.interval(), 0}) < 1e-3 * weight);
  CHECK(s.count_intersections() == 0);
}
