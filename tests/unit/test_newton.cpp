// SPDX-License-Identifier: Apache-2.0
// Newton's method and the integrators against numerical solutions of ordinary differential equations, Richardson
// sequences, and the equation of a step with forces by finite differences of the energy; accuracy levels; failing
// steps.
#include "../catch.hpp"

#include <cmath>
#include <functional>
#include <limits>

#include "../engine.hpp"
#include "../meshes.hpp"
#include "cama/error.hpp"
#include "cama/simulation.hpp"
#include "device/fnv.hpp"

using namespace cama;
using namespace cama::kernels;

namespace {

Options newton(Integrator integrator, int iterations = 60, double tolerance = 1e-12)
{
  Options o;
  o.backend = "cpu";
  o.threads = 1;
  o.precision = Precision::full;
  o.solver = LinearSolver::direct;
  o.integrator = integrator;
  o.newton_iterations = iterations;
  o.newton_tolerance = tolerance;
  return o;
}

constexpr double stiffness = 50, density = 0.2, width = 0.2, height = 0.1;

/// A triangle whose base is pinned and whose apex swings along its height: one degree of freedom y, the height over
/// that at rest.
Scene spring()
{
  Scene s;
  s.time_step = 1.0 / 200;
  s.gravity = {0, 0, 0};
  s.contact.enabled = false;
  Mesh m;
  m.position = {{0, 0, 0}, {width, 0, 0}, {width / 2, height, 0}};
  m.face = {{0, 1, 2}};
  Material material = Material::isotropic(stiffness, 0, 0, density);
  material.stretching[0] = {stiffness, 0, stiffness, 0};
  s.cloths.push_back(meshes::cloth(m, material));
  Pin pin;
  pin.vertices = {0, 1};
  s.pins.push_back(pin);
  return s;
}

/// y'' = -k area / (m height^2) (y^2 - 1) / 2 y, of the energy k area ((y^2 - 1) / 2)^2 / 2, by Runge and Kutta's
/// fourth order.
double swing(double y, double v, double time)
{
  const double area = width * height / 2, mass = density * area / 3,
               factor = stiffness * area / (mass * height * height);
  const auto acceleration = [&](double x) { return -factor * (x * x - 1) / 2 * x; };
  const int steps = 20000;
  const double h = time / steps;
  for (int i = 0; i < steps; ++i) {
    const double a1 = acceleration(y), a2 = acceleration(y + h / 2 * v),
                 a3 = acceleration(y + h / 2 * v + h * h / 4 * a1), a4 = acceleration(y + h * v + h * h / 2 * a2);
    y += h * v + h * h / 6 * (a1 + a2 + a3);
    v += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
  }
  return y;
}

double spring_end(Integrator integrator, double step, double time, double y0, double v0)
{
  // The spring passes through rest, where there are no forces to be relative to.
  Options o = newton(integrator, 60, 1e-10);
  o.time_step = step;
  Simulation s(spring(), o);
  std::vector<dvec3> x = s.positions(), v(3, dvec3{0, 0, 0});
  x[2].y = y0 * height;
  v[2].y = v0 * height;
  s.set_state(x, v);
  for (int i = 0; i < std::lround(time / step); ++i) {
    s.step();
    REQUIRE(s.report().newton_residual <= 1e-10);
  }
  return s.positions()[2].y / height;
}

/// log2 of the ratio of the errors with a step and with half of it.
double order(double coarse, double fine) { return std::log2(std::abs(coarse) / std::abs(fine)); }

/// A damped sheet in wind, not at rest, that hangs by two corners.
Scene blown()
{
  Scene s = meshes::hanging(4);
  s.cloths[0].material = Material::isotropic(60, 0.2, 1e-4, 0.2);
  s.cloths[0].material.damping = 1e-3;
  s.wind = Wind{{1, 0.5, 2}, 1.2, 0.2};
  s.contact.enabled = false;
  return s;
}

std::vector<dvec3> blown_end(Integrator integrator, double step, double time)
{
  Options o = newton(integrator, 60, 1e-11);
  o.time_step = step;
  Simulation s(blown(), o);
  std::vector<dvec3> x = s.positions(), v(x.size(), dvec3{0, 0, 0});
  for (dvec3 &p : x) p = {1.02 * p.x, 1.03 * p.y, 0.02 * std::sin(8 * p.x) * p.y};
  s.set_state(x, v);
  for (int i = 0; i < std::lround(time / step); ++i) {
    s.step();
    REQUIRE(s.report().newton_residual <= 1e-11);
  }
  return s.positions();
}

double distance(const std::vector<dvec3> &a, const std::vector<dvec3> &b)
{
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += ddot(dsub(a[i], b[i]), dsub(a[i], b[i]));
  return std::sqrt(sum / static_cast<double>(a.size()));
}

}  // namespace

TEST_CASE("a nonlinear spring: backward Euler is of order 1, BDF2 of order 2", "[newton]")
{
  const double time = 0.02, y0 = 1.3, v0 = -2;   // through compression and back
  const double exact = swing(y0, v0, time);
  double euler[4], bdf2[4];
  for (int k = 0; k < 4; ++k) {
    const double step = 2.5e-4 / (1 << k);
    euler[k] = spring_end(Integrator::backward_euler, step, time, y0, v0) - exact;
    bdf2[k] = spring_end(Integrator::bdf2, step, time, y0, v0) - exact;
  }
  CAPTURE(exact, euler[0], euler[3], bdf2[0], bdf2[3]);
  CHECK(order(euler[2], euler[3]) == Approx(1).margin(0.1));
  CHECK(order(bdf2[2], bdf2[3]) == Approx(2).margin(0.1));
  CHECK(std::abs(bdf2[3]) < std::abs(euler[3]) / 20);
}

TEST_CASE("a damped sheet in wind: the orders by a Richardson sequence", "[newton]")
{
  for (const auto &[integrator, expected] : {std::pair{Integrator::backward_euler, 1.0}, {Integrator::bdf2, 2.0}}) {
    std::vector<std::vector<dvec3>> end;
    for (int k = 0; k < 4; ++k) end.push_back(blown_end(integrator, 5e-4 / (1 << k), 0.03));
    const double first = distance(end[0], end[1]), second = distance(end[1], end[2]), third = distance(end[2], end[3]);
    CAPTURE(first, second, third);
    CHECK(first > 1e-7);
    CHECK(order(second, third) == Approx(expected).margin(0.15));
  }
}

TEST_CASE("Newton's method converges quadratically near the solution", "[newton]")
{
  // Stretched and without shear the Hessian is complete.
  std::vector<double> residual;
  for (int iterations = 2; iterations <= 6; ++iterations) {
    Options o = newton(Integrator::backward_euler, iterations, 1e-15);
    o.time_step = 1e-2;
    Simulation s(spring(), o);
    std::vector<dvec3> x = s.positions(), v(3, dvec3{0, 0, 0});
    x[2].y = 1.6 * height;
    v[2].y = 5 * height;
    s.set_state(x, v);
    s.step();
    residual.push_back(s.report().newton_residual);
  }
  CAPTURE(residual);
  int quadratic = 0;
  for (std::size_t k = 1; k < residual.size() && residual[k] > 1e-14; ++k) {
    CHECK(residual[k] < 0.3 * residual[k - 1]);
    if (residual[k - 1] < 1e-2) {
      CHECK(residual[k] < 10 * residual[k - 1] * residual[k - 1]);
      ++quadratic;
    }
  }
  CHECK(quadratic >= 1);
  CHECK(residual.back() < 1e-12);
}

namespace {

/// The largest component of M (v' - v) / dt - f(x') over the free vertices, relative to the largest force: elastic
/// forces by central differences of the energy at x', contact forces from the contacts that the step reports and their
/// penalty.
double equation_error(const Scene &scene, const Options &o, int steps)
{
  StagedEngine engine(scene, o);
  Simulation probe(scene, o);
  for (int i = 1; i < steps; ++i) engine.step();
  const std::vector<dvec3> x0 = engine.state.mesh.position.download(), v0 = engine.state.mesh.velocity.download();
  engine.step();
  REQUIRE(engine.state.report.impacts == 0);
  REQUIRE(engine.state.report.truncated == 0);
  REQUIRE(engine.state.contact.contacts > 0);
  const std::vector<double> mass = probe.masses();
  const std::vector<dvec3> x = engine.state.mesh.position.download(), v = engine.state.mesh.velocity.download();
  const std::size_t n = mass.size();
  std::vector<dvec3> force(x.size(), dvec3{0, 0, 0});
  for (const kernels::contact &c : engine.state.contact.contact.download()) {
    double depth = c.thickness - c.distance;
    for (int a = 0; a < 4; ++a) depth -= c.weight[a] * ddot(c.normal, dsub(x[c.node[a]], x0[c.node[a]]));
    if (depth > 0)
      for (int a = 0; a < 4; ++a)
        force[c.node[a]] = daxpy(force[c.node[a]], c.weight[a] * c.stiffness * depth, c.normal);
  }
  const std::vector<dvec3> still(n, dvec3{0, 0, 0});
  std::vector<dvec3> cloth(x.begin(), x.begin() + static_cast<long>(n));
  const double d = 1e-7;
  double worst = 0, largest = 0;
  for (std::size_t i = 0; i < n; ++i)
    for (double dvec3::*c : {&dvec3::x, &dvec3::y, &dvec3::z}) {
      double energy[2];
      for (int side = 0; side < 2; ++side) {
        std::vector<dvec3> moved = cloth;
        moved[i].*c += side ? d : -d;
        probe.set_state(moved, still);
        const Energy e = probe.energy();
        energy[side] = e.stretching + e.bending + e.gravity;
      }
      const double f = force[i].*c - (energy[1] - energy[0]) / (2 * d);
      largest = std::max(largest, std::abs(f));
      worst = std::max(worst, std::abs(mass[i] * (v[i].*c - v0[i].*c) / engine.state.time.step - f));
    }
  return worst / largest;
}

/// A sheet that has fallen on a plate, without friction.
Scene fallen()
{
  Scene s;
  s.time_step = 1.0 / 200;
  s.contact.thickness = 4e-3;
  s.contact.friction = 0;
  s.cloths.push_back(meshes::cloth(meshes::grid(4, 4, 0.1, 0.1, -0.05, -0.05, 0.004)));
  s.cloths[0].velocity = {0, 0, -0.2};
  s.obstacles.push_back(meshes::obstacle(meshes::grid(2, 2, 0.4, 0.4, -0.21, -0.2)));
  s.obstacles[0].friction = 0;
  return s;
}

}  // namespace

TEST_CASE("a converged step solves backward Euler's equation, contact included; a linearised one does not", "[newton]")
{
  Options o = newton(Integrator::backward_euler, 60, 1e-11), one = o;
  one.newton_iterations = 1;
  const double converged = equation_error(fallen(), o, 6), linear = equation_error(fallen(), one, 6);
  CAPTURE(converged, linear);
  CHECK(converged < 1e-5);   // of the differences
  CHECK(linear > 1e-4);
}

TEST_CASE("Newton's method brings the residual below the tolerance in contact, with friction and refreshed contacts",
          "[newton]")
{
  for (const ContactRefresh refresh : {ContactRefresh::step, ContactRefresh::iteration})
    for (const Integrator integrator : {Integrator::backward_euler, Integrator::bdf2}) {
      Options o = serial();
      o.precision = Precision::full;
      o.newton_iterations = 60;
      o.newton_tolerance = 1e-7;
      o.tolerance = 1e-6;
      o.integrator = integrator;
      o.contact_refresh = refresh;
      o.time_step = 1e-3;
      Simulation s(meshes::pile(6), o);
      int contacts = 0, most = 0, failed = 0;
      double worst = 0;
      for (int i = 0; i < 25; ++i) {
        s.step();
        contacts = std::max(contacts, s.report().contacts);
        most = std::max(most, s.report().newton_iterations);
        failed += s.report().newton_residual > 1e-7;
        worst = std::max(worst, s.report().newton_residual);
      }
      CAPTURE(static_cast<int>(refresh), static_cast<int>(integrator), contacts, most, failed, worst);
      CHECK(contacts > 20);
      CHECK(failed == 0);
      CHECK(s.count_intersections() == 0);
    }
}

TEST_CASE("Newton's method that has nothing to do gives the linearised step to the bit", "[newton]")
{
  Options one = serial();
  one.integrator = Integrator::backward_euler;
  one.newton_iterations = 1;
  Options idle = one;
  idle.newton_iterations = 5;
  idle.newton_tolerance = 0.999;
  Scene scene = meshes::hanging(5);
  scene.contact.enabled = true;   // with itself
  scene.stitches.push_back({0, 30, 0, 34, 35, 0.5, 1});
  Simulation a(scene, one), b(scene, idle);
  for (int i = 0; i < 10; ++i) {
    a.step();
    b.step();
    REQUIRE(b.report().newton_iterations == 1);
    REQUIRE(a.state_hash() == b.state_hash());
  }
  CHECK(a.report().newton_residual == -1);
  CHECK(b.report().newton_residual > 0);
}

TEST_CASE("only scenes and options that need them get Newton's and BDF2's stages and streams", "[newton]")
{
  Options o = serial();
  o.newton_iterations = 1;
  o.integrator = Integrator::backward_euler;
  CHECK(StagedEngine(meshes::pile(3), o).find("newton iterations") == nullptr);
  CHECK(StagedEngine(meshes::pile(3), o).find("extrapolation") == nullptr);
  CHECK_FALSE(StagedEngine(meshes::pile(3), o).has_stream("position_before"));
  o.newton_iterations = 2;
  o.integrator = Integrator::bdf2;
  CHECK(StagedEngine(meshes::pile(3), o).find("newton iterations") != nullptr);
  CHECK(StagedEngine(meshes::pile(3), o).find("extrapolation") != nullptr);
  CHECK(StagedEngine(meshes::pile(3), o).has_stream("position_before"));
}

TEST_CASE("BDF2 starts anew after motion that was handled, after a state that was set, and after a step in pieces",
          "[newton]")
{
  Options o = newton(Integrator::bdf2);
  Scene scene = meshes::hanging(3);
  Simulation a(scene, o), b(scene, o);
  for (int i = 0; i < 3; ++i) a.step();
  b.set_state(a.positions(), a.velocities());
  a.set_state(a.positions(), a.velocities());
  a.step();
  b.step();
  CHECK(a.state_hash() == b.state_hash());
  Options euler = o;
  euler.integrator = Integrator::backward_euler;
  Simulation c(scene, o), d(scene, euler);
  c.step();
  d.step();
  CHECK(c.state_hash() == d.state_hash());
  c.step();
  d.step();
  CHECK(c.state_hash() != d.state_hash());
}

TEST_CASE("BDF2 does not make cloth rebound from what stops it", "[newton]")
{
  // A sheet thrown on a plate: with almost no penalty, penetration handling stops it.
  Scene s = fallen();
  s.gravity = {0, 0, 0};
  s.contact.stiffness = 1e-3;
  s.cloths[0].velocity = {0, 0, -3};
  Options o = newton(Integrator::bdf2, 4, 1e-6);
  o.time_step = 1e-3;
  Simulation sim(s, o);
  const auto kinetic = [&] { return sim.energy().kinetic; };
  const double start = kinetic();
  double highest = -1;
  int stopped = 0;
  for (int i = 0; i < 20; ++i) {
    sim.step();
    stopped += sim.report().impact_passes > 0;
    CHECK(kinetic() <= start * (1 + 1e-9));
    for (const dvec3 &v : sim.velocities()) highest = std::max(highest, v.z);
  }
  CHECK(stopped > 0);
  CHECK(highest < 0.3);   // a third of 3 m/s would be the rebound
}

namespace {

enum class Plant { error, not_a_number, overflow };

/// Spoils the result of the linear solve before it, `failures` times.
class PlantedFailure final : public StageOn<const StepReport, MeshState> {
public:
  std::string_view name() const override { return "planted failure"; }
  void run_on(const Rooms &state) override
  {
    if (failures == 0) return;
    --failures;
    if (how == Plant::error) throw SolverError("step " + std::to_string(state.report.step) + ": planted");
    if (how == Plant::overflow) throw ListOverflow();
    std::vector<dvec3> v = state.mesh.velocity_next.download();
    v[v.size() / 2].y = std::numeric_limits<double>::quiet_NaN();
    state.mesh.velocity_next.assign(v);
  }
  Plant how = Plant::error;
  int failures = 0;
};

/// An engine whose solve can fail.
struct Failing : StagedEngine {
  Failing(const Scene &scene, const Options &options) : StagedEngine(scene, options)
  {
    auto stage = std::make_unique<PlantedFailure>();
    planted = stage.get();
    pipeline->insert_after("linear solve", std::move(stage));
  }
  void plant(Plant how, int count)
  {
    planted->how = how;
    planted->failures = count;
  }
  void step()
  {
    take([] {});
  }
  const StepReport &report() const { return state.report; }
  std::uint64_t hash() const   // as Simulation::state_hash
  {
    const std::size_t bytes = sizeof(dvec3) * static_cast<std::size_t>(state.mesh.cloth_vertices);
    return fnv1a(state.mesh.velocity.download().data(), bytes, fnv1a(state.mesh.position.download().data(), bytes));
  }
  PlantedFailure *planted;
};

std::vector<dvec3> cloth_of(const Simulation &simulation, std::vector<dvec3> values)
{
  values.resize(static_cast<std::size_t>(simulation.cloth_vertex_count()));
  return values;
}

}  // namespace

TEST_CASE("a step that the solver cannot do is done in halves", "[newton][failures]")
{
  for (Integrator integrator : {Integrator::backward_euler, Integrator::bdf2})
    for (Plant how : {Plant::error, Plant::not_a_number, Plant::overflow}) {
      Options o = serial(), half = serial();
      o.integrator = half.integrator = integrator;
      Scene scene = meshes::pile(4);
      scene.contact.friction = scene.obstacles[0].friction = 0;  // set_state below forgets it, a piece does not
      Scene finer = scene;
      finer.time_step /= 2;
      Failing s(scene, o);
      Simulation expected(finer, half);
      s.plant(how, 1);
      s.step();
      CHECK(s.report().retries == 1);
      CHECK(s.report().step == 1);
      CHECK(s.state.time.now == scene.time_step);
      expected.step();
      expected.set_state(cloth_of(expected, expected.positions()), cloth_of(expected, expected.velocities()));
      expected.step();   // without a history, as every piece
      CHECK(s.hash() == expected.state_hash());
      s.step();
      CHECK(s.report().retries == 0);
    }
}

TEST_CASE("a step that fails in all pieces is reported, and leaves the previous state", "[newton][failures]")
{
  Options o = serial(Accuracy::accurate);
  Scene scene = meshes::pile(4);
  Failing s(scene, o);
  for (int i = 0; i < 3; ++i) s.step();
  const std::uint64_t hash = s.hash();
  const double time = s.state.time.now;
  s.plant(Plant::error, 1000);
  const std::string text = thrown<SolverError>([&] { s.step(); });
  CHECK(contains(text, "step 4: planted"));
  CHECK(contains(text, "1/2^4"));
  CHECK(s.planted->failures == 1000 - 5);   // the whole, 1/2, 1/4, 1/8, 1/16
  CHECK(s.hash() == hash);
  CHECK(s.state.time.now == time);
  CHECK(s.report().step == 3);
  CHECK(s.state.contact.contacts == 0);
  s.plant(Plant::error, 0);
  s.step();
  CHECK(s.report().step == 4);
  CHECK(s.report().retries == 0);
  s.plant(Plant::error, 3);   // the whole, 1/2, 1/4; then 1/8, 1/8, 1/4, 1/2
  s.step();
  CHECK(s.report().retries == 3);
  CHECK(s.report().newton_iterations >= 4);
  CHECK(s.state.time.now == Approx(5 * s.state.time.step));
}

TEST_CASE("a list that is too long in all pieces of a step is an error of memory", "[newton][failures]")
{
  Options o = serial();
  o.max_divisions = 2;
  Failing s(meshes::pile(4), o);
  s.plant(Plant::overflow, 1000);
  const std::string text = thrown<MemoryError>([&] { s.step(); });
  CHECK(contains(text, "a list of this scene exceeds 2^31 entries"));
  CHECK(contains(text, "pieces of this step, down to 1/2^2 of it"));
  CHECK(s.planted->failures == 1000 - 3);   // the whole, 1/2, 1/4
  CHECK(s.report().step == 0);
}

TEST_CASE("how often a failing step is halved is an option", "[newton][failures]")
{
  for (int most : {0, 1, 2}) {
    Options o = serial();
    o.max_divisions = most;
    Failing s(meshes::pile(4), o);
    s.plant(Plant::error, 1000);
    const std::string text = thrown<SolverError>([&] { s.step(); });
    CHECK(s.planted->failures == 1000 - 1 - most);   // the whole, 1/2, 1/4
    CHECK(contains(text, "pieces of this step") == (most > 0));
    CHECK(s.report().step == 0);
  }
}

TEST_CASE("the time step of a level that the scene leaves to it is the same for every mesh", "[levels]")
{
  for (int cells : {2, 40}) {
    const auto step = [&](const char *level, double frame_time = 0) {
      Scene s;
      s.frame_time = frame_time;
      s.cloths.push_back(meshes::cloth(meshes::grid(cells, cells, 0.4, 0.4)));
      return chosen_time_step(Options::at(accuracy_level(level)), s);
    };
    CHECK(step("preview") == Approx(1.0 / 120));
    CHECK(step("interactive") == Approx(1.0 / 240));
    CHECK(step("production") == Approx(1.0 / 240));
    CHECK(step("accurate") == Approx(1.0 / 1200));
    CHECK(step("reference") == Approx(1.0 / 4800));
    CHECK(step("paper") == Approx(1.0 / 60 / 4));
    CHECK(step("production", 0.005) == Approx(2.5e-3));  // two fill a frame
    CHECK(step("paper", 1.0 / 300) == Approx(1.0 / 300));
  }
  CHECK(chosen_time_step(Options(), Scene()) == Approx(1.0 / 240));
}

TEST_CASE("levels: names, time steps that fill frames, and who chose what", "[levels]")
{
  CHECK(accuracy_levels() ==
        std::vector<std::string>{"preview", "interactive", "production", "accurate", "reference", "paper"});
  CHECK(contains(thrown<SceneError>([] { accuracy_level("best"); }),
                 "preview, interactive, production, accurate, reference or paper"));
  Scene s = meshes::hanging(3);
  s.time_step = 0.005;
  const auto step = [&](const char *level) { return chosen_time_step(Options::at(accuracy_level(level)), s); };
  CHECK(step("production") == 0.005);
  CHECK(step("paper") == 0.005);
  CHECK(step("preview") == Approx(1.0 / 120));
  CHECK(step("accurate") == Approx(0.005 / 6));
  s.frame_time = 0.04;
  CHECK(step("preview") == Approx(0.008));  // five fill a frame
  CHECK(step("interactive") == Approx(0.004));
  s.time_step = 1e-4;
  CHECK(step("accurate") == Approx(1e-4));  // not coarser than the scene's
  Options o = Options::at(Accuracy::interactive);
  o.tolerance = 1e-2;
  o.time_step = 0.003;
  const auto origin = [&](const Options &options, const std::string &name) {
    for (const ChosenOption &k : resolve(options, s).chosen)
      if (k.name == name) return k.origin + " " + k.value;
    return std::string("absent");
  };
  CHECK(origin(o, "tolerance") == "user 0.01");
  CHECK(origin(o, "time_step") == "user 0.003 s");
  CHECK(origin(o, "precision") == "level single");
  Options longer;
  longer.time_step = 0.1;
  CHECK(origin(longer, "integrator") == "level bdf2");
  longer.time_step = 0.11;  // which resolves no motion
  CHECK(origin(longer, "integrator") == "time_step backward_euler");
  OptionOverrides asked;
  asked.time_step = 1;
  asked.integrator = Integrator::bdf2;
  CHECK(resolve(asked, s).options.integrator == Integrator::bdf2);
  CHECK(origin(Options::at(Accuracy::accurate), "time_step") == "level 0.0001 s");
  CHECK(origin(Options::at(Accuracy::paper), "time_step") == "scene 0.0001 s");
  o.time_step = -1;
  CHECK(contains(thrown<SceneError>([&] { Simulation(s, o); }), "time_step"));
  o.time_step = 0;
  o.newton_iterations = 0;
  CHECK(contains(thrown<SceneError>([&] { Simulation(s, o); }), "newton_iterations"));
}
