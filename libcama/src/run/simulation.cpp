// SPDX-License-Identifier: Apache-2.0
#include "cama/simulation.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <new>

#include "device/fnv.hpp"
#include "device/host_threads.hpp"
#include "device/launch.hpp"
#include "exact/exact_audit.hpp"
#include "model/setup.hpp"
#include "run/checkpoint.hpp"
#include "run/pipeline_factory.hpp"
#include "run/step.hpp"
#include "start/start_check.hpp"

namespace cama {

namespace {

void check(const Options &o)
{
  if (o.precision != "double" && o.precision != "mixed" && o.precision != "single")
    throw SceneError("precision: '" + o.precision + "' is not known; use double, mixed or single");
  if (!(o.tolerance > 0) || !(o.tolerance < 1))
    throw SceneError("tolerance: " + std::to_string(o.tolerance) + " is outside (0, 1)");
  if (o.max_iterations < 1) throw SceneError("max_iterations: " + std::to_string(o.max_iterations) + " is below 1");
  if (o.newton_iterations < 1)
    throw SceneError("newton_iterations: " + std::to_string(o.newton_iterations) + " is below 1");
  if (!(o.newton_tolerance > 0) || !(o.newton_tolerance < 1))
    throw SceneError("newton_tolerance: " + std::to_string(o.newton_tolerance) + " is outside (0, 1)");
  if (!(o.time_step >= 0) || !std::isfinite(o.time_step))
    throw SceneError("time_step: " + std::to_string(o.time_step) + " is negative or not finite");
  if (o.max_impact_passes < 0)
    throw SceneError("max_impact_passes: " + std::to_string(o.max_impact_passes) + " is below 0");
  if (o.contact_form == ContactForm::star && o.assembly == Assembly::gather)
    throw SceneError("contact_form: star needs its entries in the matrix; use assembly algorithm1 or sorted");
  if (o.atomic_filling && o.assembly != Assembly::algorithm1)
    throw SceneError(
        "atomic_filling: is a way to fill the matrix of assembly algorithm1; use it with that, or leave it out");
}

/// The name of the object that a vertex belongs to.
std::string owner(const Scene &scene, const Topology &t, int vertex)
{
  const std::size_t object = static_cast<std::size_t>(t.object[vertex]), cloths = scene.cloths.size();
  return object < cloths ? "cloth '" + scene.cloths[object].name + "'"
                         : "obstacle '" + scene.obstacles[object - cloths].name + "'";
}

/// Cloth in exact spheres and capsules or below planes, which nothing untangles.
void check_exact_start(const Scene &scene, const Topology &t)
{
  const std::vector<Intrusion> inside = intrusions(t.position, t);
  if (inside.empty()) return;
  const Intrusion &first = inside.front();
  const bool plane = t.shape[first.vertex] == ObstacleShape::plane;
  const int vertex = plane ? first.feature : t.face[first.feature][0];
  throw CollisionError("the scene starts with " + std::to_string(inside.size()) +
                       (inside.size() == 1 ? " intersection" : " intersections") +
                       " with exact obstacles; the first: " + (plane ? "vertex " : "triangle ") +
                       std::to_string(first.feature) + " of " + owner(scene, t, vertex) +
                       (plane ? " is below " : " reaches into ") + owner(scene, t, first.vertex) +
                       " (numbers over all objects); move the objects apart, or set the option intersections to "
                       "\"exempt\" (starts as it is)");
}

/// A start in which cloth intersects itself, another cloth or an obstacle: no step could promise anything from there.
void treat_start(const Scene &scene, const Options &options, Topology &t, UntangleReport &untangled)
{
  if (options.intersections == StartPolicy::exempt || !scene.has_contact()) return;
  if (options.intersections == StartPolicy::untangle) {
    if (forbidden_intersections(t.position, t, scene.contact.self).empty()) return check_exact_start(scene, t);
    untangled = untangle(scene, t);
    if (untangled.clean) return check_exact_start(scene, t);
  }
  const std::vector<ObjectIntersections> found = by_objects(scene, t, t.position);
  if (found.empty() && options.intersections == StartPolicy::reject) return check_exact_start(scene, t);
  const std::string history = options.intersections == StartPolicy::reject
                                  ? ""
                                  : "untangling took " + std::to_string(untangled.rounds) + " rounds from " +
                                        std::to_string(untangled.before) + " intersections to " +
                                        std::to_string(untangled.after) + "; ";
  throw CollisionError("the scene starts with intersections: " + history +
                       (found.empty() ? "parts that touch" : describe(found)) +
                       "; move the objects apart, see them with `cama check SCENE --mesh intersections.ply`, or set "
                       "the option intersections to " +
                       (options.intersections == StartPolicy::reject ? "\"untangle\" (moves the cloth) or " : "") +
                       "\"exempt\" (starts as it is)");
}

/// Positions to go on from that intersect, where no step could promise anything from them.
void check_state(const std::vector<dvec3> &position, const Topology &t, const std::vector<std::string> &object,
                 bool self)
{
  const auto name = [&](int vertex) {
    return object[static_cast<std::size_t>(t.object[static_cast<std::size_t>(vertex)])];
  };
  const std::vector<Intersection> found = forbidden_intersections(position, t, self);
  const std::vector<Intrusion> inside = intrusions(position, t);
  if (found.empty() && inside.empty()) return;
  const std::size_t count = found.size() + inside.size();
  std::string first;
  if (!found.empty()) {
    const auto [edge, face] = found.front();
    first = "the edge of vertices " + std::to_string(edge[0]) + " and " + std::to_string(edge[1]) + " of " +
            name(edge[0]) + " crosses triangle " + std::to_string(face) + " of " +
            name(t.face[static_cast<std::size_t>(face)][0]);
  } else {
    const Intrusion &i = inside.front();
    const bool plane = t.shape[static_cast<std::size_t>(i.vertex)] == ObstacleShape::plane;
    first = (plane ? "vertex " : "triangle ") + std::to_string(i.feature) + " of " +
            name(plane ? i.feature : t.face[static_cast<std::size_t>(i.feature)][0]) +
            (plane ? " is below " : " reaches into ") + name(i.vertex);
  }
  throw CollisionError(
      "positions: have " + std::to_string(count) + (count == 1 ? " intersection" : " intersections") +
      "; the first: " + first +
      " (numbers over all objects); nothing was set. Give positions without, or make the simulation with the option "
      "intersections set to \"exempt\"");
}

const Scene &checked(const Scene &scene, const Options &options)
{
  scene.validate();
  check(options);
  if (options.pinch == Pinch::release)   // when cloth has come free is told by meshes
    for (const Obstacle &o : scene.obstacles)
      if (o.shape != ObstacleShape::mesh && o.shape != ObstacleShape::box)
        throw SceneError("pinch: release is for obstacles that are meshes or boxes, '" + o.name +
                         "' is not; mesh it, or use stop");
  return scene;
}

}  // namespace

struct Simulation::Implementation {
  Implementation(const Scene &scene, const Options &options)
      : threads(options.threads ? options.threads : useful_threads(scene.cloth_triangle_count())),
        backend(make_backend(options.backend, options.device, threads)), state(*backend),
        topology(build_topology(scene))
  {
    const HostThreads host(threads);
    for (int vertex = 0, count = static_cast<int>(topology.object.size()); vertex < count; ++vertex)
      if (static_cast<std::size_t>(topology.object[static_cast<std::size_t>(vertex)]) == object.size())
        object.push_back(owner(scene, topology, vertex));
    guarded = options.intersections != StartPolicy::exempt && scene.has_contact();
    state.options = options;
    state.options.time_step = chosen_time_step(options, scene);
    chosen = cama::settings(options, scene);
    treat_start(scene, options, topology, untangled);
    single = options.precision == "single";
    if (single) {
      set_up<float>(state, scene, topology);
      pipeline = make_pipeline<float>(scene, state);
    } else {
      set_up<double>(state, scene, topology);
      pipeline = make_pipeline<double>(scene, state);
    }
    if (options.intersections == StartPolicy::exempt && scene.has_contact()) {
      state.exemptions.add_tangle(forbidden_intersections(topology.position, topology, scene.contact.self), topology);
      state.exemptions.upload();
    }
  }

  const int threads;   // of the processor: the CPU backend's and of audits
  std::unique_ptr<Backend> backend;
  State state;
  Topology topology;
  UntangleReport untangled;
  std::vector<Setting> chosen;
  StepPipeline pipeline;
  std::vector<std::string> object;   // names for messages, cloths first
  bool guarded = false;              // the state must not intersect
  bool single = false;
};

Simulation::Simulation(const Scene &scene, const Options &options)
try : implementation_(std::make_unique<Implementation>(checked(scene, options), options)) {
} catch (const std::bad_alloc &) {
  throw MemoryError("out of memory on the host while the simulation is set up; lower the resolution");
}
Simulation::~Simulation() = default;
Simulation::Simulation(Simulation &&) noexcept = default;
Simulation &Simulation::operator=(Simulation &&) noexcept = default;

void Simulation::step()
{
  State &s = implementation_->state;
  Backend &b = *implementation_->backend;
  const HostThreads host(implementation_->threads);
  Pipeline &pipeline = *implementation_->pipeline.step;
  const std::string name = "step " + std::to_string(s.report.step + 1);
  const long launches = b.launches(), waits = b.waits();
  const auto start = std::chrono::steady_clock::now();
  const auto audit = [&] { return s.options.audit ? count_intersections() : -1; };
  try {
    take_step(s, pipeline, [&] {
      s.report.launches = b.launches() - launches;
      s.report.waits = b.waits() - waits;
      s.report.milliseconds =
          s.report.retries == 0
              ? pipeline.milliseconds()
              : std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
      s.report.intersections = audit();
    });
  } catch (const std::bad_alloc &) {
    throw MemoryError(name + ": out of memory on the host; lower the resolution");
  }
}

int Simulation::step_count() const { return implementation_->state.report.step; }
double Simulation::time_step() const { return implementation_->state.time_step; }
double Simulation::time() const { return implementation_->state.time; }
int Simulation::vertex_count() const { return implementation_->state.vertices; }
int Simulation::cloth_vertex_count() const { return implementation_->state.cloth_vertices; }
const std::vector<Triangle> &Simulation::faces() const { return implementation_->topology.face; }
int Simulation::cloth_triangle_count() const { return implementation_->state.triangles; }
std::vector<std::pair<int, int>> Simulation::cloth_ranges() const { return implementation_->topology.cloth_range; }
std::vector<std::pair<int, int>> Simulation::obstacle_ranges() const
{
  return implementation_->topology.obstacle_range;
}
std::vector<dvec3> Simulation::positions() const { return implementation_->state.position.download(); }
std::vector<dvec3> Simulation::velocities() const { return implementation_->state.velocity.download(); }
std::vector<double> Simulation::masses() const { return implementation_->topology.mass; }
const StepReport &Simulation::report() const { return implementation_->state.report; }
const UntangleReport &Simulation::untangled() const { return implementation_->untangled; }
std::vector<Setting> Simulation::settings() const { return implementation_->chosen; }
const Options &Simulation::options() const { return implementation_->state.options; }
const Backend &Simulation::backend() const { return *implementation_->backend; }
std::size_t Simulation::peak_memory_bytes() const { return implementation_->backend->peak_bytes(); }

void Simulation::set_state(const std::vector<dvec3> &positions, const std::vector<dvec3> &velocities)
{
  State &s = implementation_->state;
  const std::size_t n = static_cast<std::size_t>(s.cloth_vertices);
  const auto checked = [n](const char *name, const std::vector<dvec3> &values) {
    if (values.size() != n)
      throw SceneError(std::string(name) + ": has " + std::to_string(values.size()) + " rows, the cloth has " +
                       std::to_string(n) + " vertices");
    for (std::size_t i = 0; i < n; ++i)
      if (!std::isfinite(values[i].x + values[i].y + values[i].z))
        throw SceneError(std::string(name) + "[" + std::to_string(i) + "]: is not finite");
  };
  checked("positions", positions);
  checked("velocities", velocities);
  const auto replaced = [n](const Stream<dvec3> &stream, const std::vector<dvec3> &values) {
    std::vector<dvec3> all = stream.download();
    std::copy_n(values.begin(), n, all.begin());
    return all;
  };
  const auto moved = [&](const std::vector<dvec3> &now) {
    return std::memcmp(now.data(), positions.data(), n * sizeof(dvec3)) != 0;
  };
  if (implementation_->guarded && n > 0 && moved(s.position.download()))
    check_state(replaced(s.position, positions), implementation_->topology, implementation_->object,
                s.contact_settings.self);
  const std::vector<dvec3> x = replaced(s.position, positions), next = replaced(s.position_next, positions),
                           v = replaced(s.velocity, velocities);
  s.position.assign(x);
  s.position_next.assign(next);
  s.velocity.assign(v);
  s.history = false;
}

Checkpoint Simulation::checkpoint() const
{
  return take_checkpoint(implementation_->state, *implementation_->pipeline.step, implementation_->topology);
}

void Simulation::restore(const Checkpoint &checkpoint)
{
  Implementation &i = *implementation_;
  check_checkpoint(checkpoint, i.state, i.topology);
  if (i.guarded && i.state.options.commit)
    check_state(checkpoint.positions, i.topology, i.object, i.state.contact_settings.self);
  restore_checkpoint(checkpoint, i.state, *i.pipeline.step);
}

ContactArrays Simulation::contacts() const
{
  ContactArrays result;
  if (implementation_->state.contacts == 0) return result;
  for (const kernels::contact &c : implementation_->state.contact.download()) {
    result.vertices.push_back({c.node[0], c.node[1], c.node[2], c.node[3]});
    result.weights.push_back({c.weight[0], c.weight[1], c.weight[2], c.weight[3]});
    result.normal.push_back(c.normal);
    result.distance.push_back(c.distance);
    result.kind.push_back(c.kind);
  }
  return result;
}

namespace {

void list_stages(const Stage &stage, int depth, const std::function<void(const Stage &, int)> &visit)
{
  visit(stage, depth);
  for (const auto &child : stage.children()) list_stages(*child, depth + 1, visit);
}

template <class T> std::string element_name()
{
  if constexpr (std::is_same_v<T, int>)
    return "int";
  else if constexpr (std::is_same_v<T, double>)
    return "double";
  else if constexpr (std::is_same_v<T, float>)
    return "float";
  else
    return std::to_string(sizeof(T)) + " bytes";
}

}  // namespace

std::vector<StageTime> Simulation::timings() const
{
  std::vector<StageTime> times;
  list_stages(*implementation_->pipeline.step, 0,
              [&](const Stage &s, int depth) { times.push_back({std::string(s.name()), depth, s.milliseconds()}); });
  return times;
}

std::vector<std::pair<std::string, std::string>> Simulation::explain() const
{
  std::vector<std::pair<std::string, std::string>> stages;
  list_stages(*implementation_->pipeline.step, 0, [&](const Stage &s, int depth) {
    stages.emplace_back(std::string(static_cast<std::size_t>(2 * depth), ' ') + std::string(s.name()), s.reason());
  });
  return stages;
}

std::vector<StreamInfo> Simulation::streams() const
{
  std::vector<StreamInfo> streams;
  implementation_->state.visit([&](const char *name, auto &stream) {
    using T = typename std::decay_t<decltype(stream)>::value_type;
    if (stream.backend())
      streams.push_back({name, element_name<T>(), static_cast<std::size_t>(stream.size()), stream.bytes()});
  });
  return streams;
}

namespace {

double sum(const std::vector<double> &values)
{
  double total = 0;
  for (double v : values) total += v;
  return total;
}

struct TriangleMeasure {
  double energy, strain;
};

template <class Real> TriangleMeasure measure_triangles(State &s)
{
  Stream<double> energy(*s.backend, s.triangles), strain(*s.backend, s.triangles);
  System<Real> &y = s.system<Real>();
  CAMA_LAUNCH_REAL(Real, *s.backend, measure_triangles, s.triangles, y.triangle_rest, y.stretching_table,
                   y.stretching_start, s.position, energy, strain);
  const std::vector<double> strains = strain.download();
  return {sum(energy.download()), *std::max_element(strains.begin(), strains.end())};
}

template <class Real> double measure_hinges(State &s)
{
  if (s.hinges == 0) return 0;
  Stream<double> energy(*s.backend, s.hinges);
  System<Real> &y = s.system<Real>();
  CAMA_LAUNCH_REAL(Real, *s.backend, measure_hinges, s.hinges, y.hinge_rest, y.bending_table,
                   s.options.arcsim_conventions ? 1 : 0, s.position, energy);
  return sum(energy.download());
}

}  // namespace

Energy Simulation::energy() const
{
  State &s = implementation_->state;
  Stream<double> mass(*s.backend, implementation_->topology.mass), kinetic(*s.backend, s.cloth_vertices),
      potential(*s.backend, s.cloth_vertices);
  CAMA_LAUNCH(*s.backend, measure_vertices, s.cloth_vertices, mass, s.position, s.velocity, s.gravity, kinetic,
              potential);
  Energy e;
  e.kinetic = sum(kinetic.download());
  e.gravity = sum(potential.download());
  e.stretching = implementation_->single ? measure_triangles<float>(s).energy : measure_triangles<double>(s).energy;
  e.bending = implementation_->single ? measure_hinges<float>(s) : measure_hinges<double>(s);
  return e;
}

double Simulation::max_strain() const
{
  State &s = implementation_->state;
  return implementation_->single ? measure_triangles<float>(s).strain : measure_triangles<double>(s).strain;
}

double Simulation::min_gap() const
{
  State &s = implementation_->state;
  double smallest = std::numeric_limits<double>::infinity();
  const PairList *lists[2] = {&s.vertex_face, &s.edge_edge};
  for (int kind = 0; kind < 2; ++kind) {
    const int n = lists[kind]->pairs.size();
    if (n == 0) continue;
    Stream<double> distance(*s.backend, n);
    CAMA_LAUNCH(*s.backend, measure_pairs, n, kind, lists[kind]->pairs, s.face, s.edge, s.position, s.vertex_contact,
                distance);
    for (double d : distance.download()) smallest = std::min(smallest, d);
  }
  return smallest;
}

int Simulation::count_intersections() const
{
  const Implementation &i = *implementation_;
  const HostThreads host(i.threads);
  const std::vector<dvec3> position = i.state.position.download();
  return static_cast<int>(forbidden_intersections(position, i.topology, i.state.contact_settings.self).size() +
                          intrusions(position, i.topology).size());
}

std::uint64_t Simulation::state_hash() const
{
  const std::size_t bytes = sizeof(dvec3) * static_cast<std::size_t>(implementation_->state.cloth_vertices);
  const std::uint64_t hash = fnv1a(positions().data(), bytes);
  return fnv1a(velocities().data(), bytes, hash);
}

}  // namespace cama
