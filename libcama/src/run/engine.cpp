// SPDX-License-Identifier: Apache-2.0
#include "run/engine.hpp"

#include <algorithm>
#include <optional>

#include "cama/error.hpp"
#include "device/host_threads.hpp"
#include "model/setup.hpp"
#include "run/pipeline_factory.hpp"
#include "run/step.hpp"
#include "run/step_control.hpp"
#include "start/start_check.hpp"
#include "start/start_policy.hpp"

namespace cama {
namespace {

constexpr int few_vertices = 65536;  // of cloth, whose launches last less than it takes the host to make them

int chosen_threads(const Scene &scene, const Options &options)
{
  return options.threads ? options.threads : useful_threads(scene.cloth_triangle_count());
}

/// Throws SceneError, MeshError or MaterialError.
void check(const Scene &scene, const Options &options)
{
  scene.validate();
  if (has_yield(scene) && (options.bending == Bending::hinge || options.arcsim_conventions))
    for (const Cloth &c : scene.cloths)
      if (c.material.yield_curvature > 0)
        throw MaterialError("material of cloth \"" + c.name +
                            "\": yield_curvature needs the option bending = plate, which has curvatures of triangles; "
                            "set bending to plate, or leave yield_curvature out");
  if (options.pinch == Pinch::release)   // only meshes tell when cloth has come free
    for (const Obstacle &o : scene.obstacles)
      if (o.shape != ObstacleShape::mesh && o.shape != ObstacleShape::box)
        throw SceneError("pinch: release needs obstacles that are meshes or boxes; mesh '" + o.name +
                         "', or set pinch to stop");
}

/// Checks before it makes the backend, or takes the given one.
std::unique_ptr<Backend> checked_backend(const Scene &scene, const Options &options,
                                         std::unique_ptr<Backend> given = nullptr)
{
  check(scene, options);
  return given ? std::move(given) : make_backend(options.backend, options.device, chosen_threads(scene, options));
}

Engine::Start treated_start(const Scene &scene, const Options &options)
{
  const HostThreads host(chosen_threads(scene, options));
  Engine::Start start{build_topology(scene), {}};
  start.untangled = treat_start(scene, options.intersections, start.topology);
  return start;
}

}  // namespace

Engine::Engine(const Scene &scene, const ResolvedOptions &options) : Engine(scene, options, nullptr) {}

Engine::Engine(const Scene &scene, const ResolvedOptions &options, std::unique_ptr<Backend> device)
    : Engine(scene, options, checked_backend(scene, options.options, std::move(device)),
             treated_start(scene, options.options))
{}

Engine::Engine(const Scene &scene, const ResolvedOptions &resolved, std::unique_ptr<Backend> device, Start start)
    : threads(chosen_threads(scene, resolved.options)), backend(std::move(device)), loans(backend), state(*backend),
      topology(std::move(start.topology)), untangled(start.untangled), chosen(resolved.chosen)
{
  const HostThreads host(threads);
  const Options &options = state.options = resolved.options;
  for (const Obstacle &o : scene.obstacles) state.options.forces |= o.rigid.has_value();  // which move them
  if (resolved.error > 0) {
    state.time.error = resolved.error;
    state.time.frame = scene.seconds_per_frame();
    state.time.longest = std::min(state.time.frame, longest_step);
    state.time.shortest = shortest_step(resolved.error, cloth_size(scene), state.time.frame);
  }
  const bool exempt = options.intersections == StartPolicy::exempt;
  guarded = !exempt && scene.has_contact();
  if (options.precision == Precision::single) {
    set_up<float>(state, scene, topology);
    pipeline = make_pipeline<float>(scene, state);
  } else {
    set_up<double>(state, scene, topology);
    pipeline = make_pipeline<double>(scene, state);
  }
  for (const auto &stage : pipeline->children())
    if (auto *motion = dynamic_cast<PrescribedMotion *>(stage.get())) motion_ = motion;
  if (!motion_) idle_motion_ = std::make_unique<PrescribedMotion>(scene, *backend);
  scene_gravity_ = scene.gravity;
  for (const Cloth &c : scene.cloths) scene_pressure_.push_back(c.pressure);
  if (has_gas(scene)) gas_ = scene_gas_ = state.system.gas.gas.download();
  if (scene.wind) scene_wind_ = scene.wind->velocity;
  for (const Obstacle &o : scene.obstacles) shape_.push_back(o.shape);
  if (exempt && scene.has_contact()) {
    state.exemptions.add_tangle(forbidden_intersections(topology.position, topology, scene.contact.self), topology);
    state.exemptions.upload();
  }
}

Engine::~Engine()
{
  if (loans) loans->leave({&state.mesh.position, &state.mesh.velocity});
}

void Engine::take(const std::function<void()> &finished)
{
  const HostThreads host(threads);
  before_writing();
  std::optional<Batches> batches;
  if (state.mesh.cloth_vertices <= few_vertices) batches.emplace(*backend);
  take_step(state, *pipeline, finished);
}

}  // namespace cama
