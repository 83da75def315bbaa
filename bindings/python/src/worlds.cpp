// SPDX-License-Identifier: Apache-2.0
#include "cama/worlds.hpp"

#include <algorithm>
#include <chrono>

#include "arrays.hpp"
#include "guarded.hpp"

namespace cama::python {
namespace {

/// Worlds that several Python threads may use, one at a time.
class GuardedWorlds {
public:
  GuardedWorlds(const std::vector<Scene> &scenes, const std::vector<OptionOverrides> &options)
      : worlds_(std::make_shared<Worlds>(scenes, options)), turns_(std::make_shared<Turns>())
  {
    if (worlds_->size() == 0) return;
    const Backend &backend = (*worlds_)[0].backend();
    backend.leave_to(backend.device_before());
  }

  template <class Ask> auto with(Ask &&ask)
  {
    turns_->await_background();
    py::gil_scoped_release release;
    std::lock_guard<std::mutex> lock(turns_->mutex);
    const OnDevice device((*worlds_)[0].backend());
    return ask(*worlds_);
  }
  /// A world, which keeps all of them alive.
  std::unique_ptr<Guarded> world(int w)
  {
    Simulation *simulation = with([w](Worlds &worlds) { return &worlds[w]; });
    return std::make_unique<Guarded>(std::shared_ptr<Simulation>(worlds_, simulation), turns_);
  }
  Turns &turns() { return *turns_; }
  const std::shared_ptr<Turns> &shared_turns() const { return turns_; }

  int steps_at_once = 1;  ///< in which no world waits for another, and no signal is raised

private:
  std::shared_ptr<Worlds> worlds_;
  std::shared_ptr<Turns> turns_;
};

void begin_interval(GuardedWorlds &g)
{
  g.with([](Worlds &worlds) {
    for (int w = 0; w < worlds.size(); ++w) worlds[w].begin_interval();
  });
}

/// Takes the GIL twice a second, or after each step that lasts longer, and raises pending signals (Ctrl-C).
void step(GuardedWorlds &g, int n)
{
  using Clock = std::chrono::steady_clock;
  constexpr double between = 0.5, most = 1e6;  // s, steps
  begin_interval(g);
  while (n > 0) {
    const int steps = std::min(n, g.steps_at_once);
    const auto begin = Clock::now();
    g.with([steps](Worlds &worlds) { worlds.step(steps); });
    const double seconds = std::chrono::duration<double>(Clock::now() - begin).count();
    g.steps_at_once = static_cast<int>(std::clamp(between * steps / std::max(seconds, between / most), 1.0, most));
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
    n -= steps;
  }
}

/// [worlds + 1]
std::vector<int> first_vertices(Worlds &worlds)
{
  std::vector<int> first;
  for (int w = 0; w <= worlds.size(); ++w) first.push_back(worlds.first_vertex(w));
  return first;
}

template <class T, class Array> std::vector<std::vector<T>> to_vectors(const std::vector<Array> &arrays)
{
  std::vector<std::vector<T>> result;
  for (const Array &array : arrays) result.push_back(to_vector<T>(array));
  return result;
}

/// Vectors of the wrenches of worlds, [worlds, 3] each: force, torque, impulse, angular impulse.
py::tuple wrench_arrays(const std::vector<Wrench> &wrenches)
{
  const auto column = [&](dvec3 Wrench::*part) {
    std::vector<dvec3> values;
    for (const Wrench &w : wrenches) values.push_back(w.*part);
    return to_array<double>(std::move(values));
  };
  return py::make_tuple(column(&Wrench::force), column(&Wrench::torque), column(&Wrench::impulse),
                        column(&Wrench::angular_impulse));
}

/// Binds a member function that returns vectors of all worlds.
auto gather(std::vector<dvec3> (Worlds::*method)() const)
{
  return [method](GuardedWorlds &g) { return to_array<double>(g.with([method](Worlds &w) { return (w.*method)(); })); };
}
/// Binds a member function that returns them on the device.
auto gather_on_device(DeviceArray (Worlds::*method)())
{
  return [method](GuardedWorlds &g) {
    const auto [array, worlds] = g.with([method](Worlds &w) { return std::pair((w.*method)(), w.size()); });
    return LentArray{array, g.shared_turns(), worlds};
  };
}
/// Binds pin, set_targets.
auto targets(void (Worlds::*method)(const std::vector<int> &, const Worlds::Vertices &, const Worlds::Vectors &,
                                    double))
{
  return [method](GuardedWorlds &g, const Ints &worlds, const std::vector<Ints> &vertices,
                  const std::vector<Doubles> &positions, double duration) {
    const auto chosen = to_vector<int>(worlds);
    const auto v = to_vectors<int>(vertices);
    const auto x = to_vectors<dvec3>(positions);
    g.with([&](Worlds &w) { (w.*method)(chosen, v, x, duration); });
  };
}
/// Binds set_gravity, set_wind.
auto vector_of_each(void (Worlds::*method)(const std::vector<int> &, const std::vector<dvec3> &))
{
  return [method](GuardedWorlds &g, const Ints &worlds, const Doubles &values) {
    const auto chosen = to_vector<int>(worlds);
    const auto v = to_vector<dvec3>(values);
    g.with([&](Worlds &w) { (w.*method)(chosen, v); });
  };
}

}  // namespace

void bind_worlds(py::module_ &m)
{
  py::class_<GuardedWorlds> bound(m, "Worlds");
  bind_turns(bound);
  bound
      .def(py::init([](const std::vector<const Scene *> &scenes, const std::vector<OptionOverrides> &options) {
        std::vector<Scene> own;
        own.reserve(scenes.size());
        for (const Scene *scene : scenes) own.push_back(*scene);
        py::gil_scoped_release release;
        return std::make_unique<GuardedWorlds>(own, options);
      }))
      .def("size", [](GuardedWorlds &g) { return g.with([](Worlds &w) { return w.size(); }); })
      .def("world", &GuardedWorlds::world)
      .def("step", &step)
      .def("step_frame",
           [](GuardedWorlds &g) {
             begin_interval(g);
             g.with([](Worlds &worlds) { worlds.step_frame(); });
           })
      .def("frozen",
           [](GuardedWorlds &g) {
             return g.with([](Worlds &w) {
               std::vector<int> frozen;
               for (int i = 0; i < w.size(); ++i)
                 if (w.frozen(i)) frozen.push_back(i);
               return frozen;
             });
           })
      .def("raise_error", [](GuardedWorlds &g, int world) { g.with([world](Worlds &w) { w.rethrow(world); }); })
      .def("reset",
           [](GuardedWorlds &g, const Ints &worlds) {
             const auto chosen = to_vector<int>(worlds);
             g.with([&](Worlds &w) { w.reset(chosen); });
           })
      .def("set_state",
           [](GuardedWorlds &g, const Ints &worlds, const std::vector<Doubles> &positions,
              const std::vector<Doubles> &velocities) {
             const auto chosen = to_vector<int>(worlds);
             const auto x = to_vectors<dvec3>(positions), v = to_vectors<dvec3>(velocities);
             g.with([&](Worlds &w) { w.set_state(chosen, x, v); });
           })
      .def("first_vertices", [](GuardedWorlds &g) { return g.with(first_vertices); })
      .def("pin", targets(&Worlds::pin))
      .def("set_targets", targets(&Worlds::set_targets))
      .def("release",
           [](GuardedWorlds &g, const Ints &worlds, const std::vector<Ints> &vertices) {
             const auto chosen = to_vector<int>(worlds);
             const auto v = to_vectors<int>(vertices);
             g.with([&](Worlds &w) { w.release(chosen, v); });
           })
      .def("set_force",
           [](GuardedWorlds &g, const Ints &worlds, const std::vector<Ints> &vertices,
              const std::vector<Doubles> &forces) {
             const auto chosen = to_vector<int>(worlds);
             const auto v = to_vectors<int>(vertices);
             const auto f = to_vectors<dvec3>(forces);
             g.with([&](Worlds &w) { w.set_force(chosen, v, f); });
           })
      .def("set_obstacle_pose",
           [](GuardedWorlds &g, const Ints &worlds, const Ints &obstacles, const Doubles &translations,
              const Doubles &rotations, double duration) {
             const auto chosen = to_vector<int>(worlds), o = to_vector<int>(obstacles);
             const auto t = to_vector<dvec3>(translations);
             const auto r = to_vector<std::array<double, 4>>(rotations);
             g.with([&](Worlds &w) { w.set_obstacle_pose(chosen, o, t, r, duration); });
           })
      .def("set_gravity", vector_of_each(&Worlds::set_gravity))
      .def("set_wind", vector_of_each(&Worlds::set_wind))
      .def("gravity", gather(&Worlds::gravity))
      .def("wind", gather(&Worlds::wind))
      .def("force_on_obstacle",
           [](GuardedWorlds &g, const Ints &worlds, const Ints &obstacles) {
             const auto chosen = to_vector<int>(worlds), o = to_vector<int>(obstacles);
             return wrench_arrays(g.with([&](Worlds &w) { return w.force_on_obstacle(chosen, o); }));
           })
      .def("force_on_vertices",
           [](GuardedWorlds &g, const Ints &worlds, const std::vector<Ints> &vertices) {
             const auto chosen = to_vector<int>(worlds);
             const auto v = to_vectors<int>(vertices);
             return wrench_arrays(g.with([&](Worlds &w) { return w.force_on_vertices(chosen, v); }));
           })
      .def("contacts",
           [](GuardedWorlds &g, const Ints &worlds) {
             const auto chosen = to_vector<int>(worlds);
             py::list rows;
             for (ContactArrays &c : g.with([&](Worlds &w) { return w.contacts(chosen); }))
               rows.append(contact_arrays(std::move(c)));
             return rows;
           })
      .def("positions", gather(&Worlds::positions))
      .def("velocities", gather(&Worlds::velocities))
      .def("forces", gather(&Worlds::forces))
      .def("impulses", gather(&Worlds::impulses))
      .def("device_positions", gather_on_device(&Worlds::device_positions))
      .def("device_velocities", gather_on_device(&Worlds::device_velocities))
      .def("device_forces", gather_on_device(&Worlds::device_forces))
      .def("launches", [](GuardedWorlds &g) { return g.with([](Worlds &w) { return w.launches(); }); });
}

}  // namespace cama::python
