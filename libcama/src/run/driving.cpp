// SPDX-License-Identifier: Apache-2.0
// What a driver sets between steps: checked here, carried out by the stage of prescribed motion.
#include <algorithm>
#include <cmath>
#include <string>

#include "cama/error.hpp"
#include "device/launch.hpp"
#include "run/engine.hpp"

namespace cama {
namespace {

constexpr double unit_tolerance = 1e-6;  // of the length of a quaternion

[[noreturn]] void refuse(const std::string &text) { throw SceneError(text); }

void check_rows(const char *what, const char *name, const std::vector<dvec3> &rows, std::size_t count)
{
  if (rows.size() != count)
    refuse(std::string(what) + ": " + name + " has " + std::to_string(rows.size()) + " rows; " + std::to_string(count) +
           " are needed");
  for (std::size_t i = 0; i < count; ++i)
    if (!std::isfinite(rows[i].x + rows[i].y + rows[i].z))
      refuse(std::string(what) + ": " + name + "[" + std::to_string(i) + "] is not finite");
}

void check_finite(const char *what, const dvec3 &v)
{
  if (!std::isfinite(v.x + v.y + v.z)) refuse(std::string(what) + " is not finite");
}

double length_of(const std::array<double, 4> &q)
{
  return std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
}

dvec3 first_of(const std::vector<double> &v) { return {v[0], v[1], v[2]}; }

}  // namespace

PrescribedMotion &Engine::driver()
{
  if (idle_motion_) {
    motion_ = idle_motion_.get();
    pipeline->insert(state.options.integrator == Integrator::bdf2 ? 1 : 0, std::move(idle_motion_));
  }
  return *motion_;
}

void Engine::check_vertices(const char *what, const std::vector<int> &vertices) const
{
  std::vector<char> seen(static_cast<std::size_t>(state.mesh.cloth_vertices), 0);
  for (std::size_t i = 0; i < vertices.size(); ++i) {
    const int v = vertices[i];
    const std::string name = std::string(what) + ": vertices[" + std::to_string(i) + "] is " + std::to_string(v);
    if (v < 0 || v >= state.mesh.cloth_vertices)
      refuse(name + "; the cloth has " + std::to_string(state.mesh.cloth_vertices) + " vertices");
    if (seen[static_cast<std::size_t>(v)]++) refuse(name + ", which appears twice");
  }
}

void Engine::check_obstacle(const char *what, int obstacle) const
{
  if (obstacle < 0 || static_cast<std::size_t>(obstacle) >= shape_.size())
    refuse(std::string(what) + ": obstacle " + std::to_string(obstacle) + " is not there; the scene has " +
           std::to_string(shape_.size()));
}

void Engine::check_driven(const char *what, int obstacle) const
{
  for (const RigidBody &body : state.rigid.body)
    if (body.obstacle == obstacle)
      refuse(std::string(what) + ": " +
             state.mesh.object_name[static_cast<std::size_t>(state.mesh.object_of(body.first))] +
             " is rigid: forces move it; leave rigid out to drive it");
}

const RigidBody &Engine::rigid_body(const char *what, int obstacle) const
{
  check_obstacle(what, obstacle);
  for (const RigidBody &body : state.rigid.body)
    if (body.obstacle == obstacle) return body;
  refuse(std::string(what) + ": " +
         state.mesh.object_name[topology.cloth_range.size() + static_cast<std::size_t>(obstacle)] +
         " is not rigid; give it rigid in the scene");
}

double Engine::duration_of(const char *what, double duration) const
{
  if (!std::isfinite(duration) || duration < 0)
    refuse(std::string(what) + ": duration is " + std::to_string(duration) + " s; it must not be negative");
  return duration > 0 ? duration : state.time.step;
}

void Engine::check_pin(const std::vector<int> &vertices, const std::vector<dvec3> &targets, double duration) const
{
  check_vertices("pin", vertices);
  if (!targets.empty()) check_rows("pin", "targets", targets, vertices.size());
  duration_of("pin", duration);
}

void Engine::pin(const std::vector<int> &vertices, const std::vector<dvec3> &targets, double duration)
{
  check_pin(vertices, targets, duration);
  check_rows("pin", "targets", targets, vertices.size());
  driver().pin(state, vertices, targets, duration_of("pin", duration));
}

void Engine::check_targets(const std::vector<int> &vertices, const std::vector<dvec3> &targets, double duration) const
{
  check_vertices("set_targets", vertices);
  check_rows("set_targets", "positions", targets, vertices.size());
  const std::vector<char> pinned = motion().pinned();
  for (int v : vertices)
    if (!pinned[static_cast<std::size_t>(v)])
      refuse("set_targets: " + state.mesh.describe(v) + " is not held by pin(); call pin first");
  duration_of("set_targets", duration);
}

void Engine::set_targets(const std::vector<int> &vertices, const std::vector<dvec3> &targets, double duration)
{
  check_targets(vertices, targets, duration);
  driver().pin(state, vertices, targets, duration_of("set_targets", duration));
}

void Engine::release(const std::vector<int> &vertices)
{
  check_vertices("release", vertices);
  driver().release(state, vertices);
}

void Engine::attach(const std::vector<int> &vertices, int obstacle)
{
  check_vertices("attach", vertices);
  check_obstacle("attach", obstacle);
  const ObstacleShape shape = shape_[static_cast<std::size_t>(obstacle)];
  if (shape != ObstacleShape::mesh && shape != ObstacleShape::box)
    refuse("attach: needs an obstacle with triangles, a mesh or a box; " +
           state.mesh.object_name[topology.cloth_range.size() + static_cast<std::size_t>(obstacle)] +
           " is an exact shape; mesh it, or pin the vertices");
  driver().attach(state, vertices, obstacle);
}

void Engine::check_pose(int obstacle, const dvec3 &translation, const std::array<double, 4> &rotation,
                        double duration) const
{
  check_obstacle("set_obstacle_pose", obstacle);
  check_driven("set_obstacle_pose", obstacle);
  check_finite("set_obstacle_pose: translation", translation);
  if (!(std::abs(length_of(rotation) - 1) < unit_tolerance))
    refuse("set_obstacle_pose: rotation is not a unit quaternion (w, x, y, z)");
  duration_of("set_obstacle_pose", duration);
}

void Engine::set_obstacle_pose(int obstacle, const dvec3 &translation, const std::array<double, 4> &rotation,
                               double duration)
{
  check_pose(obstacle, translation, rotation, duration);
  RigidTransform target;
  target.translation = translation;
  const double length = length_of(rotation);
  for (int k = 0; k < 4; ++k) target.rotation[k] = rotation[k] / length;
  driver().move_obstacle(state, obstacle, target, duration_of("set_obstacle_pose", duration));
}

void Engine::set_obstacle_vertices(int obstacle, const std::vector<dvec3> &positions, double duration)
{
  const char *what = "set_obstacle_vertices";
  check_obstacle(what, obstacle);
  check_driven(what, obstacle);
  const auto range = topology.obstacle_range[static_cast<std::size_t>(obstacle)];
  check_rows(what, "positions", positions, static_cast<std::size_t>(range.second - range.first));
  if (shape_[static_cast<std::size_t>(obstacle)] != ObstacleShape::mesh)
    refuse("set_obstacle_vertices: needs a mesh; set_obstacle_pose moves exact shapes and boxes");
  driver().move_obstacle(state, obstacle, positions, duration_of(what, duration));
}

void Engine::check_force(const std::vector<int> &vertices, const std::vector<dvec3> &forces) const
{
  check_vertices("set_force", vertices);
  check_rows("set_force", "forces", forces, vertices.size());
}

void Engine::set_force(const std::vector<int> &vertices, const std::vector<dvec3> &forces)
{
  check_force(vertices, forces);
  Stream<dvec3> &force = state.elements.driven_force;
  std::vector<dvec3> all(static_cast<std::size_t>(state.mesh.cloth_vertices), dvec3{0, 0, 0});
  if (force.size()) all = force.download();
  for (std::size_t i = 0; i < vertices.size(); ++i) all[static_cast<std::size_t>(vertices[i])] = forces[i];
  if (!force.backend()) force = Stream<dvec3>(*backend);
  force.assign(all);
}

Stream<dvec3> Engine::received(const char *what, const DeviceVectors &vectors, int count)
{
  if (vectors.size != count)
    refuse(std::string(what) + ": has " + std::to_string(vectors.size) + " rows; " + std::to_string(count) +
           " are needed");
  Stream<dvec3> own(*backend, count);
  if (count == 0) return own;
  if (!backend->reaches(vectors.data))
    refuse(std::string(what) + ": is not in memory of " + backend->device() + ", on which the simulation computes");
  if (!vectors.in_order) backend->synchronize_device();
  Components<float> given{const_cast<void *>(vectors.data)};
  if (vectors.single)
    CAMA_LAUNCH(*backend, widen_vectors, count, given, own);
  else
    backend->copy(own.buffer(), given.buffer, sizeof(dvec3) * static_cast<std::size_t>(count));
  Stream<int> bad(*backend, 1);
  bad.fill_zero();
  CAMA_LAUNCH(*backend, find_nonfinite_vector, count, own, bad);
  if (const int row = bad.at(0)) refuse(std::string(what) + "[" + std::to_string(count - row) + "] is not finite");
  return own;
}

void Engine::set_force(const std::vector<int> &vertices, const DeviceVectors &forces)
{
  check_vertices("set_force", vertices);
  const Stream<dvec3> given = received("set_force: forces", forces, static_cast<int>(vertices.size()));
  const Stream<int> vertex(*backend, vertices);
  Stream<dvec3> &force = state.elements.driven_force;
  if (!force.backend()) force = Stream<dvec3>(*backend);
  if (!force.size()) {
    force.resize(state.mesh.cloth_vertices);
    force.fill_zero();
  }
  CAMA_LAUNCH(*backend, scatter_positions, given.size(), vertex, given, force);
}

void Engine::check_gravity(const dvec3 &gravity) const { check_finite("gravity", gravity); }

void Engine::set_gravity(const dvec3 &gravity)
{
  check_gravity(gravity);
  state.elements.gravity.assign({gravity});
}

void Engine::check_wind(const dvec3 &velocity) const
{
  check_finite("wind", velocity);
  if (!state.elements.wind.size())
    refuse("wind: the scene has no air; give it a wind with a density or a drag, at rest if need be, or "
           "a material with mass_damping");
}

void Engine::set_wind(const dvec3 &velocity)
{
  check_wind(velocity);
  state.elements.wind.assign({velocity});
}

void Engine::set_pressure(int cloth, double pressure)
{
  if (cloth < 0 || static_cast<std::size_t>(cloth) >= topology.cloth_range.size())
    refuse("set_pressure: cloth " + std::to_string(cloth) + " is not there; the scene has " +
           std::to_string(topology.cloth_range.size()));
  if (!std::isfinite(pressure)) refuse("set_pressure: the pressure is not finite");
  std::vector<double> all = pressures();
  all[static_cast<std::size_t>(cloth)] = pressure;
  assign_pressures(all);
}

std::vector<double> Engine::pressures() const
{
  const Stream<double> &pressure = state.elements.pressure;
  return pressure.size() ? pressure.download() : std::vector<double>(topology.cloth_range.size(), 0.0);
}

void Engine::assign_pressures(const std::vector<double> &pressures)
{
  if (!state.elements.pressure.backend()) state.elements.pressure = Stream<double>(*backend);
  state.elements.pressure.assign(pressures);
}

void Engine::save_driving(Checkpoint &c)
{
  const auto vector = [&](const char *name, const dvec3 &v) { c.driving[name] = {v.x, v.y, v.z}; };
  const auto differs = [](const dvec3 &a, const dvec3 &b) { return a.x != b.x || a.y != b.y || a.z != b.z; };
  if (const dvec3 g = state.elements.gravity.at(0); differs(g, scene_gravity_)) vector("gravity", g);
  if (state.elements.wind.size())
    if (const dvec3 w = state.elements.wind.at(0); differs(w, scene_wind_)) vector("wind", w);
  if (const std::vector<double> now = pressures(); now != scene_pressure_) c.driving["pressure"] = now;
  if (state.elements.driven_force.size())
    for (const dvec3 &f : state.elements.driven_force.download())
      for (double x : {f.x, f.y, f.z}) c.driving["force"].push_back(x);
}

void Engine::check_driving(const Checkpoint &c)
{
  motion().check(c);
  const auto check_size = [&](const char *name, std::size_t size) {
    const auto at = c.driving.find(name);
    if (at != c.driving.end() && at->second.size() != size)
      refuse(std::string("checkpoint: driving: ") + name +
             " does not fit the scene; load the scene that it was taken from");
  };
  check_size("gravity", 3);
  check_size("wind", state.elements.wind.size() ? 3 : 0);
  check_size("pressure", topology.cloth_range.size());
  check_size("force", 3 * static_cast<std::size_t>(state.mesh.cloth_vertices));
}

void Engine::restore_driving(const Checkpoint &c)
{
  if (!c.driving.empty()) driver();
  const auto found = [&](const char *name) {
    const auto at = c.driving.find(name);
    return at == c.driving.end() ? nullptr : &at->second;
  };
  const std::vector<double> *gravity = found("gravity"), *wind = found("wind"), *force = found("force");
  state.elements.gravity.assign({gravity ? first_of(*gravity) : scene_gravity_});
  if (state.elements.wind.size()) state.elements.wind.assign({wind ? first_of(*wind) : scene_wind_});
  const std::vector<double> *pressure = found("pressure");
  if (pressure || state.elements.pressure.size()) assign_pressures(pressure ? *pressure : scene_pressure_);
  if (!force && !state.elements.driven_force.size()) return;
  std::vector<dvec3> all(static_cast<std::size_t>(state.mesh.cloth_vertices), dvec3{0, 0, 0});
  if (force)
    for (std::size_t v = 0; v < all.size(); ++v) all[v] = {(*force)[3 * v], (*force)[3 * v + 1], (*force)[3 * v + 2]};
  if (!state.elements.driven_force.backend()) state.elements.driven_force = Stream<dvec3>(*backend);
  state.elements.driven_force.assign(all);
}

}  // namespace cama
