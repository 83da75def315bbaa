// SPDX-License-Identifier: Apache-2.0
#include "cama/worlds.hpp"

#include "guarded.hpp"

namespace cama::python {
namespace {

/// Worlds that several Python threads may use, one at a time.
class GuardedWorlds {
public:
  GuardedWorlds(const std::vector<Scene> &scenes, const std::vector<OptionOverrides> &options)
      : worlds_(std::make_shared<Worlds>(scenes, options)), turns_(std::make_shared<Turns>())
  {}

  template <class Ask> auto with(Ask &&ask)
  {
    turns_->await_background();
    py::gil_scoped_release release;
    std::lock_guard<std::mutex> lock(turns_->mutex);
    (*worlds_)[0].backend().make_current();
    return ask(*worlds_);
  }
  /// A world, which keeps all of them alive.
  std::unique_ptr<Guarded> world(int w)
  {
    Simulation *simulation = with([w](Worlds &worlds) { return &worlds[w]; });
    return std::make_unique<Guarded>(std::shared_ptr<Simulation>(worlds_, simulation), turns_);
  }
  Turns &turns() { return *turns_; }

private:
  std::shared_ptr<Worlds> worlds_;
  std::shared_ptr<Turns> turns_;
};

/// Calls n times, and between takes the GIL and raises pending signals (Ctrl-C).
void advance(GuardedWorlds &g, int n, void (Worlds::*method)())
{
  g.with([](Worlds &worlds) {
    for (int w = 0; w < worlds.size(); ++w) worlds[w].begin_interval();
  });
  for (int i = 0; i < n; ++i) {
    g.with([method](Worlds &worlds) { (worlds.*method)(); });
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
  }
}

/// [worlds + 1]
std::vector<int> first_vertices(Worlds &worlds)
{
  std::vector<int> first;
  for (int w = 0; w <= worlds.size(); ++w) first.push_back(worlds.first_vertex(w));
  return first;
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
      .def("step", [](GuardedWorlds &g, int n) { advance(g, n, &Worlds::step); })
      .def("step_frame", [](GuardedWorlds &g) { advance(g, 1, &Worlds::step_frame); })
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
             const auto vectors = [](const std::vector<Doubles> &arrays) {
               std::vector<std::vector<dvec3>> result;
               for (const Doubles &array : arrays) result.push_back(to_vector<dvec3>(array));
               return result;
             };
             const auto x = vectors(positions), v = vectors(velocities);
             g.with([&](Worlds &w) { w.set_state(chosen, x, v); });
           })
      .def("first_vertices", [](GuardedWorlds &g) { return g.with(first_vertices); })
      .def("positions",
           [](GuardedWorlds &g) { return to_array<double>(g.with([](Worlds &w) { return w.positions(); })); })
      .def("velocities",
           [](GuardedWorlds &g) { return to_array<double>(g.with([](Worlds &w) { return w.velocities(); })); })
      .def("launches", [](GuardedWorlds &g) { return g.with([](Worlds &w) { return w.launches(); }); });
}

}  // namespace cama::python
