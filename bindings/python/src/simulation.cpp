// SPDX-License-Identifier: Apache-2.0
#include "cama/simulation.hpp"

#include <mutex>

#include "bindings.hpp"
#include "cama/error.hpp"

namespace cama::python {
namespace {

/// A simulation that several Python threads may ask: one at a time, and never while its lock is waited for with the GIL
/// held.
class Guarded {
public:
  Guarded(const Scene &scene, const Options &options) : simulation_(scene, options) {}

  template <class Ask> auto with(Ask &&ask)
  {
    py::gil_scoped_release release;
    std::lock_guard<std::mutex> lock(mutex_);
    return ask(simulation_);
  }

private:
  Simulation simulation_;
  std::mutex mutex_;
};

/// n steps; between steps the GIL is taken and pending signals (Ctrl-C) raise.
void step(Guarded &g, int n)
{
  for (int i = 0; i < n; ++i) {
    g.with([](Simulation &s) { s.step(); });
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
  }
}

template <class Enum> struct Choice {
  const char *name;
  Enum value;
};

constexpr Choice<Assembly> assemblies[] = {
    {"gather", Assembly::gather}, {"algorithm1", Assembly::algorithm1}, {"sorted", Assembly::sorted}};
constexpr Choice<Preconditioner> preconditioners[] = {{"none", Preconditioner::none},
                                                      {"jacobi", Preconditioner::jacobi},
                                                      {"block_jacobi", Preconditioner::block_jacobi},
                                                      {"schwarz", Preconditioner::schwarz}};
constexpr Choice<ContactForm> contact_forms[] = {{"rank_one", ContactForm::rank_one}, {"star", ContactForm::star}};
constexpr Choice<Pinch> pinches[] = {{"stop", Pinch::stop}, {"release", Pinch::release}};
constexpr Choice<SearchKind> searches[] = {{"tree", SearchKind::tree}, {"fronts", SearchKind::fronts}};
constexpr Choice<LinearSolver> solvers[] = {{"conjugate_gradient", LinearSolver::conjugate_gradient},
                                            {"direct", LinearSolver::direct}};

constexpr Choice<Integrator> integrators[] = {{"backward_euler", Integrator::backward_euler},
                                              {"bdf2", Integrator::bdf2}};
constexpr Choice<ContactRefresh> refreshes[] = {{"step", ContactRefresh::step},
                                                {"iteration", ContactRefresh::iteration}};

constexpr Choice<StartPolicy> policies[] = {
    {"reject", StartPolicy::reject}, {"exempt", StartPolicy::exempt}, {"untangle", StartPolicy::untangle}};

/// An enumeration that Python sees as one of a few words.
template <class Enum, std::size_t count>
void choice_property(py::class_<Options> &bound, const char *name, Enum Options::*member,
                     const Choice<Enum> (&choices)[count])
{
  bound.def_property(
      name,
      [member, &choices](const Options &o) -> std::string {
        for (const auto &c : choices)
          if (c.value == o.*member) return c.name;
        return "?";
      },
      [name, member, &choices](Options &o, const std::string &word) {
        std::string names;
        for (const auto &c : choices) {
          if (word == c.name) {
            o.*member = c.value;
            return;
          }
          names += (names.empty() ? "" : ", ") + std::string(c.name);
        }
        throw SceneError(std::string(name) + ": \"" + word + "\" is not one of " + names);
      });
}

void bind_options(py::module_ &m)
{
  py::class_<Options> options(m, "Options");
  choice_property(options, "assembly", &Options::assembly, assemblies);
  choice_property(options, "preconditioner", &Options::preconditioner, preconditioners);
  choice_property(options, "solver", &Options::solver, solvers);
  choice_property(options, "search", &Options::search, searches);
  choice_property(options, "contact_form", &Options::contact_form, contact_forms);
  choice_property(options, "pinch", &Options::pinch, pinches);
  choice_property(options, "intersections", &Options::intersections, policies);
  choice_property(options, "integrator", &Options::integrator, integrators);
  choice_property(options, "contact_refresh", &Options::contact_refresh, refreshes);
  options.def_static("preset", &Options::preset)
      .def_readwrite("backend", &Options::backend)
      .def_readwrite("device", &Options::device)
      .def_readwrite("threads", &Options::threads)
      .def_readwrite("precision", &Options::precision)
      .def_readonly("accuracy", &Options::accuracy)
      .def_readwrite("time_step", &Options::time_step)
      .def_readwrite("newton_iterations", &Options::newton_iterations)
      .def_readwrite("newton_tolerance", &Options::newton_tolerance)
      .def_readwrite("atomic_filling", &Options::atomic_filling)
      .def_readwrite("localized_search", &Options::localized_search)
      .def_readwrite("linear_impacts", &Options::linear_impacts)
      .def_readwrite("cubic_impacts", &Options::cubic_impacts)
      .def_readwrite("anticipate_contacts", &Options::anticipate_contacts)
      .def_readwrite("arcsim_conventions", &Options::arcsim_conventions)
      .def_readwrite("tolerance", &Options::tolerance)
      .def_readwrite("max_iterations", &Options::max_iterations)
      .def_readwrite("max_impact_passes", &Options::max_impact_passes)
      .def_readwrite("commit", &Options::commit)
      .def_readwrite("audit", &Options::audit);
}

py::dict to_dict(const StepReport &r)
{
  py::dict d;
  d["step"] = r.step;
  d["time"] = r.time;
  d["contacts"] = r.contacts;
  d["candidates"] = r.candidates;
  d["searches"] = r.searches;
  d["impacts"] = r.impacts;
  d["impact_passes"] = r.impact_passes;
  d["truncated"] = r.truncated;
  d["lost_motion"] = r.lost_motion;
  d["released"] = r.released;
  d["exempt"] = r.exempt;
  d["substeps"] = r.substeps;
  d["retries"] = r.retries;
  d["newton_iterations"] = r.newton_iterations;
  d["newton_residual"] = r.newton_residual;
  d["iterations"] = r.iterations;
  d["residual"] = r.residual;
  d["milliseconds"] = r.milliseconds;
  d["launches"] = r.launches;
  d["waits"] = r.waits;
  d["intersections"] = r.intersections;
  return d;
}

py::tuple contact_arrays(ContactArrays c)
{
  return py::make_tuple(to_array<int>(std::move(c.vertices)), to_array<double>(std::move(c.weights)),
                        to_array<double>(std::move(c.normal)), to_array<double>(std::move(c.distance)),
                        to_array<int>(std::move(c.kind)));
}

py::dict to_dict(Checkpoint c)
{
  py::dict d;
  d["scene"] = c.scene;
  d["step"] = c.step;
  d["time"] = c.time;
  d["time_step"] = c.time_step;
  d["start_step"] = c.start_step;
  d["start_time"] = c.start_time;
  d["released"] = c.released;
  d["positions"] = to_array<double>(std::move(c.positions));
  d["velocities"] = to_array<double>(std::move(c.velocities));
  d["positions_before"] = to_array<double>(std::move(c.positions_before));
  d["velocities_before"] = to_array<double>(std::move(c.velocities_before));
  d["tangled"] = to_array<int>(std::move(c.tangled));
  d["let_go"] = to_array<int>(std::move(c.let_go));
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

/// Of what the other direction made: shapes and types are checked in Python.
Checkpoint to_checkpoint(const py::dict &d)
{
  Checkpoint c;
  c.scene = d["scene"].cast<std::uint64_t>();
  c.step = d["step"].cast<int>();
  c.time = d["time"].cast<double>();
  c.time_step = d["time_step"].cast<double>();
  c.start_step = d["start_step"].cast<int>();
  c.start_time = d["start_time"].cast<double>();
  c.released = d["released"].cast<double>();
  const auto vectors = [&](const char *name) { return to_vector<dvec3>(d[name].cast<Doubles>()); };
  const auto pairs = [&](const char *name) { return to_vector<std::pair<int, int>>(d[name].cast<Ints>()); };
  c.positions = vectors("positions");
  c.velocities = vectors("velocities");
  c.positions_before = vectors("positions_before");
  c.velocities_before = vectors("velocities_before");
  c.tangled = pairs("tangled");
  c.let_go = pairs("let_go");
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

/// Binds a member function that needs no lock beyond the call.
template <class Result> auto ask(Result (Simulation::*method)() const)
{
  return
      [method](Guarded &g) { return g.with([method](Simulation &s) { return std::decay_t<Result>((s.*method)()); }); };
}

}  // namespace

void bind_simulation(py::module_ &m)
{
  bind_options(m);
  m.def("accuracy_levels", &accuracy_levels);
  m.def("chosen_time_step", &chosen_time_step);
  m.def("settings", [](const Options &options, const Scene &scene) {
    py::list rows;
    for (const Setting &s : settings(options, scene)) rows.append(py::make_tuple(s.name, s.value, s.origin, s.trades));
    return rows;
  });
  py::class_<Guarded>(m, "Simulation")
      .def(py::init([](const Scene &scene, const Options &options) {
        const Scene own(scene);
        const Options chosen(options);
        py::gil_scoped_release release;
        return std::make_unique<Guarded>(own, chosen);
      }))
      .def("step", &step)
      .def("step_count", ask(&Simulation::step_count))
      .def("time", ask(&Simulation::time))
      .def("time_step", ask(&Simulation::time_step))
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
      .def("checkpoint", [](Guarded &g) { return to_dict(g.with([](Simulation &s) { return s.checkpoint(); })); })
      .def("restore",
           [](Guarded &g, const py::dict &fields) {
             const Checkpoint c = to_checkpoint(fields);
             g.with([&](Simulation &s) { s.restore(c); });
           })
      .def("contacts", [](Guarded &g) { return contact_arrays(g.with([](Simulation &s) { return s.contacts(); })); })
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
             return d;
           })
      .def("untangled", [](Guarded &g) { return to_dict(g.with([](Simulation &s) { return s.untangled(); })); })
      .def("min_gap", ask(&Simulation::min_gap))
      .def("max_strain", ask(&Simulation::max_strain))
      .def("count_intersections", ask(&Simulation::count_intersections))
      .def("state_hash", ask(&Simulation::state_hash))
      .def("peak_memory_bytes", ask(&Simulation::peak_memory_bytes))
      .def("options", ask(&Simulation::options))
      .def("settings",
           [](Guarded &g) {
             py::list rows;
             for (const Setting &s : g.with([](Simulation &s) { return s.settings(); }))
               rows.append(py::make_tuple(s.name, s.value, s.origin, s.trades));
             return rows;
           })
      .def("backend", [](Guarded &g) {
        return g.with(
            [](Simulation &s) { return std::make_pair(std::string(s.backend().name()), s.backend().device()); });
      });
}

}  // namespace cama::python
