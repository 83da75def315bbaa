// SPDX-License-Identifier: Apache-2.0
#include "cama/worlds.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <exception>
#include <initializer_list>
#include <new>
#include <numeric>
#include <string>
#include <utility>

#include "cama/error.hpp"
#include "device/host_threads.hpp"
#include "worlds/world_server.hpp"

namespace cama {
namespace {

template <class Exception> [[noreturn]] void name_world(int world, const Exception &problem)
{
  throw Exception("world " + std::to_string(world) + ": " + problem.what());
}

/// Throws what was thrown, with the world in front of its text.
[[noreturn]] void rethrow_of(int world, const std::exception_ptr &thrown)
{
  try {
    std::rethrow_exception(thrown);
  } catch (const SceneError &e) {
    name_world(world, e);
  } catch (const MeshError &e) {
    name_world(world, e);
  } catch (const MaterialError &e) {
    name_world(world, e);
  } catch (const FileError &e) {
    name_world(world, e);
  } catch (const MemoryError &e) {
    name_world(world, e);
  } catch (const BackendError &e) {
    name_world(world, e);
  } catch (const SolverError &e) {
    name_world(world, e);
  } catch (const CollisionError &e) {
    name_world(world, e);
  }
}

bool lost_device(const std::exception_ptr &thrown)
{
  try {
    std::rethrow_exception(thrown);
  } catch (const MemoryError &) {
    return false;
  } catch (const BackendError &) {
    return true;
  } catch (...) {
    return false;
  }
}

int steps_per_frame(const Simulation &s, double seconds_per_frame)
{
  return std::max(1, static_cast<int>(std::lround(seconds_per_frame / s.time_step())));
}

}  // namespace

struct Worlds::Implementation {
  struct World {
    std::unique_ptr<Simulation> simulation;
    RecordingBackend *backend = nullptr;  // null where worlds do not share a device
    Checkpoint start;
    double seconds_per_frame = 0;
    std::exception_ptr failure;
    int first_vertex = 0;
  };

  Implementation(const std::vector<Scene> &scenes, const std::vector<OptionOverrides> &options);

  /// Does work(world, its place among the chosen) for the chosen worlds side by side. `work` may not throw.
  void run(const std::vector<int> &chosen, const std::function<void(World &, std::size_t)> &work);
  /// The same with work that may throw; afterwards throws the first of its errors.
  void attempt(const std::vector<int> &chosen, const std::function<void(World &, std::size_t)> &work);
  /// The same where `check` passes for all of them; else throws the first of its errors, and nothing has changed.
  template <class Check, class Act> void drive(const std::vector<int> &chosen, const Check &check, const Act &act);
  /// One answer of each.
  template <class Ask> auto ask(const std::vector<int> &chosen, const Ask &question);
  std::vector<int> all() const;
  /// Does steps(world) for all worlds that are not frozen; one whose steps throw is frozen.
  void advance(const std::function<void(const World &)> &steps);
  /// A field of all worlds, one after the other.
  std::vector<dvec3> gather(std::vector<dvec3> (Simulation::*field)() const);
  /// The same on the device, in memory of its own. copy: to an address.
  DeviceArray gather_on_device(const std::function<void(Simulation &, void *)> &copy);
  const World &world(int index) const;
  /// Throws SceneError for a world that is not there or is named twice.
  void check_chosen(const std::vector<int> &chosen) const;

  std::unique_ptr<WorldServer> server;  // of a device with one queue for all
  std::unique_ptr<Crew> crew;
  std::vector<World> worlds;
  int vertices = 0;
};

Worlds::Implementation::Implementation(const std::vector<Scene> &scenes, const std::vector<OptionOverrides> &given)
{
  if (scenes.empty()) throw SceneError("worlds: has no scene; give one for each world");
  if (given.size() != 1 && given.size() != scenes.size())
    throw SceneError("worlds: has options of " + std::to_string(given.size()) + " worlds and " +
                     std::to_string(scenes.size()) + " scenes; give one for all, or one for each");
  const auto options_of = [&](std::size_t w) -> const OptionOverrides & { return given[given.size() == 1 ? 0 : w]; };
  ResolvedOptions first;
  try {
    scenes.front().validate();
    first = resolve(options_of(0), scenes.front());
  } catch (const Error &) {
    rethrow_of(0, std::current_exception());
  }
  std::unique_ptr<Backend> device =
      make_backend(first.options.backend, first.options.device, first.options.backend == "cpu" ? 1 : 0);
  const int threads = first.options.threads > 0 ? first.options.threads : cpu_count();
  const std::string name(device->name());
  if (name != "cpu" && Fiber::supported()) server = std::make_unique<WorldServer>(std::move(device));
  crew = std::make_unique<Crew>(std::min(threads, static_cast<int>(scenes.size())));
  worlds.resize(scenes.size());

  std::vector<std::exception_ptr> thrown(scenes.size());
  std::atomic<std::size_t> next{0};
  crew->run([&](int) {
    const HostThreads host(1);
    for (std::size_t w = next++; w < scenes.size(); w = next++) {
      try {
        World &world = worlds[w];
        ResolvedOptions resolved = resolve(options_of(w), scenes[w]);
        const Options &o = resolved.options;
        if (o.backend != first.options.backend || o.device != first.options.device)
          throw SceneError("backend: " + o.backend + ", device " + std::to_string(o.device) +
                           ", is not that of world 0; all worlds need the same");
        resolved.options.threads = 1;
        std::unique_ptr<Backend> own;
        if (server) {
          std::unique_ptr<RecordingBackend> recorder = server->make_world();
          world.backend = recorder.get();
          own = std::move(recorder);
        } else {
          own = make_backend(name, o.device, name == "cpu" ? 1 : 0);
        }
        world.simulation.reset(new Simulation(scenes[w], resolved, std::move(own)));
        world.start = world.simulation->checkpoint();
        world.seconds_per_frame = scenes[w].seconds_per_frame();
      } catch (const std::bad_alloc &) {
        thrown[w] = std::make_exception_ptr(MemoryError("out of memory on the host; use fewer worlds"));
      } catch (...) {
        thrown[w] = std::current_exception();
      }
    }
  });
  for (std::size_t w = 0; w < thrown.size(); ++w)
    if (thrown[w]) rethrow_of(static_cast<int>(w), thrown[w]);
  for (World &world : worlds) {
    world.first_vertex = vertices;
    vertices += world.simulation->vertex_count();
  }
}

const Worlds::Implementation::World &Worlds::Implementation::world(int index) const
{
  if (index < 0 || index >= static_cast<int>(worlds.size()))
    throw SceneError("worlds: " + std::to_string(index) + " is out of range; there are " +
                     std::to_string(worlds.size()) + " worlds, counted from 0");
  return worlds[static_cast<std::size_t>(index)];
}

void Worlds::Implementation::run(const std::vector<int> &chosen, const std::function<void(World &, std::size_t)> &work)
{
  const HostThreads host(1);
  const auto at = [&](std::size_t i) -> World & { return worlds[static_cast<std::size_t>(chosen[i])]; };
  if (server) {
    std::vector<WorldServer::Task> tasks;
    for (std::size_t i = 0; i < chosen.size(); ++i)
      tasks.push_back({at(i).backend, [&work, &world = at(i), i] { work(world, i); }});
    return server->run(*crew, tasks);
  }
  std::atomic<std::size_t> next{0};
  crew->run([&](int) {
    const HostThreads own(1);
    for (std::size_t i = next++; i < chosen.size(); i = next++) work(at(i), i);
  });
}

void Worlds::Implementation::advance(const std::function<void(const World &)> &steps)
{
  std::vector<int> alive;
  for (std::size_t w = 0; w < worlds.size(); ++w)
    if (!worlds[w].failure) alive.push_back(static_cast<int>(w));
  run(alive, [&steps](World &w, std::size_t) {
    try {
      steps(w);
    } catch (...) {
      w.failure = std::current_exception();
    }
  });
  for (const int w : alive) {
    const std::exception_ptr &failure = worlds[static_cast<std::size_t>(w)].failure;
    if (failure && lost_device(failure)) rethrow_of(w, failure);
  }
}

void Worlds::Implementation::attempt(const std::vector<int> &chosen,
                                     const std::function<void(World &, std::size_t)> &work)
{
  std::vector<std::exception_ptr> thrown(chosen.size());
  run(chosen, [&](World &w, std::size_t i) {
    try {
      work(w, i);
    } catch (...) {
      thrown[i] = std::current_exception();
    }
  });
  for (std::size_t i = 0; i < thrown.size(); ++i)
    if (thrown[i]) rethrow_of(chosen[i], thrown[i]);
}

void Worlds::Implementation::check_chosen(const std::vector<int> &chosen) const
{
  std::vector<char> seen(worlds.size(), 0);
  for (const int w : chosen) {
    world(w);
    if (seen[static_cast<std::size_t>(w)]++) throw SceneError("worlds: world " + std::to_string(w) + " is named twice");
  }
}

template <class Check, class Act>
void Worlds::Implementation::drive(const std::vector<int> &chosen, const Check &check, const Act &act)
{
  check_chosen(chosen);
  attempt(chosen, [&](World &w, std::size_t i) { check(*w.simulation, i); });
  attempt(chosen, [&](World &w, std::size_t i) { act(*w.simulation, i); });
}

template <class Ask> auto Worlds::Implementation::ask(const std::vector<int> &chosen, const Ask &question)
{
  check_chosen(chosen);
  std::vector<decltype(question(*worlds.front().simulation, std::size_t(0)))> answers(chosen.size());
  attempt(chosen, [&](World &w, std::size_t i) { answers[i] = question(*w.simulation, i); });
  return answers;
}

std::vector<int> Worlds::Implementation::all() const
{
  std::vector<int> every(worlds.size());
  std::iota(every.begin(), every.end(), 0);
  return every;
}

std::vector<dvec3> Worlds::Implementation::gather(std::vector<dvec3> (Simulation::*field)() const)
{
  std::vector<dvec3> values(static_cast<std::size_t>(vertices));
  attempt(all(), [&](World &w, std::size_t) {
    const std::vector<dvec3> own = (*w.simulation.*field)();
    std::copy(own.begin(), own.end(), values.begin() + w.first_vertex);
  });
  return values;
}

DeviceArray Worlds::Implementation::gather_on_device(const std::function<void(Simulation &, void *)> &copy)
{
  DeviceArray values = worlds.front().simulation->device_memory(vertices);
  auto *first = static_cast<dvec3 *>(values.data());
  attempt(all(), [&](World &w, std::size_t) { copy(*w.simulation, first + w.first_vertex); });
  if (server) server->device().synchronize();  // a world's own backend records, and does not wait
  return values;
}

namespace {

/// Each argument has a row for each of the worlds.
void check_rows(const char *what, const std::vector<int> &worlds, std::initializer_list<std::size_t> rows)
{
  for (const std::size_t count : rows)
    if (count != worlds.size())
      throw SceneError("worlds: " + std::string(what) + ": an argument is of " + std::to_string(count) +
                       " worlds, and there are " + std::to_string(worlds.size()) + " worlds");
}

}  // namespace

Worlds::Worlds(const std::vector<Scene> &scenes, const std::vector<OptionOverrides> &options)
    : implementation_(std::make_unique<Implementation>(scenes, options))
{}
Worlds::~Worlds() = default;
Worlds::Worlds(Worlds &&) noexcept = default;
Worlds &Worlds::operator=(Worlds &&) noexcept = default;

int Worlds::size() const { return static_cast<int>(implementation_->worlds.size()); }
Simulation &Worlds::operator[](int world) { return *implementation_->world(world).simulation; }
const Simulation &Worlds::operator[](int world) const { return *implementation_->world(world).simulation; }

void Worlds::step(int steps)
{
  implementation_->advance([steps](const Implementation::World &w) {
    for (int i = 0; i < steps; ++i) w.simulation->step();
  });
}

void Worlds::step_frame()
{
  implementation_->advance([](const Implementation::World &w) {
    Simulation &s = *w.simulation;
    if (s.error() > 0) {
      do s.step();
      while (!s.frame_ended());
    } else {
      for (int i = steps_per_frame(s, w.seconds_per_frame); i > 0; --i) s.step();
    }
  });
}

bool Worlds::frozen(int world) const { return implementation_->world(world).failure != nullptr; }

void Worlds::rethrow(int world) const
{
  if (const std::exception_ptr &failure = implementation_->world(world).failure) rethrow_of(world, failure);
}

void Worlds::reset(const std::vector<int> &worlds)
{
  implementation_->check_chosen(worlds);
  implementation_->attempt(worlds, [](Implementation::World &w, std::size_t) {
    w.simulation->restore_own(w.start);
    w.failure = nullptr;
  });
}

void Worlds::set_state(const std::vector<int> &worlds, const std::vector<std::vector<dvec3>> &positions,
                       const std::vector<std::vector<dvec3>> &velocities)
{
  implementation_->check_chosen(worlds);
  if (positions.size() != worlds.size() || velocities.size() != worlds.size())
    throw SceneError("worlds: set_state has positions of " + std::to_string(positions.size()) + " and velocities of " +
                     std::to_string(velocities.size()) + " worlds, and " + std::to_string(worlds.size()) + " worlds");
  implementation_->attempt(
      worlds, [&](Implementation::World &w, std::size_t i) { w.simulation->set_state(positions[i], velocities[i]); });
}

void Worlds::pin(const std::vector<int> &worlds, const Vertices &vertices, const Vectors &targets, double duration)
{
  check_rows("pin", worlds, {vertices.size(), targets.size()});
  implementation_->drive(
      worlds, [&](const Simulation &s, std::size_t i) { s.check_pin(vertices[i], targets[i], duration); },
      [&](Simulation &s, std::size_t i) { s.pin(vertices[i], targets[i], duration); });
}

void Worlds::set_targets(const std::vector<int> &worlds, const Vertices &vertices, const Vectors &positions,
                         double duration)
{
  check_rows("set_targets", worlds, {vertices.size(), positions.size()});
  implementation_->drive(
      worlds, [&](const Simulation &s, std::size_t i) { s.check_targets(vertices[i], positions[i], duration); },
      [&](Simulation &s, std::size_t i) { s.set_targets(vertices[i], positions[i], duration); });
}

void Worlds::release(const std::vector<int> &worlds, const Vertices &vertices)
{
  check_rows("release", worlds, {vertices.size()});
  implementation_->drive(
      worlds, [&](const Simulation &s, std::size_t i) { s.check_release(vertices[i]); },
      [&](Simulation &s, std::size_t i) { s.release(vertices[i]); });
}

void Worlds::set_force(const std::vector<int> &worlds, const Vertices &vertices, const Vectors &forces)
{
  check_rows("set_force", worlds, {vertices.size(), forces.size()});
  implementation_->drive(
      worlds, [&](const Simulation &s, std::size_t i) { s.check_force(vertices[i], forces[i]); },
      [&](Simulation &s, std::size_t i) { s.set_force(vertices[i], forces[i]); });
}

void Worlds::set_obstacle_pose(const std::vector<int> &worlds, const std::vector<int> &obstacle,
                               const std::vector<dvec3> &translation,
                               const std::vector<std::array<double, 4>> &rotation, double duration)
{
  check_rows("set_obstacle_pose", worlds, {obstacle.size(), translation.size(), rotation.size()});
  implementation_->drive(
      worlds,
      [&](const Simulation &s, std::size_t i) { s.check_pose(obstacle[i], translation[i], rotation[i], duration); },
      [&](Simulation &s, std::size_t i) { s.set_obstacle_pose(obstacle[i], translation[i], rotation[i], duration); });
}

void Worlds::set_gravity(const std::vector<int> &worlds, const std::vector<dvec3> &gravity)
{
  check_rows("set_gravity", worlds, {gravity.size()});
  implementation_->drive(
      worlds, [&](const Simulation &s, std::size_t i) { s.check_gravity(gravity[i]); },
      [&](Simulation &s, std::size_t i) { s.set_gravity(gravity[i]); });
}

void Worlds::set_wind(const std::vector<int> &worlds, const std::vector<dvec3> &velocity)
{
  check_rows("set_wind", worlds, {velocity.size()});
  implementation_->drive(
      worlds, [&](const Simulation &s, std::size_t i) { s.check_wind(velocity[i]); },
      [&](Simulation &s, std::size_t i) { s.set_wind(velocity[i]); });
}

std::vector<dvec3> Worlds::gravity() const
{
  return implementation_->ask(implementation_->all(), [](const Simulation &s, std::size_t) { return s.gravity(); });
}
std::vector<dvec3> Worlds::wind() const
{
  return implementation_->ask(implementation_->all(), [](const Simulation &s, std::size_t) { return s.wind(); });
}

std::vector<Wrench> Worlds::force_on_obstacle(const std::vector<int> &worlds, const std::vector<int> &obstacle) const
{
  check_rows("force_on", worlds, {obstacle.size()});
  return implementation_->ask(worlds,
                              [&](const Simulation &s, std::size_t i) { return s.force_on_obstacle(obstacle[i]); });
}

std::vector<Wrench> Worlds::force_on_vertices(const std::vector<int> &worlds, const Vertices &vertices) const
{
  check_rows("force_on", worlds, {vertices.size()});
  return implementation_->ask(worlds,
                              [&](const Simulation &s, std::size_t i) { return s.force_on_vertices(vertices[i]); });
}

std::vector<ContactArrays> Worlds::contacts(const std::vector<int> &worlds) const
{
  return implementation_->ask(worlds, [](const Simulation &s, std::size_t) { return s.contacts(); });
}

int Worlds::first_vertex(int world) const
{
  return world == size() ? implementation_->vertices : implementation_->world(world).first_vertex;
}

std::vector<dvec3> Worlds::positions() const { return implementation_->gather(&Simulation::positions); }
std::vector<dvec3> Worlds::velocities() const { return implementation_->gather(&Simulation::velocities); }

std::vector<dvec3> Worlds::forces() const { return implementation_->gather(&Simulation::forces); }
std::vector<dvec3> Worlds::impulses() const { return implementation_->gather(&Simulation::impulses); }

DeviceArray Worlds::device_positions()
{
  return implementation_->gather_on_device(
      [](Simulation &s, void *to) { s.copy_to(to, Simulation::Field::positions); });
}
DeviceArray Worlds::device_velocities()
{
  return implementation_->gather_on_device(
      [](Simulation &s, void *to) { s.copy_to(to, Simulation::Field::velocities); });
}
DeviceArray Worlds::device_forces()
{
  return implementation_->gather_on_device([](Simulation &s, void *to) { s.copy_to(to, Simulation::Field::forces); });
}

long Worlds::launches() const { return implementation_->server ? implementation_->server->launches() : 0; }

}  // namespace cama
