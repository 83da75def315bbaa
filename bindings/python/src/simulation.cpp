// SPDX-License-Identifier: Apache-2.0
#include "cama/simulation.hpp"

#include <array>

#include "arrays.hpp"
#include "cama/error.hpp"
#include "guarded.hpp"

namespace cama::python {
namespace {

/// Takes n steps; between steps it takes the GIL and raises pending signals (Ctrl-C).
void step(Guarded &g, int n)
{
  for (int i = 0; i < n; ++i) {
    g.with([](Simulation &s) { s.step(); });
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
  }
}

template <class Row> py::list chosen_rows(const Row &chosen)
{
  py::list rows;
  for (const ChosenOption &o : chosen) rows.append(py::make_tuple(o.name, o.value, o.origin, o.trades));
  return rows;
}

/// Every option by its name.
py::dict to_dict(const Options &options)
{
  py::dict d;
  for (const OptionInfo &row : option_table()) d[py::str(row.name)] = py::cast(option_value(options, row.name));
  return d;
}

py::list table_of_options()
{
  py::list rows;
  for (const OptionInfo &o : option_table()) {
    py::dict row, levels;
    for (const auto &[level, value] : o.levels) levels[py::str(level)] = py::cast(value);
    row["name"] = o.name;
    row["type"] = o.type;
    row["words"] = o.words;
    row["levels"] = levels;
    row["range"] = o.range;
    row["unit"] = o.unit;
    row["set_by"] = o.set_by;
    row["trades"] = o.trades;
    row["help"] = o.help;
    rows.append(row);
  }
  return rows;
}

py::list table_of_report()
{
  py::list rows;
  for (const ReportInfo &r : report_table()) {
    py::dict row;
    row["name"] = r.name;
    row["type"] = r.type;
    row["unit"] = r.unit;
    row["adds"] = r.adds;
    row["help"] = r.help;
    rows.append(row);
  }
  return rows;
}

void bind_options(py::module_ &m)
{
  py::class_<OptionOverrides>(m, "OptionOverrides")
      .def(py::init<>())
      .def("set", &OptionOverrides::set)
      .def("set_text", &OptionOverrides::set_text)
      .def("values", [](const OptionOverrides &o) {
        py::dict d;
        for (const auto &[name, value] : o.values()) d[py::str(name)] = py::cast(value);
        return d;
      });
  m.def("option_table", &table_of_options);
  m.def("report_table", &table_of_report);
  m.def("accuracy_levels", &accuracy_levels);
  m.def("check_scene_options", &check_scene_options);
  m.def("level_options", [](const std::string &level) { return to_dict(Options::at(accuracy_level(level))); });
  m.def("level_time_step", [](const std::string &level, const Scene &scene) {
    return chosen_time_step(Options::at(accuracy_level(level)), scene);
  });
  m.def("resolve", [](const OptionOverrides &user, const Scene &scene) {
    const ResolvedOptions resolved = resolve(user, scene);
    return py::make_tuple(to_dict(resolved.options), chosen_rows(resolved.chosen));
  });
}

py::dict to_dict(const StepReport &report)
{
  py::dict d;
  visit(report, [&](const char *name, const auto &value) { d[name] = value; });
  return d;
}

py::tuple wrench_vectors(const Wrench &w)
{
  const auto vector = [](const dvec3 &v) { return std::array<double, 3>{v.x, v.y, v.z}; };
  return py::make_tuple(vector(w.force), vector(w.torque), vector(w.impulse), vector(w.angular_impulse));
}

py::dict to_dict(Checkpoint c)
{
  py::dict d, numbers, vectors;
  for (const auto &[name, value] : c.numbers) numbers[py::str(name)] = value;
  for (auto &[name, values] : c.vectors) vectors[py::str(name)] = to_array<double>(std::move(values));
  d["scene"] = c.scene;
  d["step"] = c.step;
  d["time_step"] = c.time_step;
  d["released"] = c.released;
  d["numbers"] = numbers;
  d["vectors"] = vectors;
  py::dict driving;
  for (auto &[name, values] : c.driving) driving[py::str(name)] = to_array<double>(std::move(values));
  d["driving"] = driving;
  d["tangled"] = to_array<int>(std::move(c.tangled));
  d["let_go"] = to_array<int>(std::move(c.let_go));
  d["friction_pair"] = to_array<int>(std::move(c.friction_pair));
  d["friction_force"] = to_array<double>(std::move(c.friction_force));
  d["matching_step"] = c.matching.step;
  d["matching_terms"] = c.matching.terms;
  d["matching_first_iterations"] = c.matching.first_iterations;
  d["matching_last_iterations"] = c.matching.last_iterations;
  d["matching_order"] = to_array<int>(std::move(c.matching.order));
  py::list levels;
  for (Matching::Level &l : c.matching.levels)
    levels.append(py::make_tuple(to_array<int>(std::move(l.parent)), to_array<int>(std::move(l.start))));
  d["matching_levels"] = levels;
  return d;
}

/// The reverse conversion; shapes and types are checked in Python.
Checkpoint to_checkpoint(const py::dict &d)
{
  Checkpoint c;
  c.scene = d["scene"].cast<std::uint64_t>();
  c.step = d["step"].cast<int>();
  c.time_step = d["time_step"].cast<double>();
  c.released = d["released"].cast<double>();
  for (const auto &[name, value] : d["numbers"].cast<py::dict>())
    c.numbers[name.cast<std::string>()] = value.cast<double>();
  for (const auto &[name, values] : d["vectors"].cast<py::dict>())
    c.vectors[name.cast<std::string>()] = to_vector<dvec3>(values.cast<Doubles>());
  for (const auto &[name, values] : d["driving"].cast<py::dict>())
    c.driving[name.cast<std::string>()] = to_vector<double>(values.cast<Doubles>());
  const auto pairs = [&](const char *name) { return to_vector<std::pair<int, int>>(d[name].cast<Ints>()); };
  c.tangled = pairs("tangled");
  c.let_go = pairs("let_go");
  c.friction_pair = to_vector<std::array<int, 3>>(d["friction_pair"].cast<Ints>());
  c.friction_force = to_vector<dvec3>(d["friction_force"].cast<Doubles>());
  c.matching.step = d["matching_step"].cast<int>();
  c.matching.terms = d["matching_terms"].cast<int>();
  c.matching.first_iterations = d["matching_first_iterations"].cast<int>();
  c.matching.last_iterations = d["matching_last_iterations"].cast<int>();
  c.matching.order = to_vector<int>(d["matching_order"].cast<Ints>());
  for (const py::handle &level : d["matching_levels"])
    c.matching.levels.push_back(
        {to_vector<int>(level[py::int_(0)].cast<Ints>()), to_vector<int>(level[py::int_(1)].cast<Ints>())});
  return c;
}

/// Binds a member function that needs the lock only during the call.
template <class Result> auto ask(Result (Simulation::*method)() const)
{
  return
      [method](Guarded &g) { return g.with([method](Simulation &s) { return std::decay_t<Result>((s.*method)()); }); };
}

/// Binds a member function that lends memory of the device.
auto lend(DeviceArray (Simulation::*method)())
{
  return [method](Guarded &g) {
    return LentArray{g.with([method](Simulation &s) { return (s.*method)(); }), g.shared_turns()};
  };
}

}  // namespace

py::tuple contact_arrays(ContactArrays c)
{
  return py::make_tuple(to_array<int>(std::move(c.vertices)), to_array<double>(std::move(c.weights)),
                        to_array<double>(std::move(c.normal)), to_array<double>(std::move(c.distance)),
                        to_array<int>(std::move(c.kind)), to_array<double>(std::move(c.normal_force)),
                        to_array<double>(std::move(c.tangential_force)));
}

void bind_simulation(py::module_ &m)
{
  bind_options(m);
  py::class_<Guarded> bound(m, "Simulation");
  bind_turns(bound);
  bound
      .def(py::init([](const Scene &scene, const OptionOverrides &options) {
        const Scene own(scene);
        const OptionOverrides chosen(options);
        py::gil_scoped_release release;
        return std::make_unique<Guarded>(own, chosen);
      }))
      .def("step", &step)
      .def("step_count", ask(&Simulation::step_count))
      .def("time", ask(&Simulation::time))
      .def("time_step", ask(&Simulation::time_step))
      .def("error", ask(&Simulation::error))
      .def("frame_ended", ask(&Simulation::frame_ended))
      .def("vertex_count", ask(&Simulation::vertex_count))
      .def("cloth_vertex_count", ask(&Simulation::cloth_vertex_count))
      .def("cloth_triangle_count", ask(&Simulation::cloth_triangle_count))
      .def("cloth_ranges", ask(&Simulation::cloth_ranges))
      .def("obstacle_ranges", ask(&Simulation::obstacle_ranges))
      .def("faces", [](Guarded &g) { return to_array<int>(g.with([](Simulation &s) { return s.faces(); })); })
      .def("positions",
           [](Guarded &g) { return to_array<double>(g.with([](Simulation &s) { return s.positions(); })); })
      .def("velocities",
           [](Guarded &g) { return to_array<double>(g.with([](Simulation &s) { return s.velocities(); })); })
      .def("masses", [](Guarded &g) { return to_array<double>(g.with([](Simulation &s) { return s.masses(); })); })
      .def("set_state",
           [](Guarded &g, const Doubles &positions, const Doubles &velocities) {
             const auto x = to_vector<dvec3>(positions), v = to_vector<dvec3>(velocities);
             g.with([&](Simulation &s) { s.set_state(x, v); });
           })
      .def("set_state",
           [](Guarded &g, const Received &positions, const Received &velocities) {
             g.with([&](Simulation &s) { s.set_state(positions.vectors(), velocities.vectors()); });
           })
      .def("set_force",
           [](Guarded &g, const Ints &vertices, const Received &forces) {
             const auto v = to_vector<int>(vertices);
             g.with([&](Simulation &s) { s.set_force(v, forces.vectors()); });
           })
      .def("download",
           [](Guarded &g, const std::string &what, const Received &vectors, int count) {
             return to_array<double>(
                 g.with([&](Simulation &s) { return s.download(what.c_str(), vectors.vectors(), count); }));
           })
      .def("device_positions", lend(&Simulation::device_positions))
      .def("device_velocities", lend(&Simulation::device_velocities))
      .def("device_forces", lend(&Simulation::device_forces))
      .def("memory",
           [](Guarded &g) {
             const DeviceMemory memory = g.with([](Simulation &s) { return s.backend().memory(); });
             return py::make_tuple(memory.kind == DeviceMemory::Kind::cuda, memory.device, memory.queue);
           })
      .def("pin",
           [](Guarded &g, const Ints &vertices, const Doubles &targets, double duration) {
             const auto v = to_vector<int>(vertices);
             const auto x = to_vector<dvec3>(targets);
             g.with([&](Simulation &s) { s.pin(v, x, duration); });
           })
      .def("set_targets",
           [](Guarded &g, const Ints &vertices, const Doubles &positions, double duration) {
             const auto v = to_vector<int>(vertices);
             const auto x = to_vector<dvec3>(positions);
             g.with([&](Simulation &s) { s.set_targets(v, x, duration); });
           })
      .def("release",
           [](Guarded &g, const Ints &vertices) {
             const auto v = to_vector<int>(vertices);
             g.with([&](Simulation &s) { s.release(v); });
           })
      .def("attach",
           [](Guarded &g, const Ints &vertices, int obstacle) {
             const auto v = to_vector<int>(vertices);
             g.with([&](Simulation &s) { s.attach(v, obstacle); });
           })
      .def("set_obstacle_pose",
           [](Guarded &g, int obstacle, const std::array<double, 3> &translation, const std::array<double, 4> &rotation,
              double duration) {
             const dvec3 t{translation[0], translation[1], translation[2]};
             g.with([&](Simulation &s) { s.set_obstacle_pose(obstacle, t, rotation, duration); });
           })
      .def("set_obstacle_vertices",
           [](Guarded &g, int obstacle, const Doubles &positions, double duration) {
             const auto x = to_vector<dvec3>(positions);
             g.with([&](Simulation &s) { s.set_obstacle_vertices(obstacle, x, duration); });
           })
      .def("rigid_pose",
           [](Guarded &g, int obstacle) {
             const RigidPose p = g.with([&](Simulation &s) { return s.rigid_pose(obstacle); });
             const auto row = [](const dvec3 &v) { return std::array<double, 3>{v.x, v.y, v.z}; };
             return std::make_tuple(row(p.center), p.rotation, row(p.velocity), row(p.angular_velocity),
                                    row(p.angular_momentum), row(p.contact_force));
           })
      .def("set_force",
           [](Guarded &g, const Ints &vertices, const Doubles &forces) {
             const auto v = to_vector<int>(vertices);
             const auto f = to_vector<dvec3>(forces);
             g.with([&](Simulation &s) { s.set_force(v, f); });
           })
      .def("gravity",
           [](Guarded &g) {
             const dvec3 v = g.with([](Simulation &s) { return s.gravity(); });
             return std::array<double, 3>{v.x, v.y, v.z};
           })
      .def("set_gravity",
           [](Guarded &g, const std::array<double, 3> &v) {
             g.with([&](Simulation &s) { s.set_gravity({v[0], v[1], v[2]}); });
           })
      .def("wind",
           [](Guarded &g) {
             const dvec3 v = g.with([](Simulation &s) { return s.wind(); });
             return std::array<double, 3>{v.x, v.y, v.z};
           })
      .def("set_wind",
           [](Guarded &g, const std::array<double, 3> &v) {
             g.with([&](Simulation &s) { s.set_wind({v[0], v[1], v[2]}); });
           })
      .def("pressures", [](Guarded &g) { return g.with([](Simulation &s) { return s.pressures(); }); })
      .def("set_pressure", [](Guarded &g, int cloth,
                              double pressure) { g.with([&](Simulation &s) { s.set_pressure(cloth, pressure); }); })
      .def("set_gas", [](Guarded &g, int cloth, double amount,
                         double ambient) { g.with([&](Simulation &s) { s.set_gas(cloth, amount, ambient); }); })
      .def("gas",
           [](Guarded &g) {
             py::list rows;
             for (const GasState &gas : g.with([](Simulation &s) { return s.gas(); }))
               rows.append(py::make_tuple(gas.cloth, gas.volume, gas.pressure, gas.amount, gas.ambient));
             return rows;
           })
      .def("plastic_curvature",
           [](Guarded &g) { return to_array<double>(g.with([](Simulation &s) { return s.plastic_curvature(); })); })
      .def("checkpoint", [](Guarded &g) { return to_dict(g.with([](Simulation &s) { return s.checkpoint(); })); })
      .def("restore",
           [](Guarded &g, const py::dict &fields) {
             const Checkpoint c = to_checkpoint(fields);
             g.with([&](Simulation &s) { s.restore(c); });
           })
      .def("contacts", [](Guarded &g) { return contact_arrays(g.with([](Simulation &s) { return s.contacts(); })); })
      .def("forces", [](Guarded &g) { return to_array<double>(g.with([](Simulation &s) { return s.forces(); })); })
      .def("impulses", [](Guarded &g) { return to_array<double>(g.with([](Simulation &s) { return s.impulses(); })); })
      .def("begin_interval", [](Guarded &g) { g.with([](Simulation &s) { s.begin_interval(); }); })
      .def("force_on_obstacle",
           [](Guarded &g, int obstacle) {
             return wrench_vectors(g.with([&](Simulation &s) { return s.force_on_obstacle(obstacle); }));
           })
      .def("force_on_vertices",
           [](Guarded &g, const Ints &vertices) {
             const auto v = to_vector<int>(vertices);
             return wrench_vectors(g.with([&](Simulation &s) { return s.force_on_vertices(v); }));
           })
      .def("report", [](Guarded &g) { return to_dict(g.with([](Simulation &s) { return s.report(); })); })
      .def("timings",
           [](Guarded &g) {
             py::list rows;
             for (const StageTime &t : g.with([](Simulation &s) { return s.timings(); }))
               rows.append(py::make_tuple(t.name, t.depth, t.milliseconds));
             return rows;
           })
      .def("streams",
           [](Guarded &g) {
             py::list rows;
             for (const StreamInfo &t : g.with([](Simulation &s) { return s.streams(); }))
               rows.append(py::make_tuple(t.name, t.element, t.size, t.bytes));
             return rows;
           })
      .def("explain", ask(&Simulation::explain))
      .def("energy",
           [](Guarded &g) {
             const Energy e = g.with([](Simulation &s) { return s.energy(); });
             py::dict d;
             d["kinetic"] = e.kinetic;
             d["stretching"] = e.stretching;
             d["bending"] = e.bending;
             d["gravity"] = e.gravity;
             d["gas"] = e.gas;
             return d;
           })
      .def("untangled", [](Guarded &g) { return to_dict(g.with([](Simulation &s) { return s.untangled(); })); })
      .def("min_gap", ask(&Simulation::min_gap))
      .def("max_strain", ask(&Simulation::max_strain))
      .def("count_intersections", ask(&Simulation::count_intersections))
      .def("state_hash", ask(&Simulation::state_hash))
      .def("peak_memory_bytes", ask(&Simulation::peak_memory_bytes))
      .def("options", [](Guarded &g) { return to_dict(g.with([](Simulation &s) { return s.options(); })); })
      .def("chosen_options",
           [](Guarded &g) { return chosen_rows(g.with([](Simulation &s) { return s.chosen_options(); })); })
      .def("backend", [](Guarded &g) {
        return g.with(
            [](Simulation &s) { return std::make_pair(std::string(s.backend().name()), s.backend().device()); });
      });
}

}  // namespace cama::python
