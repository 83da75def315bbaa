// SPDX-License-Identifier: Apache-2.0
// A run that another simulation continues, on another backend or with other threads, stays the same bit by bit.
#include <cmath>
#include <functional>
#include <limits>

#include "../backends.hpp"
#include "../meshes.hpp"
#include "shipped.hpp"

using namespace cama;

namespace {

/// Steps to the checkpoint and after it: more than the ten that the Schwarz preconditioner keeps its matching.
struct Halves {
  int before, after;
};

/// Hash of a run through its checkpoint, and of simulations that begin there.
void check_continued(const Scene &scene, const Options &options, Halves halves, int &contacts)
{
  Simulation whole(scene, options);
  for (int i = 0; i < halves.before; ++i) whole.step();
  const Checkpoint kept = whole.checkpoint();
  contacts = whole.report().contacts;
  for (int i = 0; i < halves.after; ++i) whole.step();
  for (const std::string &backend : backends_here()) {
    INFO("continued on " << backend);
    Options other = options;
    other.backend = backend;
    // Tangled cloth in paper mode: 50,000 small launches a step.
    other.threads = backend != "cpu" ? 0 : options.accuracy == Accuracy::paper ? 1 : 2;
    Simulation second(scene, other);
    second.restore(kept);
    CHECK(second.time() == kept.numbers.at("time"));
    CHECK(second.step_count() == halves.before);
    for (int i = 0; i < halves.after; ++i) second.step();
    CHECK(second.state_hash() == whole.state_hash());
    CHECK(second.time() == whole.time());
  }
}

Scene let_go_of(double end)
{
  Scene scene = meshes::pile(8);
  Pin pin;
  pin.vertices = {0, 8};
  pin.release = end;
  scene.pins.push_back(pin);
  return scene;
}

}  // namespace

TEST_CASE("shipped scenes go on from a checkpoint bit by bit, on every backend", "[checkpoint]")
{
  int in_contact = 0;
  for (const std::string &name : shipped::scenes())
    for (const auto &[accuracy, precision] : {std::pair{"production", "mixed"}, std::pair{"production", "single"},
                                              std::pair{"accurate", "mixed"}, std::pair{"paper", "double"}}) {
      INFO(name << ", " << accuracy << ", " << precision);
      const Scene &scene = shipped::load(name, 200);
      Options options = shipped::options(accuracy, precision, "cpu", 1);
      options.time_step = scene.time_step;
      int contacts = 0;
      check_continued(scene, options, {25, 15}, contacts);
      in_contact += contacts > 0;
    }
  CHECK(in_contact >= 8);
}

TEST_CASE("a checkpoint keeps which pins have let go, and BDF2's history", "[checkpoint]")
{
  int contacts = 0;
  for (double end : {0.012, 0.021, 0.2}) {
    INFO("pins end at " << end << " s");
    Options options = Options::at(Accuracy::production);
    options.time_step = 0.002;
    check_continued(let_go_of(end), options, {10, 12}, contacts);
    CHECK(contacts > 0);
  }
  Options options = Options::at(Accuracy::accurate);
  options.time_step = 0.002;
  check_continued(meshes::hanging(8), options, {10, 5}, contacts);
  Simulation s(meshes::hanging(8), options);
  s.step();
  s.step();
  CHECK(s.checkpoint().vectors.at("position_before").size() == static_cast<std::size_t>(s.vertex_count()));
}

TEST_CASE("a simulation goes back to a checkpoint of its own", "[checkpoint]")
{
  Simulation s(meshes::pile(8));
  for (int i = 0; i < 5; ++i) s.step();
  const Checkpoint kept = s.checkpoint();
  for (int i = 0; i < 12; ++i) s.step();
  const std::uint64_t first = s.state_hash();
  s.restore(kept);
  CHECK(s.contacts().vertices.empty());
  REQUIRE_FALSE(kept.matching.order.empty());
  CHECK(s.checkpoint().matching.order == kept.matching.order);
  for (int i = 0; i < 12; ++i) s.step();
  CHECK(s.state_hash() == first);

  Options options;
  options.time_step = 0.005;
  Simulation held(let_go_of(0.03), options);
  for (int i = 0; i < 4; ++i) held.step();
  const Checkpoint pinned = held.checkpoint();
  for (int i = 0; i < 4; ++i) held.step();
  const std::uint64_t before = held.state_hash();
  held.restore(pinned);   // the pins hold again
  for (int i = 0; i < 4; ++i) held.step();
  CHECK(held.state_hash() == before);
}

TEST_CASE("time goes on from a checkpoint where the time step is another", "[checkpoint]")
{
  Options options;
  options.time_step = 0.004;
  Simulation coarse(meshes::pile(6), options);
  for (int i = 0; i < 3; ++i) coarse.step();
  options.time_step = 0.001;
  Simulation fine(meshes::pile(6), options);
  fine.restore(coarse.checkpoint());
  CHECK(std::abs(fine.time() - 0.012) < 1e-15);
  for (int i = 0; i < 2; ++i) fine.step();
  CHECK(std::abs(fine.time() - 0.014) < 1e-15);
  Simulation again(meshes::pile(6), options);
  again.restore(fine.checkpoint());
  fine.step();
  again.step();
  CHECK(again.time() == fine.time());
  CHECK(again.state_hash() == fine.state_hash());
}

TEST_CASE("checkpoints of other scenes and damaged ones are rejected with the field, and nothing changes",
          "[checkpoint]")
{
  Options options = Options::at(Accuracy::production);
  Simulation s(meshes::pile(8), options);
  for (int i = 0; i < 5; ++i) s.step();
  const Checkpoint good = s.checkpoint();
  REQUIRE(good.matching.levels.size() >= 2);
  s.step();
  const std::uint64_t before = s.state_hash();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<std::pair<const char *, std::function<void(Checkpoint &)>>> damages = {
      {"another scene", [](Checkpoint &c) { ++c.scene; }},
      {"another scene", [](Checkpoint &c) { c.vectors["position"].pop_back(); }},
      {"velocity has", [](Checkpoint &c) { c.vectors["velocity"].pop_back(); }},
      {"position[3] is not finite", [&](Checkpoint &c) { c.vectors["position"][3].y = nan; }},
      {"velocity[0] is not finite", [&](Checkpoint &c) { c.vectors["velocity"][0].x = HUGE_VAL; }},
      {"position_before has", [](Checkpoint &c) { c.vectors["position_before"].resize(2); }},
      {"step -1", [](Checkpoint &c) { c.step = -1; }},
      {"time", [&](Checkpoint &c) { c.numbers["time"] = nan; }},
      {"time", [](Checkpoint &c) { c.time_step = 0; }},
      {"smoothed_steps -1", [](Checkpoint &c) { c.numbers["smoothed_steps"] = -1; }},
      {"smoothed_steps 10000", [](Checkpoint &c) { c.numbers["smoothed_steps"] = 1e300; }},
      {"tangled", [](Checkpoint &c) { c.tangled.push_back({0, 1 << 30}); }},
      {"let_go", [](Checkpoint &c) { c.let_go.push_back({0, 99}); }},
      {"friction_pair has 1 rows, friction_force 0",
       [](Checkpoint &c) { c.friction_pair = {{0, 1, 2}}, c.friction_force.clear(); }},
      {"friction_pair[1]", [](Checkpoint &c) { c.friction_pair = {{0, 1, 2}, {0, 1, 2}}, c.friction_force.resize(2); }},
      {"friction_pair[0]", [](Checkpoint &c) { c.friction_pair = {{2, 1, 2}}, c.friction_force.resize(1); }},
      {"friction_force[0]", [&](Checkpoint &c) { c.friction_pair = {{0, 1, 2}}, c.friction_force = {{nan, 0, 0}}; }},
      {"exempt from contact", [](Checkpoint &c) { c.tangled.push_back({0, 1}); }},
      {"matching: step -2147483648", [](Checkpoint &c) { c.matching.step = std::numeric_limits<int>::min(); }},
      {"2147483647 terms", [](Checkpoint &c) { c.matching.terms = std::numeric_limits<int>::max(); }},
      {"-1 iterations", [](Checkpoint &c) { c.matching.last_iterations = -1; }},
      {"appears twice", [](Checkpoint &c) { c.matching.order[1] = c.matching.order[0]; }},
      {"vertex -7", [](Checkpoint &c) { c.matching.order[0] = -7; }},
      {"level 0 does not have", [](Checkpoint &c) { c.matching.order.pop_back(); }},
      {"level 0, node", [](Checkpoint &c) { c.matching.levels[0].parent[0] = 5; }},
      {"level 0, block 0", [](Checkpoint &c) { c.matching.levels[0].start[1] = 0; }},
      {"level 0, block 1", [](Checkpoint &c) { c.matching.levels[0].start[2] = 1 << 30; }},
      {"level 1 does not have", [](Checkpoint &c) { c.matching.levels[1].start.clear(); }},
      {"without levels", [](Checkpoint &c) { c.matching.levels.clear(); }},
  };
  for (const auto &[text, damage] : damages) {
    INFO(text);
    Checkpoint c = good;
    damage(c);
    CHECK(contains(thrown<SceneError>([&] { s.restore(c); }), text));
    CHECK(s.state_hash() == before);
    CHECK(s.step_count() == 6);
  }
  // The cloth inside the ball.
  Checkpoint tangled = good;
  for (int v = 0; v < s.cloth_vertex_count(); ++v) tangled.vectors["position"][static_cast<std::size_t>(v)].z -= 0.05;
  CHECK(contains(thrown<CollisionError>([&] { s.restore(tangled); }), "crosses"));
  CHECK(s.state_hash() == before);
  // A matching with more levels than the limit is ignored.
  Checkpoint deep = good;
  REQUIRE(deep.matching.levels.back().start.size() == 2);
  for (int i = 0; i < 5; ++i) deep.matching.levels.push_back({{0}, {0, 1}});
  Options once = options;   // a further solve would end at three times the tolerance
  once.newton_iterations = 1;
  Simulation plain(meshes::pile(8), once);
  plain.restore(deep);
  plain.step();
  CHECK(plain.report().residual < options.tolerance);
  CHECK(plain.checkpoint().matching.levels.size() <= 3);
  // A matching of vertices other than the free ones is ignored.
  Scene pinned = meshes::pile(8);
  Pin pin;
  pin.vertices = {0, 8};
  pinned.pins.push_back(pin);
  Simulation other(pinned, once);
  other.restore(good);
  other.step();
  CHECK(other.report().residual < options.tolerance);
}

TEST_CASE("the checkpoint of a start repeats the run, also in a simulation that has gone on", "[checkpoint]")
{
  OptionOverrides options;
  options.set("backend", std::string("cpu"));
  for (const char *error : {"", "0.2 %"}) {
    INFO("error " << error);
    options.set("error", std::string(error));
    Simulation run(meshes::pile(6), options);
    const Checkpoint start = run.checkpoint();
    for (int i = 0; i < 3; ++i) run.step();
    const std::uint64_t first = run.state_hash();
    for (int i = 0; i < 2; ++i) run.step();
    run.restore(start);
    for (int i = 0; i < 3; ++i) run.step();
    CHECK(run.state_hash() == first);
  }
}
