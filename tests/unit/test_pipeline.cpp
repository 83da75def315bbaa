// SPDX-License-Identifier: Apache-2.0
// The pipeline is built from the scene: features that a scene does not have add no stage and no stream, and do not move
// the cloth.
#include "../catch.hpp"

#include <algorithm>
#include <cstring>
#include <set>

#include "../engine.hpp"
#include "../meshes.hpp"

using namespace cama;

namespace {

Scene falling(bool contact = false, bool self = false)
{
  Scene s;
  s.time_step = 1.0 / 200;
  s.contact.enabled = contact;
  s.contact.self = self;
  s.cloths.push_back(meshes::cloth(meshes::grid(4, 4, 0.2, 0.2)));
  return s;
}

std::set<std::string> stages(const Scene &scene, const char *precision = "double")
{
  Options o = serial();
  o.precision = precision_of(precision);
  o.integrator = Integrator::backward_euler;
  o.newton_iterations = 1;
  StagedEngine engine(scene, o);
  std::set<std::string> names;
  for (Stage *stage : engine.leaves()) names.insert(std::string(stage->name()));
  return names;
}

std::set<std::string> streams(const Scene &scene)
{
  Simulation simulation(scene, serial());
  simulation.step();
  std::set<std::string> names;
  for (const StreamInfo &info : simulation.streams())
    if (info.size) names.insert(info.name);
  return names;
}

bool has_any(const std::set<std::string> &names, const std::vector<std::string> &parts)
{
  return std::any_of(names.begin(), names.end(), [&](const std::string &name) {
    return std::any_of(parts.begin(), parts.end(), [&](const std::string &part) { return contains(name, part); });
  });
}

const std::set<std::string> always = {"element forces", "matrix assembly", "linear solve", "advance positions",
                                      "finish step"};
const std::set<std::string> contact_stages = {"candidate search", "contacts", "contact terms", "keep friction",
                                              "penetration handling"};
const std::vector<std::string> contact_streams = {"tree",      "bvh",       "box",     "order",  "pairs",
                                                  "direction", "gap_bound", "contact", "impact", "margin",
                                                  "bounds",    "predicted", "face",    "edge"};

std::set<std::string> with(std::set<std::string> a, const std::set<std::string> &b)
{
  a.insert(b.begin(), b.end());
  return a;
}

/// Cloth 0 after some steps, bit for bit, with the reports.
struct Run {
  std::vector<dvec3> position, velocity;
  int contacts = 0;
};

Run follow(const Scene &scene, int steps, const Options &options)
{
  Simulation simulation(scene, options);
  Run r;
  for (int i = 0; i < steps; ++i) {
    simulation.step();
    r.contacts = std::max(r.contacts, simulation.report().contacts + simulation.report().impacts);
  }
  const int n = simulation.cloth_ranges()[0].second;
  r.position = simulation.positions();
  r.velocity = simulation.velocities();
  r.position.resize(static_cast<std::size_t>(n));
  r.velocity.resize(static_cast<std::size_t>(n));
  return r;
}

bool same(const std::vector<dvec3> &a, const std::vector<dvec3> &b)
{
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(dvec3)) == 0;
}

double apart(const std::vector<dvec3> &a, const std::vector<dvec3> &b)
{
  double most = 0;
  for (std::size_t i = 0; i < a.size(); ++i) most = std::max(most, kernels::dnorm(kernels::dsub(a[i], b[i])));
  return most;
}

}  // namespace

TEST_CASE("a sheet alone gets the five stages of an implicit step", "[pipeline]")
{
  CHECK(stages(falling()) == always);
  CHECK(stages(falling(), "single") == always);
}

TEST_CASE("no obstacle and no contact of cloth with cloth: no contact stages", "[pipeline]")
{
  CHECK(stages(falling(true, false)) == always);
  CHECK(stages(falling(true, true)) == with(always, contact_stages));
  Scene scene = falling(true, false);
  scene.obstacles.push_back(meshes::obstacle(meshes::sphere(6, 4, 0.1, {0, 0, -1})));
  CHECK(stages(scene) == with(always, contact_stages));
  scene.contact.enabled = false;
  CHECK(stages(scene) == always);
}

TEST_CASE("no obstacle and no contact of cloth with cloth: no contact streams", "[pipeline]")
{
  CHECK_FALSE(has_any(streams(falling()), contact_streams));
  CHECK_FALSE(has_any(streams(falling(true, false)), contact_streams));
  CHECK(has_any(streams(falling(true, true)), contact_streams));
}

TEST_CASE("no bending stiffness: no hinges", "[pipeline]")
{
  Scene scene = falling();
  CHECK(has_any(streams(scene), {"hinge"}));
  scene.cloths[0].material = Material::isotropic(100, 0.3, 0, 0.1);
  CHECK_FALSE(has_any(streams(scene), {"hinge"}));
}

TEST_CASE("no wind: no wind stream", "[pipeline]")
{
  Scene scene = falling();
  CHECK_FALSE(has_any(streams(scene), {"wind"}));
  scene.wind = Wind{{1, 0, 0}, 1.2, 0};
  CHECK(has_any(streams(scene), {"wind"}));
}

TEST_CASE("stitches bring terms, and no collision", "[pipeline]")
{
  Scene scene = falling();
  CHECK_FALSE(has_any(streams(scene), {"term", "stitch"}));
  scene.stitches.push_back({0, 0, 0, 24, 23, 0.5, 10});
  CHECK(stages(scene) == with(always, {"contact terms"}));
  const std::set<std::string> names = streams(scene);
  CHECK(has_any(names, {"stitch"}));
  CHECK(has_any(names, {"term"}));
  CHECK_FALSE(has_any(names, {"tree", "pairs", "impact"}));
}

TEST_CASE("prescribed motion is there for pins and moving obstacles alone", "[pipeline]")
{
  Scene scene = falling(true, true);
  scene.obstacles.push_back(meshes::obstacle(meshes::sphere(6, 4, 0.1, {0, 0, -1})));
  CHECK_FALSE(stages(scene).count("prescribed motion"));
  Scene moving = scene;
  moving.obstacles[0].motion.velocity = {1, 0, 0};
  CHECK(stages(moving).count("prescribed motion"));
  Scene pinned = scene;
  Pin pin;
  pin.vertices = {0};
  pinned.pins.push_back(pin);
  CHECK(stages(pinned).count("prescribed motion"));
}

TEST_CASE("one material, one entry: no table for constant stiffness, one for cloths of the same fabric", "[pipeline]")
{
  const auto entries = [](const Scene &scene) {
    StagedEngine engine(scene);
    return engine.state.system.template of<double>().stretching_table.size();
  };
  Scene scene = falling();
  CHECK(entries(scene) == 1);
  scene.cloths.push_back(meshes::cloth(meshes::grid(2, 2, 1, 1, 2), meshes::cotton(), "second"));
  CHECK(entries(scene) == 1);
  scene.cloths[0].material.stretching[3][0] *= 1.5;
  scene.cloths[1].material = scene.cloths[0].material;
  CHECK(entries(scene) == 30 * 30 * 30);
}

TEST_CASE("only the chosen precision is there", "[pipeline]")
{
  for (const char *precision : {"double", "single"}) {
    Options o = serial();
    o.precision = precision_of(precision);
    StagedEngine engine(falling(), o);
    CHECK((engine.state.system.f64 != nullptr) == (o.precision == Precision::full));
    CHECK((engine.state.system.f32 != nullptr) == (o.precision == Precision::single));
  }
}

TEST_CASE("single precision refuses cloth whose mass it would lose beside its stiffness", "[pipeline]")
{
  Scene s = meshes::hanging(3);
  const std::vector<double> masses = Simulation(s).masses();
  const double lightest = *std::min_element(masses.begin(), masses.end()),
               limit = 8e9 * lightest / (0.005 * (0.005 + s.cloths[0].material.damping));
  const auto refused = [&](double stiffness, const std::string &precision) {
    for (auto &row : s.cloths[0].material.stretching) row = {stiffness, 0.3 * stiffness, stiffness, 0.3 * stiffness};
    Options o;
    o.precision = precision_of(precision);
    try {
      Simulation(s, o);
    } catch (const MaterialError &error) {
      return contains(error.what(), "cloth 'cloth': stiffness of") && contains(error.what(), "beyond single precision");
    }
    return false;
  };
  CHECK(refused(1.01 * limit, "single"));
  CHECK_FALSE(refused(0.99 * limit, "single"));
  CHECK_FALSE(refused(1.01 * limit, "mixed"));
}

TEST_CASE("explain gives every stage a reason, timings follow the same order", "[pipeline]")
{
  Simulation simulation(meshes::pile(4), serial());
  simulation.step();
  const auto explained = simulation.explain();
  const auto times = simulation.timings();
  REQUIRE(explained.size() == times.size());
  for (std::size_t i = 0; i < times.size(); ++i) {
    CHECK_FALSE(explained[i].second.empty());
    CHECK(contains(explained[i].first, times[i].name));
    CHECK(times[i].milliseconds >= 0);
  }
}

namespace {

/// The draped sheet alone, and with an obstacle far away.
std::pair<Run, Run> beside_obstacle(const Motion &motion)
{
  Scene scene = meshes::sheet_on_ball();
  const Run alone = follow(scene, 20, serial());
  REQUIRE(alone.contacts > 10);
  scene.obstacles.push_back(meshes::obstacle(meshes::sphere(8, 6, 0.2, {5, 3, 1}), motion, "far"));
  return {alone, follow(scene, 20, serial())};
}

std::vector<Motion> resting_and_moving()
{
  Motion moving;
  moving.velocity = {1, 0, 0};
  return {Motion{}, moving};
}

}  // namespace

TEST_CASE("a distant obstacle moves the cloth by no more than rounding", "[pipeline]")
{
  for (const Motion &motion : resting_and_moving()) {
    const auto [alone, beside] = beside_obstacle(motion);
    CHECK(beside.contacts == alone.contacts);
    CHECK(apart(alone.position, beside.position) < 1e-11);
  }
}

// Candidate pairs come in the order of the trees, whose Morton codes are relative to the bounds of the whole scene;
// contacts and impacts are sorted by their features (ListedPairs), so that sums over them do not depend on it.
TEST_CASE("a distant obstacle does not move the cloth by one bit", "[pipeline]")
{
  for (const Motion &motion : resting_and_moving()) {
    const auto [alone, beside] = beside_obstacle(motion);
    INFO("moved by " << apart(alone.position, beside.position) << " m");
    CHECK(same(alone.position, beside.position));
    CHECK(same(alone.velocity, beside.velocity));
  }
}

TEST_CASE("wind of zero density and no drag moves nothing", "[pipeline]")
{
  Scene scene = meshes::sheet_on_ball();
  const Run still = follow(scene, 10, serial());
  scene.wind = Wind{{3, 0, 0}, 0, 0};
  const Run windless = follow(scene, 10, serial());
  CHECK(apart(still.position, windless.position) == 0);
}

TEST_CASE("contact that never touches does not move the cloth by one bit", "[pipeline]")
{
  const Run without = follow(falling(), 20, serial());
  Scene scene = falling(true, true);
  scene.obstacles.push_back(meshes::obstacle(meshes::sphere(6, 4, 0.1, {0, 0, -3})));
  const Run detected = follow(scene, 20, serial());
  REQUIRE(detected.contacts == 0);
  CHECK(same(without.position, detected.position));
  CHECK(same(without.velocity, detected.velocity));
}

TEST_CASE("a distant cloth that needs no solving does not move the first by one bit", "[pipeline]")
{
  // Both hang; all vertices of the far one are pinned: it adds rows to the system but nothing to its dot products.
  Scene scene = meshes::hanging(8);
  const Run alone = follow(scene, 20, serial());
  scene.cloths.push_back(meshes::cloth(meshes::grid(3, 3, 0.1, 0.1, 10), meshes::cotton(), "far"));
  Pin pin;
  pin.cloth = 1;
  for (int v = 0; v < 16; ++v) pin.vertices.push_back(v);
  scene.pins.push_back(pin);
  const Run beside = follow(scene, 20, serial());
  INFO("moved by " << apart(alone.position, beside.position) << " m");
  CHECK(same(alone.position, beside.position));
}

TEST_CASE("a distant cloth moves the first by no more than the solver's tolerance", "[pipeline]")
{
  // One conjugate gradient solve serves all cloths: its step lengths and its end are common, so bits do change, and
  // with them which pairs are contacts. With a direct solve, or as the tolerance decreases, the results agree. A sheet
  // that crashes on a ball makes differences larger, from 6 times the tolerance after 8 steps to 50 after 20.
  Scene scene = meshes::sheet_on_ball();
  for (dvec3 &x : scene.cloths[0].mesh.position)
    x = {x.x + 0.013, x.y + 0.007, x.z};  // off the ball's axes, where contacts would be ties
  Scene both = scene;
  both.cloths.push_back(
      meshes::cloth(meshes::grid(6, 6, 0.2, 0.2, 5, 3, 0), Material::isotropic(1000, 0.2, 1e-5, 0.3), "far"));
  Options o = serial();
  double moved[2];
  for (int k = 0; k < 2; ++k) {
    o.tolerance = k ? 1e-10 : 1e-7;
    moved[k] = apart(follow(scene, 20, o).position, follow(both, 20, o).position);
  }
  o.solver = LinearSolver::direct;
  const double direct = apart(follow(scene, 20, o).position, follow(both, 20, o).position);
  INFO("moved by " << moved[0] << " m at 1e-7, " << moved[1] << " m at 1e-10, " << direct << " m direct");
  CHECK(moved[0] < 1e-5);
  CHECK(moved[1] < 1e-7);
  CHECK(moved[1] < 1e-2 * moved[0]);
  CHECK(direct < 1e-9);
}
