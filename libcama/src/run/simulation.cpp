// SPDX-License-Identifier: Apache-2.0
#include "cama/simulation.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <new>
#include <utility>

#include "device/fnv.hpp"
#include "device/host_threads.hpp"
#include "device/launch.hpp"
#include "exact/exact_audit.hpp"
#include "run/checkpoint.hpp"
#include "run/engine.hpp"
#include "run/measurements.hpp"
#include "run/step_control.hpp"
#include "start/start_check.hpp"
#include "start/start_policy.hpp"

namespace cama {

struct Simulation::Implementation : Engine {
  template <class... Arguments>
  explicit Implementation(Arguments &&...arguments) : Engine(std::forward<Arguments>(arguments)...)
  {
    state.wait_for_stages = std::getenv("CAMA_WAIT_FOR_STAGES") != nullptr;
  }

  /// options: a function that returns them.
  template <class Resolved>
  static std::unique_ptr<Implementation> make(const Scene &scene, const Resolved &options,
                                              std::unique_ptr<Backend> device = nullptr)
  {
    try {
      return std::make_unique<Implementation>(scene, options(), std::move(device));
    } catch (const std::bad_alloc &) {
      throw MemoryError("out of memory on the host while the simulation is set up; lower the resolution");
    }
  }
};

Simulation::Simulation(const Scene &scene, const OptionOverrides &options)
    : implementation_(Implementation::make(scene, [&] { return resolve(options, scene); }))
{}
Simulation::Simulation(const Scene &scene, const Options &options)
    : implementation_(Implementation::make(scene, [&] { return resolve(options, scene); }))
{}
Simulation::Simulation(const Scene &scene, const ResolvedOptions &options, std::unique_ptr<Backend> device)
    : implementation_(Implementation::make(scene, [&] { return options; }, std::move(device)))
{}
Simulation::~Simulation() = default;
Simulation::Simulation(Simulation &&) noexcept = default;
Simulation &Simulation::operator=(Simulation &&) noexcept = default;

void Simulation::step()
{
  Implementation &i = *implementation_;
  StepReport &report = i.state.report;
  const std::string name = "step " + std::to_string(report.step + 1);
  const long launches = i.backend->launches(), waits = i.backend->waits();
  const auto start = std::chrono::steady_clock::now();
  try {
    i.take([&] {
      const std::chrono::duration<double, std::milli> elapsed = std::chrono::steady_clock::now() - start;
      report.launches = i.backend->launches() - launches;
      report.waits = i.backend->waits() - waits;
      report.milliseconds = report.retries == 0 ? i.pipeline->milliseconds() : elapsed.count();
      report.intersections = i.state.options.audit ? count_intersections() : -1;
    });
  } catch (const std::bad_alloc &) {
    throw MemoryError(name + ": out of memory on the host; lower the resolution");
  }
}

void Simulation::wait_for_stages(bool wait) { implementation_->state.wait_for_stages = wait; }

int Simulation::step_count() const { return implementation_->state.report.step; }
double Simulation::time_step() const { return implementation_->state.time.step; }
double Simulation::error() const { return implementation_->state.time.error; }
bool Simulation::frame_ended() const { return ends_frame(implementation_->state.time); }
double Simulation::time() const { return implementation_->state.time.now; }
int Simulation::vertex_count() const { return implementation_->state.mesh.vertices; }
int Simulation::cloth_vertex_count() const { return implementation_->state.mesh.cloth_vertices; }
const std::vector<Triangle> &Simulation::faces() const { return implementation_->topology.face; }
int Simulation::cloth_triangle_count() const { return implementation_->state.mesh.triangles; }
std::vector<std::pair<int, int>> Simulation::cloth_ranges() const { return implementation_->topology.cloth_range; }
std::vector<std::pair<int, int>> Simulation::obstacle_ranges() const
{
  return implementation_->topology.obstacle_range;
}
std::vector<dvec3> Simulation::positions() const { return implementation_->state.mesh.position.download(); }
std::vector<dvec3> Simulation::velocities() const { return implementation_->state.mesh.velocity.download(); }
std::vector<double> Simulation::masses() const { return implementation_->topology.mass; }
const StepReport &Simulation::report() const { return implementation_->state.report; }
const UntangleReport &Simulation::untangled() const { return implementation_->untangled; }
std::vector<ChosenOption> Simulation::chosen_options() const { return implementation_->chosen; }
const Options &Simulation::options() const { return implementation_->state.options; }
const Backend &Simulation::backend() const { return *implementation_->backend; }
std::size_t Simulation::peak_memory_bytes() const { return implementation_->backend->peak_bytes(); }

namespace {

/// Throws CollisionError if the positions of the cloth, [cloth vertices], are others than now and intersect.
void check_state(Engine &engine, const std::vector<dvec3> &positions)
{
  if (!engine.guarded || positions.empty()) return;
  std::vector<dvec3> all = engine.state.mesh.position.download();
  if (std::memcmp(all.data(), positions.data(), positions.size() * sizeof(dvec3)) == 0) return;
  std::copy(positions.begin(), positions.end(), all.begin());
  check_positions(all, engine.topology, engine.state.contact.settings.self);
}

/// Sets the state of the cloth. [cloth vertices] m, m/s
void put_state(Engine &engine, const Stream<dvec3> &positions, const Stream<dvec3> &velocities)
{
  engine.before_writing();
  MeshState &mesh = engine.state.mesh;
  const auto put = [&](Stream<dvec3> &to, const Stream<dvec3> &from) {
    if (from.size())
      engine.backend->copy(to.buffer(), from.buffer(), sizeof(dvec3) * static_cast<std::size_t>(from.size()));
  };
  put(mesh.position, positions);
  put(mesh.position_next, positions);
  put(mesh.velocity, velocities);
  engine.state.time.history = false;
  engine.state.time.smoothed_steps = 0;
  engine.state.contact.kept.forget();
}

}  // namespace

void Simulation::set_state(const std::vector<dvec3> &positions, const std::vector<dvec3> &velocities)
{
  Implementation &i = *implementation_;
  const std::size_t n = static_cast<std::size_t>(i.state.mesh.cloth_vertices);
  const auto check = [n](const char *name, const std::vector<dvec3> &values) {
    if (values.size() != n)
      throw SceneError(std::string(name) + ": has " + std::to_string(values.size()) + " rows, the cloth has " +
                       std::to_string(n) + " vertices");
    for (std::size_t k = 0; k < n; ++k)
      if (!std::isfinite(values[k].x + values[k].y + values[k].z))
        throw SceneError(std::string(name) + "[" + std::to_string(k) + "]: is not finite");
  };
  check("positions", positions);
  check("velocities", velocities);
  check_state(i, positions);
  put_state(i, Stream<dvec3>(*i.backend, positions), Stream<dvec3>(*i.backend, velocities));
}

void Simulation::set_state(const DeviceVectors &positions, const DeviceVectors &velocities)
{
  Implementation &i = *implementation_;
  const int n = i.state.mesh.cloth_vertices;
  const Stream<dvec3> x = i.received("set_state: positions", positions, n),
                      v = i.received("set_state: velocities", velocities, n);
  if (i.guarded) check_state(i, x.download());
  put_state(i, x, v);
}

void Simulation::pin(const std::vector<int> &vertices, const std::vector<dvec3> &targets, double duration)
{
  Implementation &i = *implementation_;
  if (!targets.empty() || vertices.empty()) return i.pin(vertices, targets, duration);
  const std::vector<dvec3> x = positions();
  std::vector<dvec3> here;
  for (int v : vertices)
    here.push_back(v >= 0 && v < i.state.mesh.cloth_vertices ? x[static_cast<std::size_t>(v)] : dvec3{0, 0, 0});
  i.pin(vertices, here, duration);
}
void Simulation::set_targets(const std::vector<int> &vertices, const std::vector<dvec3> &positions, double duration)
{
  implementation_->set_targets(vertices, positions, duration);
}
void Simulation::release(const std::vector<int> &vertices) { implementation_->release(vertices); }
void Simulation::attach(const std::vector<int> &vertices, int obstacle) { implementation_->attach(vertices, obstacle); }
void Simulation::set_obstacle_pose(int obstacle, const dvec3 &translation, const std::array<double, 4> &rotation,
                                   double duration)
{
  implementation_->set_obstacle_pose(obstacle, translation, rotation, duration);
}
void Simulation::set_obstacle_vertices(int obstacle, const std::vector<dvec3> &positions, double duration)
{
  implementation_->set_obstacle_vertices(obstacle, positions, duration);
}
RigidPose Simulation::rigid_pose(int obstacle) const
{
  const RigidBody &body = implementation_->rigid_body("rigid_pose", obstacle);
  return {body.center,           body.rotation,
          body.velocity,         body.angular_velocity(body.rotation, body.angular_momentum),
          body.angular_momentum, body.contact_force};
}
void Simulation::set_force(const std::vector<int> &vertices, const std::vector<dvec3> &forces)
{
  implementation_->set_force(vertices, forces);
}
void Simulation::set_force(const std::vector<int> &vertices, const DeviceVectors &forces)
{
  implementation_->set_force(vertices, forces);
}
void Simulation::set_gravity(const dvec3 &gravity) { implementation_->set_gravity(gravity); }
void Simulation::set_wind(const dvec3 &velocity) { implementation_->set_wind(velocity); }
void Simulation::set_pressure(int cloth, double pressure) { implementation_->set_pressure(cloth, pressure); }
void Simulation::set_gas(int cloth, double amount, double ambient) { implementation_->set_gas(cloth, amount, ambient); }
std::vector<double> Simulation::pressures() const { return implementation_->pressures(); }
std::vector<GasState> Simulation::gas() const { return measure_gas(implementation_->state); }
std::vector<dvec3> Simulation::plastic_curvature() const
{
  const State &s = implementation_->state;
  return s.elements.plastic_curvature.size()
             ? s.elements.plastic_curvature.download()
             : std::vector<dvec3>(static_cast<std::size_t>(s.mesh.triangles), {0, 0, 0});
}
dvec3 Simulation::gravity() const { return implementation_->state.elements.gravity.at(0); }
dvec3 Simulation::wind() const
{
  const Stream<dvec3> &wind = implementation_->state.elements.wind;
  return wind.size() ? wind.at(0) : dvec3{0, 0, 0};
}

void Simulation::check_pin(const std::vector<int> &vertices, const std::vector<dvec3> &targets, double duration) const
{
  implementation_->check_pin(vertices, targets, duration);
}
void Simulation::check_targets(const std::vector<int> &vertices, const std::vector<dvec3> &positions,
                               double duration) const
{
  implementation_->check_targets(vertices, positions, duration);
}
void Simulation::check_release(const std::vector<int> &vertices) const
{
  implementation_->check_vertices("release", vertices);
}
void Simulation::check_pose(int obstacle, const dvec3 &translation, const std::array<double, 4> &rotation,
                            double duration) const
{
  implementation_->check_pose(obstacle, translation, rotation, duration);
}
void Simulation::check_force(const std::vector<int> &vertices, const std::vector<dvec3> &forces) const
{
  implementation_->check_force(vertices, forces);
}
void Simulation::check_gravity(const dvec3 &gravity) const { implementation_->check_gravity(gravity); }
void Simulation::check_wind(const dvec3 &velocity) const { implementation_->check_wind(velocity); }

Checkpoint Simulation::checkpoint() const
{
  Implementation &i = *implementation_;
  Checkpoint c = take_checkpoint(i.state, *i.pipeline, i.topology);
  i.save_driving(c);
  return c;
}

void Simulation::restore(const Checkpoint &checkpoint)
{
  Implementation &i = *implementation_;
  check_checkpoint(checkpoint, i.state, i.topology);
  i.check_driving(checkpoint);
  if (i.guarded && i.state.options.commit)
    check_positions(checkpoint.vectors.at("position"), i.topology, i.state.contact.settings.self);
  restore_own(checkpoint);
}

void Simulation::restore_own(const Checkpoint &checkpoint)
{
  Implementation &i = *implementation_;
  i.before_writing();
  i.restore_driving(checkpoint);
  restore_checkpoint(checkpoint, i.state, *i.pipeline);
}

ContactArrays Simulation::contacts() const
{
  ContactArrays result;
  if (implementation_->state.contact.contacts == 0) return result;
  for (const kernels::contact &c : implementation_->state.contact.contact.download()) {
    result.vertices.push_back({c.node[0], c.node[1], c.node[2], c.node[3]});
    result.weights.push_back({c.weight[0], c.weight[1], c.weight[2], c.weight[3]});
    result.normal.push_back(c.normal);
    result.distance.push_back(c.distance);
    result.kind.push_back(c.kind);
  }
  const ReactionState &reactions = implementation_->state.reactions;
  if (!reactions.measured) return result;
  const std::vector<dvec3> impulse = reactions.contact.download();
  for (std::size_t k = 0; k < impulse.size(); ++k) {
    const dvec3 force = kernels::dscale(1 / reactions.contact_time, impulse[k]);
    result.normal_force.push_back(kernels::ddot(force, result.normal[k]));
    result.tangential_force.push_back(kernels::daxpy(force, -result.normal_force[k], result.normal[k]));
  }
  return result;
}

namespace {

const ReactionState &measured(const State &state)
{
  if (!state.reactions.measured)
    throw SceneError("forces: they are not measured; set the option forces when the simulation is made");
  return state.reactions;
}

/// Sums over the vertices. step: s.
template <class Vertices> Wrench wrench(const ReactionState &reactions, const Vertices &vertices, double step)
{
  const auto sum = [&](const Stream<dvec3> &stream, double scale) {
    const std::vector<dvec3> values = stream.download();
    dvec3 total{0, 0, 0};
    for (int v : vertices) total = kernels::dadd(total, values[static_cast<std::size_t>(v)]);
    return kernels::dscale(scale, total);
  };
  return {sum(reactions.step.linear, 1 / step), sum(reactions.step.angular, 1 / step),
          sum(reactions.interval.linear, 1), sum(reactions.interval.angular, 1)};
}

}  // namespace

std::vector<dvec3> Simulation::forces() const
{
  const State &state = implementation_->state;
  std::vector<dvec3> result = measured(state).step.linear.download();
  for (dvec3 &f : result) f = kernels::dscale(1 / state.time.step, f);
  return result;
}
DeviceArray Simulation::device_positions()
{
  return implementation_->loans->lend(implementation_->state.mesh.position);
}
DeviceArray Simulation::device_velocities()
{
  return implementation_->loans->lend(implementation_->state.mesh.velocity);
}
namespace {

/// [all vertices] N
Stream<dvec3> force_stream(const State &state)
{
  Stream<dvec3> result(*state.backend);
  result.copy_from(measured(state).step.linear);
  CAMA_LAUNCH(*state.backend, scale_vectors, result.size(), 1 / state.time.step, result);
  return result;
}

}  // namespace

DeviceArray Simulation::device_forces() { return implementation_->loans->give(force_stream(implementation_->state)); }
DeviceArray Simulation::device_memory(int size)
{
  return implementation_->loans->give(Stream<dvec3>(*implementation_->backend, size));
}
void Simulation::copy_to(void *address, Field field)
{
  const Implementation &i = *implementation_;
  const auto copy = [&](const Stream<dvec3> &from) {
    i.backend->copy(address, from.buffer(), sizeof(dvec3) * static_cast<std::size_t>(from.size()));
    i.backend->synchronize();
  };
  switch (field) {
  case Field::positions: return copy(i.state.mesh.position);
  case Field::velocities: return copy(i.state.mesh.velocity);
  case Field::forces: return copy(force_stream(i.state));
  }
}
std::vector<dvec3> Simulation::download(const char *what, const DeviceVectors &vectors, int count)
{
  return implementation_->received(what, vectors, count).download();
}
std::vector<dvec3> Simulation::impulses() const { return measured(implementation_->state).interval.linear.download(); }
double Simulation::interval() const { return measured(implementation_->state).interval_time; }
void Simulation::begin_interval() { implementation_->state.reactions.begin_interval(); }

Wrench Simulation::force_on_obstacle(int obstacle) const
{
  const Implementation &i = *implementation_;
  const ReactionState &reactions = measured(i.state);
  if (obstacle < 0 || static_cast<std::size_t>(obstacle) >= i.topology.obstacle_range.size())
    throw SceneError("force_on: obstacle " + std::to_string(obstacle) + " is not there; the scene has " +
                     std::to_string(i.topology.obstacle_range.size()));
  const auto [first, last] = i.topology.obstacle_range[static_cast<std::size_t>(obstacle)];
  std::vector<int> vertices;
  for (int v = first; v < last; ++v) vertices.push_back(v);
  return wrench(reactions, vertices, i.state.time.step);
}

Wrench Simulation::force_on_vertices(const std::vector<int> &vertices) const
{
  const Implementation &i = *implementation_;
  const ReactionState &reactions = measured(i.state);
  const std::vector<int> fixed = i.state.mesh.fixed.download();
  for (int v : vertices) {
    if (v < 0 || v >= i.state.mesh.cloth_vertices)
      throw SceneError("force_on: vertex " + std::to_string(v) + " is not there; the cloth has " +
                       std::to_string(i.state.mesh.cloth_vertices) + " vertices");
    if (!fixed[static_cast<std::size_t>(v)])
      throw SceneError("force_on: " + i.state.mesh.describe(v) + " is held by no pin and no attachment");
  }
  return wrench(reactions, vertices, i.state.time.step);
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
  list_stages(*implementation_->pipeline, 0,
              [&](const Stage &s, int depth) { times.push_back({std::string(s.name()), depth, s.milliseconds()}); });
  return times;
}

std::vector<std::pair<std::string, std::string>> Simulation::explain() const
{
  std::vector<std::pair<std::string, std::string>> stages;
  list_stages(*implementation_->pipeline, 0, [&](const Stage &s, int depth) {
    const std::string indent(static_cast<std::size_t>(2 * depth), ' ');
    stages.emplace_back(indent + std::string(s.name()), s.reason());
  });
  return stages;
}

std::vector<StreamInfo> Simulation::streams() const
{
  std::vector<StreamInfo> streams;
  implementation_->state.visit_streams([&](const char *name, auto &stream) {
    using T = typename std::decay_t<decltype(stream)>::value_type;
    if (!stream.backend()) return;
    streams.push_back({name, element_name<T>(), static_cast<std::size_t>(stream.size()), stream.bytes()});
  });
  return streams;
}

const std::vector<std::string> &stream_names()
{
  static const std::vector<std::string> all = [] {
    std::vector<std::string> names;
    const std::unique_ptr<Backend> none = make_backend("cpu", 0, 1);
    State absent(*none);   // with the rooms of both searches
    TreeState trees;
    FrontState fronts;
    absent.trees = &trees;
    absent.fronts = &fronts;
    absent.system.f64 = std::make_unique<System<double>>();
    absent.visit_streams([&](const char *name, auto &) { names.emplace_back(name); });
    return names;
  }();
  return all;
}

Energy Simulation::energy() const { return measure_energy(implementation_->state); }
double Simulation::max_strain() const { return measure_strain(implementation_->state); }
double Simulation::min_gap() const { return measure_gap(implementation_->state); }

int Simulation::count_intersections() const
{
  const Implementation &i = *implementation_;
  const HostThreads host(i.threads);
  const std::vector<dvec3> position = i.state.mesh.position.download();
  return static_cast<int>(forbidden_intersections(position, i.topology, i.state.contact.settings.self).size() +
                          intrusions(position, i.topology).size());
}

std::uint64_t Simulation::state_hash() const
{
  const std::size_t bytes = sizeof(dvec3) * static_cast<std::size_t>(implementation_->state.mesh.cloth_vertices);
  const std::uint64_t hash = fnv1a(positions().data(), bytes);
  return fnv1a(velocities().data(), bytes, hash);
}

}  // namespace cama
