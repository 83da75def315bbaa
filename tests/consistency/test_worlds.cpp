// SPDX-License-Identifier: Apache-2.0
// Worlds: each ends in the bits of a simulation of its scene alone, and what happens to one changes no bit of another.
#include "../catch.hpp"

#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "../backends.hpp"
#include "../meshes.hpp"
#include "cama/error.hpp"
#include "cama/simulation.hpp"
#include "cama/stream.hpp"
#include "cama/worlds.hpp"
#include "device/recording_backend.hpp"
#include "everything.hpp"

using namespace cama;

namespace {

/// Two sheets on a ball, at another place and of another size in every world.
Scene scene_of(int world)
{
  Scene scene;
  for (int layer = 0; layer < 2; ++layer) {
    Cloth sheet;
    sheet.name = "sheet " + std::to_string(layer);
    const int cells = 6 + world % 3;
    sheet.mesh = meshes::grid(cells, cells, 0.3, 0.3, -0.15 + 0.01 * world, -0.15, 0.105 + 0.01 * layer);
    sheet.material = Material::isotropic(500, 0.3, 1e-5, 0.15);
    scene.cloths.push_back(sheet);
  }
  Obstacle ball;
  ball.name = "ball";
  ball.mesh = meshes::sphere(12, 8, 0.1);
  scene.obstacles.push_back(ball);
  return scene;
}

OptionOverrides options_on(const std::string &backend, const std::string &precision)
{
  OptionOverrides o;
  o.set("backend", backend);
  o.set("precision", precision);
  return o;
}

std::uint64_t hash_alone(const Scene &scene, const OptionOverrides &options, int steps)
{
  Simulation alone(scene, options);
  for (int i = 0; i < steps; ++i) alone.step();
  return alone.state_hash();
}

std::vector<Scene> scenes_of(int worlds)
{
  std::vector<Scene> scenes;
  for (int w = 0; w < worlds; ++w) scenes.push_back(scene_of(w));
  return scenes;
}

}  // namespace

TEST_CASE("every world ends in the bits of its scene alone", "[worlds]")
{
  constexpr int count = 7, steps = 12;
  const std::vector<Scene> scenes = scenes_of(count);
  for (const std::string &backend : backends_here())
    for (const char *precision : {"double", "mixed", "single"}) {
      INFO(backend << ", " << precision);
      const OptionOverrides options = options_on(backend, precision);
      Worlds worlds(scenes, {options});
      REQUIRE(worlds.size() == count);
      worlds.step();
      worlds.step(steps - 1);   // worlds do not wait for each other between these
      int contacts = 0;
      for (int w = 0; w < count; ++w) {
        INFO("world " << w);
        CHECK_FALSE(worlds.frozen(w));
        contacts += worlds[w].report().contacts;
        CHECK(worlds[w].state_hash() == hash_alone(scenes[static_cast<std::size_t>(w)], options, steps));
      }
      CHECK(contacts > 100);
      const std::vector<dvec3> all = worlds.positions(), last = worlds[count - 1].positions();
      REQUIRE(static_cast<int>(all.size()) == worlds.first_vertex(count));
      CHECK(all.back().z == last.back().z);
      CHECK(all[static_cast<std::size_t>(worlds.first_vertex(count - 1))].x == last.front().x);
    }
}

TEST_CASE("worlds of ten thousand triangles, served by a thread each, end in the bits of their scenes alone",
          "[worlds]")
{
  constexpr int count = 4, steps = 5;
  std::vector<Scene> scenes = scenes_of(count);
  for (int w = 0; w < count; ++w) {
    auto &cloths = scenes[static_cast<std::size_t>(w)].cloths;
    cloths.resize(1);
    cloths[0].mesh = meshes::grid(72, 72, 0.3, 0.3, -0.15 + 0.01 * w, -0.15, 0.1005);
  }
  for (const std::string &backend : backends_here()) {
    INFO(backend);
    OptionOverrides options = options_on(backend, "mixed");
    options.set("threads", 4);
    Worlds worlds(scenes, {options});
    worlds.step(steps);
    for (int w = 0; w < count; ++w) {
      INFO("world " << w);
      CHECK_FALSE(worlds.frozen(w));
      CHECK(worlds[w].report().contacts > 0);
      CHECK(worlds[w].state_hash() == hash_alone(scenes[static_cast<std::size_t>(w)], options, steps));
    }
  }
}

TEST_CASE("what a world begins while a repetition is made in another thread is no part of the repetition", "[worlds]")
{
  bool tested = false;
  for (const std::string &backend : backends_here()) {
    INFO(backend);
    const auto device = std::make_shared<SharedDevice>(make_backend(backend));
    const auto runner = device->backend->make_runner();
    if (!runner) continue;
    tested = true;
    RecordingBackend world(device);
    constexpr int n = 1000;
    Stream<int> repeated(*device->backend, n), own(world, n);
    device->backend->synchronize();
    world.synchronize();
    world.fill(own.buffer(), 0x11, n * sizeof(int));
    device->backend->repeat(2, [&] {
      device->backend->fill(repeated.buffer(), 0x22, n * sizeof(int));
      std::thread([&] {
        const OnDevice here(*device->backend);
        runner->follow(1);
        runner->begin({&world.queue});
      }).join();
    });
    while (!runner->ended(world.queue)) runner->check();
    world.take_answers();
    CHECK(own.download() == std::vector<int>(n, 0x11111111));
    CHECK(repeated.download() == std::vector<int>(n, 0x22222222));
  }
  if (!tested) WARN("SKIPPED: no backend here runs recorded worlds");
}

TEST_CASE("hundreds of worlds, half of which compute on the host while the device works for the others", "[worlds]")
{
  constexpr int count = 300, steps = 3;
  std::vector<Scene> scenes;
  for (int w = 0; w < count; ++w) {
    Scene scene;
    scene.cloths.push_back(meshes::cloth(meshes::grid(2, 2, 0.1, 0.1, 0, 0, 0.1e-3 * (1 + w)),
                                         Material::isotropic(500, 0.3, 1e-5, 0.15), "sheet"));
    scene.contact.thickness = 1e-3;
    Obstacle ground = exact_plane({0, 0, 0}, {0, 0, 1});
    ground.name = "ground";
    scene.obstacles.push_back(ground);
    scenes.push_back(scene);
  }
  for (const std::string &backend : backends_here()) {
    INFO(backend);
    const OptionOverrides options = options_on(backend, "mixed");
    Worlds worlds(scenes, {options});
    for (int i = 0; i < steps; ++i) worlds.step();
    for (int w = 0; w < count; w += 23) {
      INFO("world " << w);
      CHECK(worlds[w].state_hash() == hash_alone(scenes[static_cast<std::size_t>(w)], options, steps));
    }
  }
}

TEST_CASE("worlds of many kernels at once: all features, the steps chosen by an error", "[worlds]")
{
  const Scene scene = everything_scene::everything(8);
  for (const std::string &backend : backends_here()) {
    INFO(backend);
    OptionOverrides options = options_on(backend, "mixed");
    options.set_text("error", "0.2 %");
    Worlds worlds({scene, scene_of(0), scene}, {options});
    for (int i = 0; i < 6; ++i) worlds.step();
    CHECK(worlds[0].state_hash() == hash_alone(scene, options, 6));
    CHECK(worlds[1].state_hash() == hash_alone(scene_of(0), options, 6));
    CHECK(worlds[2].state_hash() == worlds[0].state_hash());
  }
}

TEST_CASE("a world that fails is frozen, and no other notices", "[worlds]")
{
  constexpr int count = 4, bad = 2;
  const std::vector<Scene> scenes = scenes_of(count);
  for (const std::string &backend : backends_here()) {
    INFO(backend);
    const OptionOverrides options = options_on(backend, "mixed");
    Worlds worlds(scenes, {options});
    for (int i = 0; i < 3; ++i) worlds.step();
    const std::uint64_t before = worlds[bad].state_hash();
    worlds[bad].set_force({0, 1, 2}, std::vector<dvec3>(3, dvec3{1e12, 0, 0}));
    for (int i = 0; i < 3; ++i) worlds.step();
    CHECK(worlds.frozen(bad));
    CHECK(worlds[bad].state_hash() == before);
    CHECK(worlds[bad].step_count() == 3);
    REQUIRE_THROWS_AS(worlds.rethrow(bad), SolverError);
    try {
      worlds.rethrow(bad);
    } catch (const SolverError &e) {
      CHECK(contains(e.what(), "world 2: step 4"));
    }
    worlds.reset({bad});
    CHECK_FALSE(worlds.frozen(bad));
    for (int i = 0; i < 6; ++i) worlds.step();
    for (int w = 0; w < count; ++w) {
      INFO("world " << w);
      CHECK(worlds[w].state_hash() == hash_alone(scenes[static_cast<std::size_t>(w)], options, w == bad ? 6 : 12));
    }
  }
}

TEST_CASE("a world may also take steps alone, and be set", "[worlds]")
{
  const std::vector<Scene> scenes = scenes_of(2);
  for (const std::string &backend : backends_here()) {
    INFO(backend);
    const OptionOverrides options = options_on(backend, "mixed");
    Worlds worlds(scenes, {options});
    worlds.step();
    worlds[0].step();
    worlds.step();
    CHECK(worlds[0].state_hash() == hash_alone(scenes[0], options, 3));
    CHECK(worlds[1].state_hash() == hash_alone(scenes[1], options, 2));
    const std::vector<dvec3> start = Simulation(scenes[1], options).positions();
    const std::vector<dvec3> x(start.begin(), start.begin() + worlds[1].cloth_vertex_count());
    worlds.set_state({1}, {x}, {std::vector<dvec3>(x.size(), dvec3{0, 0, -1})});
    Simulation alone(scenes[1], options);
    alone.step();
    alone.step();
    alone.set_state(x, std::vector<dvec3>(x.size(), dvec3{0, 0, -1}));
    alone.step();
    worlds.step();
    CHECK(worlds[1].state_hash() == alone.state_hash());
  }
}

TEST_CASE("worlds name what is wrong with one of them", "[worlds]")
{
  std::vector<Scene> scenes = scenes_of(3);
  scenes[1].cloths[0].material.density = -1;
  try {
    Worlds worlds(scenes, {OptionOverrides{}});
    FAIL("no error");
  } catch (const MaterialError &e) {
    CHECK(contains(e.what(), "world 1: "));
    CHECK(contains(e.what(), "density"));
  }
  CHECK_THROWS_AS(Worlds({}, {OptionOverrides{}}), SceneError);
  OptionOverrides cpu, other;
  cpu.set("backend", std::string("cpu"));
  other.set("backend", std::string("auto"));
  CHECK_THROWS_AS(Worlds(scenes_of(2), {cpu, other}), SceneError);
  Worlds worlds(scenes_of(2), {cpu});
  CHECK_THROWS_AS(worlds[2], SceneError);
  CHECK_THROWS_AS(worlds.reset({-1}), SceneError);
}
