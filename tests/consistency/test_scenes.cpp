// SPDX-License-Identifier: Apache-2.0
// The shipped scenes on every backend: stage by stage from the start and in contact, free runs by their hash, hashes
// pinned in hashes.txt, and what must hold for any run, whatever its bits.
#include <cinttypes>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <numeric>
#include <sstream>

#include "../backends.hpp"
#include "../meshes.hpp"
#include "device/fnv.hpp"
#include "lockstep.hpp"
#include "shipped.hpp"

using namespace cama;

namespace {

std::vector<std::string> devices_here()
{
  std::vector<std::string> names;
  for (const std::string &name : backends_here())
    if (name != "cpu") names.push_back(name);
  return names;
}

/// Runs every scene, precision and accuracy level in lock step on one backend: `steps` from the start and `steps` in
/// contact. Returns the number of scenes with contacts.
int check_lock_step(const std::string &backend, int triangles, int steps, int most)
{
  int in_contact = 0;
  for (const std::string &name : shipped::scenes()) {
    const Scene &scene = shipped::load(name, triangles);
    const shipped::Moment &moment = shipped::in_contact(name, triangles, 20, most);
    in_contact += moment.contacts >= 20;
    for (const char *accuracy : {"production", "paper", "accurate"})
      for (const std::string &precision : shipped::precisions)
        for (bool late : {false, true}) {
          INFO(name << ", " << accuracy << ", " << precision
                    << (late ? ", from step " + std::to_string(moment.step) : ", from the start") << ", " << backend);
          StagedEngine reference(scene, shipped::options(accuracy, precision, "cpu", 1));
          StagedEngine candidate(scene, shipped::options(accuracy, precision, backend, 7));
          if (late) {
            shipped::start_at(reference, moment);
            shipped::start_at(candidate, moment);
          }
          CHECK(lockstep::run(reference, candidate, steps) == "");
        }
  }
  return in_contact;
}

/// Hash of the functions of the maths library that generated meshes, placements and motions use.
std::uint64_t maths_library()
{
  std::uint64_t hash = fnv1a(nullptr, 0);
  for (int i = 1; i <= 4000; ++i) {
    const double x = 0.001 * i,
                 values[] = {std::sin(x),        std::cos(x),        std::tan(x),      std::atan2(x, 1.3),
                             std::acos(x / 4.1), std::hypot(x, 0.7), std::pow(x, -4.0)};
    hash = fnv1a(values, sizeof values, hash);
  }
  return hash;
}

/// start: hash of the scene before the first step, obstacles and masses included.
struct Result {
  int triangles;
  std::uint64_t start, hash;
};

Result run(const std::string &name, int triangles, int steps, const Options &options)
{
  Simulation simulation(shipped::load(name, triangles), options);
  const std::vector<dvec3> x = simulation.positions();
  const std::vector<double> mass = simulation.masses();
  const std::uint64_t start =
      fnv1a(mass.data(), mass.size() * sizeof(double), fnv1a(x.data(), x.size() * sizeof(dvec3)));
  for (int i = 0; i < steps; ++i) simulation.step();
  return {simulation.cloth_triangle_count(), start, simulation.state_hash()};
}

// More than 512 vertices: smaller loops are not shared among threads.
constexpr int pinned_steps = 50, pinned_triangles = 1000;

/// The result on one thread; computed once.
const Result &serial(const std::string &name, const std::string &precision)
{
  static std::map<std::pair<std::string, std::string>, Result> known;
  const auto found = known.find({name, precision});
  if (found != known.end()) return found->second;
  return known[{name, precision}] =
             run(name, pinned_triangles, pinned_steps, shipped::options("production", precision, "cpu", 1));
}

const char *pins_file = CAMA_SOURCE_DIR "/tests/consistency/hashes.txt";
const char *pins_command = "CAMA_PIN=1 build/tests/cama_tests \"[pins]\"";

std::string hex(std::uint64_t value)
{
  char text[17];
  std::snprintf(text, sizeof text, "%016" PRIx64, value);
  return text;
}

/// Maps "drape double 50 1176" to "start hash", and "libm" to the maths library that the hashes were made with.
std::map<std::string, std::string> read_pins()
{
  std::map<std::string, std::string> pins;
  std::ifstream file(pins_file);
  for (std::string line; std::getline(file, line);) {
    std::istringstream words(line);
    std::string scene, precision, steps, triangles, start, hash;
    if (line.rfind("# libm ", 0) == 0)
      pins["libm"] = line.substr(7);
    else if (line.rfind("#", 0) != 0 && words >> scene >> precision >> steps >> triangles >> start >> hash)
      pins[scene + " " + precision + " " + steps + " " + triangles] = start + " " + hash;
  }
  return pins;
}

void write_pins(const std::map<std::string, std::string> &pins)
{
  std::ofstream file(pins_file);
  file << "# State hashes of the shipped scenes, cpu, accuracy production. They change when an algorithm changes on "
          "purpose; rewrite them then:\n"
       << "#   " << pins_command << "\n# libm " << hex(maths_library())
       << "\n# scene precision steps triangles, hash of the start, hash of the end\n";
  for (const auto &[key, value] : pins) file << key << " " << value << "\n";
}

}  // namespace

TEST_CASE("lock step of the shipped scenes: seven threads agree with one", "[lockstep][scenes]")
{
  CHECK(check_lock_step("cpu", 300, 2, 150) >= 4);
}

TEST_CASE("lock step of the shipped scenes: every backend agrees with cpu", "[lockstep][scenes]")
{
  if (!lockstep::strict_build()) return;
  for (const std::string &backend : devices_here()) CHECK(check_lock_step(backend, 300, 2, 150) >= 4);
}

TEST_CASE("lock step of the shipped scenes at 3000 triangles, ten steps", "[lockstep][scenes][.][long]")
{
  if (!lockstep::strict_build()) return;
  for (const std::string &backend : devices_here()) CHECK(check_lock_step(backend, 3000, 10, 300) >= 4);
}

TEST_CASE("the state hashes of the shipped scenes are those that are pinned", "[determinism][scenes][pins]")
{
  if (!lockstep::strict_build()) return;
  std::map<std::string, std::string> now;
  for (const std::string &name : shipped::scenes())
    for (const std::string &precision : shipped::precisions) {
      const Result &r = serial(name, precision);
      now[name + " " + precision + " " + std::to_string(pinned_steps) + " " + std::to_string(r.triangles)] =
          hex(r.start) + " " + hex(r.hash);
    }
  if (const char *pin = std::getenv("CAMA_PIN"); pin && std::string(pin) == "1") {
    write_pins(now);
    WARN("wrote " << pins_file);
    return;
  }
  std::map<std::string, std::string> pinned = read_pins();
  const bool same_library = pinned["libm"] == hex(maths_library());
  pinned.erase("libm");
  int other_bits = 0;
  for (const auto &[key, value] : now) {
    INFO(key << "; if results change on purpose: " << pins_command);
    REQUIRE(pinned.count(key) == 1);
    if (!same_library) {
      other_bits += pinned[key] != value;
      continue;
    }
    INFO("the first word is the hash of the scene before the first step");
    CHECK(pinned[key] == value);
  }
  if (!same_library) {
    ++skipped;
    WARN("SKIPPED: hashes were pinned with another maths library, whose sines place meshes and obstacles; "
         << other_bits << " of " << now.size() << " differ");
  }
  INFO("pins of scenes that are not there; " << pins_command);
  CHECK(pinned.size() == now.size());
}

TEST_CASE("the state hashes of the shipped scenes are the same for 1, 2 and 7 threads", "[determinism][scenes]")
{
  for (const std::string &name : shipped::scenes())
    for (const std::string &precision : shipped::precisions)
      for (int threads : {2, 7}) {
        if ((threads == 7) != (precision == "mixed")) continue;   // each precision with one of them
        INFO(name << ", " << precision << ", " << threads << " threads");
        CHECK(
            run(name, pinned_triangles, pinned_steps, shipped::options("production", precision, "cpu", threads)).hash ==
            serial(name, precision).hash);
      }
}

TEST_CASE("the state hashes of the shipped scenes are the same on every backend", "[determinism][scenes]")
{
  if (!lockstep::strict_build()) return;
  for (const std::string &backend : devices_here())
    for (const std::string &name : shipped::scenes())
      for (const std::string &precision : shipped::precisions) {
        INFO(name << ", " << precision << ", " << backend);
        CHECK(run(name, pinned_triangles, pinned_steps, shipped::options("production", precision, backend)).hash ==
              serial(name, precision).hash);
      }
}

TEST_CASE("every accuracy level gives the same hash on every backend and for 1 and 3 threads",
          "[determinism][scenes][levels]")
{
  Scene everything = meshes::pile(5);
  everything.cloths[0].material.damping = 0.002;
  everything.wind = Wind{{1, 0.5, 0}, 1.2, 0.1};
  everything.stitches.push_back({0, 35, 1, 35, 34, 0.25, 50});
  const auto hash = [&](const std::string &level, const std::string &backend, int threads, bool shipped_scene) {
    Options o = Options::at(accuracy_level(level));
    o.backend = backend;
    o.threads = threads;
    Simulation simulation(shipped_scene ? shipped::load("drape", 700) : everything, o);
    if (shipped_scene) {
      const shipped::Moment &moment = shipped::in_contact("drape", 700, 20, 150);
      const auto n = static_cast<std::size_t>(simulation.cloth_vertex_count());
      simulation.set_state({moment.position.begin(), moment.position.begin() + static_cast<long>(n)},
                           {moment.velocity.begin(), moment.velocity.begin() + static_cast<long>(n)});
    }
    for (int i = 0; i < (level == "reference" ? 3 : 6); ++i) simulation.step();
    return simulation.state_hash();
  };
  for (const std::string &level : accuracy_levels())
    for (bool shipped_scene : {false, true}) {
      const std::uint64_t one = hash(level, "cpu", 1, shipped_scene);
      INFO(level << (shipped_scene ? ", drape" : ", everything"));
      CHECK(hash(level, "cpu", 3, shipped_scene) == one);
      if (lockstep::strict)
        for (const std::string &backend : devices_here()) {
          INFO(backend);
          CHECK(hash(level, backend, 0, shipped_scene) == one);
        }
    }
}

TEST_CASE("state hashes after 200 steps at 5000 triangles, and in the paper's mode, are the same on every backend",
          "[determinism][scenes][.][long]")
{
  if (!lockstep::strict_build()) return;
  for (const std::string &backend : devices_here())
    for (const std::string &name : shipped::scenes())
      for (const std::string &precision : shipped::precisions) {
        INFO(name << ", " << precision << ", " << backend);
        for (const auto &[accuracy, triangles, steps] : {std::tuple{"production", 5000, 200}, {"paper", 1200, 50}})
          CHECK(run(name, triangles, steps, shipped::options(accuracy, precision, backend)).hash ==
                run(name, triangles, steps, shipped::options(accuracy, precision, "cpu", 2)).hash);
      }
}

namespace {

/// Change of momentum of a sheet that stretches, bends and turns freely, in 60 steps, relative to the sum of all
/// vertices' momenta.
double momentum_drift(const Scene &scene, const Options &options)
{
  Simulation simulation(scene, options);
  const std::vector<double> mass = simulation.masses();
  std::vector<dvec3> x = simulation.positions(), v(x.size());
  for (std::size_t i = 0; i < x.size(); ++i)
    v[i] = {0.5 + 0.3 * std::sin(9 * x[i].x), -0.2 + 0.3 * x[i].x, 0.1 + 0.4 * std::cos(7 * x[i].x + 5 * x[i].y)};
  simulation.set_state(x, v);
  const auto momentum = [&](const std::vector<dvec3> &velocity) {
    dvec3 p{0, 0, 0};
    for (std::size_t i = 0; i < mass.size(); ++i) p = kernels::daxpy(p, mass[i], velocity[i]);
    return p;
  };
  const dvec3 before = momentum(v);
  double all = 0;
  for (std::size_t i = 0; i < mass.size(); ++i) all += mass[i] * kernels::dnorm(v[i]);
  for (int i = 0; i < 60; ++i) simulation.step();
  CHECK(kernels::dnorm(kernels::dsub(simulation.velocities()[0], v[0])) > 0.01);   // its internal forces did move it
  return kernels::dnorm(kernels::dsub(momentum(simulation.velocities()), before)) / all;
}

}  // namespace

TEST_CASE("a free sheet keeps its momentum on every backend", "[scenes][invariants]")
{
  // Internal forces cancel in the sum; the residual of the solve and rounding remain. Forces rounded to single
  // precision lose momentum with any solver: no more than with the direct one, which solves in double.
  double direct = 0;
  for (const std::string &backend : backends_here())
    for (const std::string &precision : shipped::precisions) {
      INFO(backend << ", " << precision);
      Scene scene;
      scene.time_step = 1.0 / 200;
      scene.gravity = {0, 0, 0};
      scene.cloths.push_back(meshes::cloth(meshes::grid(12, 12, 0.4, 0.4)));
      Options o = shipped::options("production", precision, backend, 2);
      o.tolerance = 1e-8;
      if (precision == "single" && direct == 0) {
        Options reference = o;
        reference.solver = LinearSolver::direct;
        direct = momentum_drift(scene, reference);
        CHECK(direct < 1.1e-4);
      }
      CHECK(momentum_drift(scene, o) < (precision == "single" ? 1.02 * direct : 1e-6));
    }
}

TEST_CASE("sheets that are thrown by many edges a step do not pass what the commit holds back", "[scenes][invariants]")
{
  // Pairs that a coordinate separates throughout are no candidates, as long as all vertices go their whole way. One
  // round of impacts leaves much to the commit, which holds single vertices back.
  for (const std::string &backend : backends_here()) {
    INFO(backend);
    Scene scene;
    scene.time_step = 1.0 / 200;
    for (int k = 0; k < 3; ++k) {
      Cloth cloth = meshes::cloth(meshes::grid(40, 40, 0.4, 0.4), meshes::cotton(), "sheet " + std::to_string(k));
      for (dvec3 &x : cloth.mesh.position) {   // a wave, turned up steeply: it falls along itself
        const double along = x.x + 0.2;
        x = {0.02 * std::sin(40 * x.y) + 0.03 * k + 0.3 * (along - 0.2), x.y, 0.5 + along};
      }
      cloth.velocity = {0, 0, -8};
      scene.cloths.push_back(cloth);
    }
    scene.obstacles.push_back(meshes::obstacle(meshes::sphere(16, 10, 0.1)));
    Options o = shipped::options("production", "mixed", backend, 2);
    o.max_impact_passes = 1;
    o.audit = true;
    Simulation simulation(scene, o);
    int truncated = 0;
    for (int i = 0; i < 40; ++i) {
      simulation.step();
      REQUIRE(simulation.report().intersections == 0);
      truncated += simulation.report().truncated;
    }
    CHECK(truncated > 100);
  }
}

TEST_CASE("free runs: finite, without intersections, energy bounded by that of the start on every backend",
          "[scenes][invariants]")
{
  for (const std::string &backend : backends_here())
    for (const char *name :
         {"drape", "funnel", "shapes"})   // no obstacle does work on the cloth in the first half second
      for (const std::string &precision : shipped::precisions) {
        if (precision != "mixed" && std::string(name) != "drape") continue;
        INFO(name << ", " << precision << ", " << backend);
        Simulation simulation(shipped::load(name, 600), shipped::options("production", precision, backend, 2));
        const auto total = [&] {
          const Energy e = simulation.energy();
          return e.kinetic + e.stretching + e.bending + e.gravity;
        };
        const double start = total();
        const std::vector<double> mass = simulation.masses();
        const double weight = 9.81 * std::accumulate(mass.begin(), mass.end(), 0.0);
        int contacts = 0;
        for (int i = 0; i < 80; ++i) {
          simulation.step();
          contacts = std::max(contacts, simulation.report().contacts);
          // Implicit Euler loses energy; the penalty, which the sum leaves out, returns at most what it took: sheets
          // raised by a thickness.
          CHECK(total() < start + weight * 2e-3);
        }
        CHECK(contacts > 20);
        CHECK(simulation.count_intersections() == 0);
        for (const dvec3 &x : simulation.positions()) REQUIRE(std::isfinite(x.x + x.y + x.z));
        for (const dvec3 &v : simulation.velocities()) REQUIRE(std::isfinite(v.x + v.y + v.z));
      }
}
