// SPDX-License-Identifier: Apache-2.0
// Whole simulations against closed forms: free fall, pendulum, hanging chain, momentum, hanging strip, catenary, elastica, friction on a
// slope, collisions. Tables: ../shared/data/analytic.
#include "../catch.hpp"

#include <cmath>
#include <fstream>
#include <map>
#include <sstream>

#include "cama/generators.hpp"
#include "cama/simulation.hpp"

using namespace cama;
using namespace cama::kernels;

namespace {

constexpr double pi = 3.14159265358979323846, gravity = 9.81;

Options exact()
{
  Options o;
  o.backend = "cpu";
  o.threads = 1;
  o.solver = LinearSolver::direct;
  return o;
}

Scene scene_of(const Mesh &mesh, const Material &material, double time_step)
{
  Scene s;
  s.time_step = time_step;
  s.gravity = {0, 0, -gravity};
  s.contact.enabled = false;
  s.cloths.push_back({"cloth", mesh, material, {0, 0, 0}, ""});
  return s;
}

/// Puts material point (u, v) at f(u, v).
template <class F> void place(Mesh &mesh, F f)
{
  for (std::size_t i = 0; i < mesh.position.size(); ++i) mesh.position[i] = f(mesh.material_position[i][0], mesh.material_position[i][1]);
}

std::vector<int> join(std::vector<int> a, const std::vector<int> &b)
{
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

/// Columns `key` and `value` of a table in ../shared/data/analytic.
std::map<double, std::map<std::string, double>> table(const std::filesystem::path &file)
{
  std::map<double, std::map<std::string, double>> rows;
  std::ifstream in(file);
  std::string line, cell;
  std::getline(in, line);
  std::vector<std::string> names;
  for (std::istringstream text(line); std::getline(text, cell, ',');) names.push_back(cell);
  while (std::getline(in, line)) {
    std::vector<double> values;
    for (std::istringstream text(line); std::getline(text, cell, ',');) values.push_back(std::stod(cell));
    for (std::size_t k = 0; k < values.size(); ++k) rows[values[0]][names[k]] = values[k];
  }
  return rows;
}

dvec3 mean(const std::vector<dvec3> &x, const std::vector<int> &vertices)
{
  dvec3 sum{0, 0, 0};
  for (int v : vertices) sum = dadd(sum, x[v]);
  return dscale(1.0 / static_cast<double>(vertices.size()), sum);
}

struct Momentum { dvec3 linear{0, 0, 0}, angular{0, 0, 0}; double speed = 0; };   // speed: sum of m |v|

Momentum momentum(const Simulation &sim)
{
  Momentum p;
  const auto x = sim.positions(), v = sim.velocities();
  const auto m = sim.masses();
  for (std::size_t i = 0; i < m.size(); ++i) {
    p.linear = daxpy(p.linear, m[i], v[i]);
    p.angular = daxpy(p.angular, m[i], dcross(x[i], v[i]));
    p.speed += m[i] * dnorm(v[i]);
  }
  return p;
}

}  // namespace

TEST_CASE("free fall follows the closed form of backward Euler", "[dynamics]")
{
  const int steps = 100;
  Scene s = scene_of(make_grid_cells(1, 1, 6, 6).mesh, Material::isotropic(500, 0.3, 1e-4, 0.2), 1.0 / 200);
  s.cloths[0].velocity = {0.3, -0.2, 1.5};
  const auto largest_error = [&](const Options &o) {
    Simulation sim(s, o);
    for (int n = 0; n < steps; ++n) sim.step();
    const auto x = sim.positions();
    const double h = s.time_step;
    double off = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
      const dvec3 x0 = s.cloths[0].mesh.position[i];
      const dvec3 fallen{x0.x + 0.3 * steps * h, x0.y - 0.2 * steps * h, x0.z + 1.5 * steps * h - gravity * h * h * steps * (steps + 1) / 2};
      off = std::max(off, dnorm(dsub(x[i], fallen)));
    }
    return off;
  };
  Options iterative = exact(), single = exact();
  iterative.solver = LinearSolver::conjugate_gradient;
  single.precision = "single";
  const double direct = largest_error(exact()), conjugate = largest_error(iterative), narrow = largest_error(single);
  CAPTURE(direct, conjugate, narrow);
  CHECK(direct < 1e-12);
  CHECK(narrow < 1e-4);
  CHECK(conjugate < 1e-12);   // with the default tolerance
}

TEST_CASE("a single stiff cell swings as the simple pendulum under backward Euler", "[dynamics]")
{
  const double length = 0.5, h = 1.0 / 500, start = 0.01;
  Pattern p = make_grid_cells(0.5, length, 1, 1);
  place(p.mesh, [&](double u, double v) { return dvec3{u, (length - v) * std::sin(start), -(length - v) * std::cos(start)}; });
  Scene s = scene_of(p.mesh, Material::isotropic(1e6, 0, 0, 0.2), h);
  s.pins.push_back({0, p.group["top"], {}, {}});
  Simulation sim(s, exact());
  // The scheme's own recurrence for y'' = -g/L y; its closed form decays by 1 / sqrt(1 + (w h)^2) a step.
  const double w2 = gravity / length;
  double y = length * std::sin(start), v = 0, worst = 0;
  for (int n = 0; n < 1000; ++n) {
    sim.step();
    v = (v - h * w2 * y) / (1 + h * h * w2);
    y += h * v;
    worst = std::max(worst, std::abs(mean(sim.positions(), p.group["bottom"]).y - y));
  }
  const double largest = length * std::sin(start) * std::pow(1 + w2 * h * h, -500);   // envelope at the end
  CAPTURE(worst, largest);
  CHECK(worst < 2e-3 * length * std::sin(start));
}

TEST_CASE("the first mode of a hanging chain has the frequency of Bernoulli's", "[dynamics]")
{
  // y = J0(2 w sqrt(s / g)), s from the free end, w = 2.404826 / 2 sqrt(g / L).
  const double length = 0.5, amplitude = 1e-3, w = 0.5 * 2.404825557695773 * std::sqrt(gravity / length);
  const auto period_error = [&](int cells, double h) {
    Pattern p = make_grid_cells(length / cells, length, 1, cells);
    place(p.mesh, [&](double u, double v) { return dvec3{u, amplitude * std::cyl_bessel_j(0, 2 * w * std::sqrt(v / gravity)), v - length}; });
    Scene s = scene_of(p.mesh, Material::isotropic(1e5, 0, 0, 0.2), h);
    s.pins.push_back({0, p.group["top"], {}, {}});
    Simulation sim(s, exact());
    double before = amplitude, first = 0, last = 0;
    int crossings = 0;
    while (sim.time() < 3.2) {
      sim.step();
      const double now = mean(sim.positions(), p.group["bottom"]).y;
      if (before * now < 0) {
        const double at = sim.time() - h * now / (now - before);
        if (crossings++ == 0) first = at;
        last = at;
      }
      before = now;
    }
    return (last - first) / (crossings - 1) / (pi / w) - 1;
  };
  const double coarse = period_error(10, 1.0 / 200), fine = period_error(20, 1.0 / 800);
  CAPTURE(coarse, fine);
  CHECK(std::abs(fine) < 2e-3);
  CHECK(std::abs(fine) < std::abs(coarse));
}

TEST_CASE("momentum of a free spinning cloth", "[dynamics]")
{
  Pattern p = make_grid_cells(0.4, 0.4, 8, 8);
  place(p.mesh, [](double u, double v) { return dvec3{u - 0.2, v - 0.2, 0.02 * std::sin(12 * u) * std::cos(9 * v)}; });
  const auto run = [&](double h, double &linear, const Options &o) {
    Scene s = scene_of(p.mesh, Material::isotropic(500, 0.3, 1e-4, 0.2), h);
    s.gravity = {0, 0, 0};
    Simulation sim(s, o);
    std::vector<dvec3> v;
    for (const dvec3 &x : sim.positions()) v.push_back(dadd({0.5, 0, 0.1}, dcross({0.4, 0.3, 3}, x)));
    sim.set_state(sim.positions(), v);
    const Momentum start = momentum(sim);
    while (sim.time() < 0.5) sim.step();
    const Momentum end = momentum(sim);
    linear = dnorm(dsub(end.linear, start.linear)) / start.speed;
    return dnorm(dsub(end.angular, start.angular)) / dnorm(start.angular);
  };
  double linear = 0, linear_cg = 0, other = 0;
  Options iterative = exact();
  iterative.solver = LinearSolver::conjugate_gradient;
  const double coarse = run(1.0 / 200, linear, exact()), fine = run(1.0 / 400, other, exact()), finest = run(1.0 / 800, other, exact());
  const double loose = run(1.0 / 200, linear_cg, iterative);
  CAPTURE(linear, coarse, fine, finest, linear_cg, loose);
  CHECK(linear < 1e-12);
  CHECK(linear_cg < 1e-3);
  // Linearised backward Euler keeps angular momentum to first order in the time step: the matrix turns with the cloth only once a step.
  CHECK(coarse < 0.05);
  CHECK(coarse / fine == Approx(2).epsilon(0.25));
  CHECK(fine / finest == Approx(2).epsilon(0.25));
}

namespace {

/// Extension of a hanging strip over its length.
double hanging_extension(double q, int cells, const Options &o)
{
  const double length = 0.5, density = 0.2;
  Pattern p = make_grid_cells(0.1, length, std::max(1, cells / 5), cells);
  place(p.mesh, [&](double u, double v) { return dvec3{u, 0, v - length}; });
  Scene s = scene_of(p.mesh, Material::isotropic(density * gravity * length / q, 0, 0, density), 1.0);
  s.pins.push_back({0, p.group["top"], {}, {}});
  Simulation sim(s, o);
  for (int n = 0; n < 60; ++n) sim.step();
  return -mean(sim.positions(), p.group["bottom"]).z / length - 1;
}

}  // namespace

TEST_CASE("a hanging strip stretches as the table of St. Venant-Kirchhoff", "[dynamics]")
{
  const auto file = test_data("analytic/hanging.csv");
  if (!file) return;
  for (const auto &[q, row] : table(*file)) {
    const double expected = row.at("tip_extension_over_L");
    double before = 1, off = 0;
    for (int cells : {5, 10, 20}) {
      off = std::abs(hanging_extension(q, cells, exact()) / expected - 1);
      CAPTURE(q, cells, off);
      CHECK(off < before);
      before = off;
    }
    CHECK(off < 0.005);
  }
}

namespace {

/// Sag of a strip of length 1 hung by its ends at distance `d`, over its length.
double catenary_sag(double d, int cells, double bending)
{
  // Starts as an arc of the strip's length: chord d = 2 r sin(a), length 1 = 2 r a.
  double a = 1.5;
  for (int k = 0; k < 200; ++k) a -= (std::sin(a) - d * a) / (std::cos(a) - d);
  const double r = 0.5 / a;
  Pattern p = make_grid_cells(1, 1.0 / cells, cells, 1);
  place(p.mesh, [&](double u, double v) {
    const double t = (u - 0.5) / r;
    return dvec3{r * std::sin(t), v, -r * std::cos(t) + r * std::cos(a)};
  });
  Scene s = scene_of(p.mesh, Material::isotropic(2e4, 0, bending, 0.2), 0.05);
  s.pins.push_back({0, join(p.group["left"], p.group["right"]), {}, {}});
  Simulation sim(s, exact());
  double lowest = 0;
  for (int n = 0; n < 400; ++n) sim.step();
  for (const dvec3 &x : sim.positions()) lowest = std::min(lowest, x.z);
  return -lowest;
}

}  // namespace

TEST_CASE("a strip hung by its ends sags as the catenary when bending vanishes", "[dynamics]")
{
  const auto file = test_data("analytic/catenary.csv");
  if (!file) return;
  for (double d : {0.3, 0.7, 0.9}) {
    const double expected = table(*file).at(d).at("sag_over_S");
    double before = 1, off = 0;
    for (double bending : {1e-2, 1e-3, 0.0}) {
      off = std::abs(catenary_sag(d, 32, bending) / expected - 1);
      CAPTURE(d, bending, off);
      CHECK(off < before);
      before = off;
    }
    CHECK(off < 0.01);
  }
}

namespace {

struct Tip { double drop, reach; };

/// A strip of length 1 clamped at one end, bent by its weight. The clamp is a cell whose four nodes are pinned; the hinge at its free
/// border stands for half a cell on each side, so the strip's length is counted from the middle of the clamped cell.
Tip cantilever(double gamma, int cells, int mirror, double bending_scale = 1)
{
  const double cell = 1.0 / (cells + 0.5), density = 0.2, width = 4 * cell;
  Pattern p = make_grid_cells(1.0 + 0.5 * cell, width, cells + 1, 4);
  if (mirror & 1)
    for (auto &m : p.mesh.material_position) m[1] = width - m[1];
  if (mirror & 1)
    for (auto *faces : {&p.mesh.face, &p.mesh.material_face})
      for (Triangle &f : *faces) std::swap(f[1], f[2]);
  place(p.mesh, [&](double u, double v) { return dvec3{u - 0.5 * cell, mirror & 2 ? -v : v, 0}; });
  Scene s = scene_of(p.mesh, Material::isotropic(2e4, 0, bending_scale * density * gravity / gamma, density), 0.05);
  std::vector<int> clamped;
  for (std::size_t i = 0; i < p.mesh.material_position.size(); ++i)
    if (p.mesh.material_position[i][0] < 1.5 * cell) clamped.push_back(static_cast<int>(i));
  s.pins.push_back({0, clamped, {}, {}});
  Simulation sim(s, exact());
  for (int n = 0; n < 600; ++n) sim.step();
  const dvec3 tip = mean(sim.positions(), p.group["right"]);
  return {-tip.z, tip.x};
}

}  // namespace

TEST_CASE("a cantilever under its weight bends as the elastica", "[dynamics]")
{
  const auto file = test_data("analytic/elastica.csv");
  if (!file) return;
  for (double gamma : {0.5, 5.0, 20.0}) {
    const double expected = table(*file).at(gamma).at("H_over_W");
    double before = 1, off = 0;
    for (int cells : {8, 16, 32}) {
      const Tip tip = cantilever(gamma, cells, 0);
      off = std::abs(tip.drop / tip.reach / expected - 1);
      CAPTURE(gamma, cells, off);
      CHECK(off < before);
      before = off;
    }
    CHECK(off < 0.02);
  }
}
