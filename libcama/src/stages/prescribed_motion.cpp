// SPDX-License-Identifier: Apache-2.0
#include "stages/prescribed_motion.hpp"

#include <algorithm>
#include <limits>
#include <memory>

#include "device/launch.hpp"

namespace cama {
namespace {

std::vector<dvec3> transform_rows(const RigidTransform &t)
{
  const auto [w, x, y, z] = t.rotation;
  return {{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
          {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
          {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)},
          t.translation,
          t.center,
          {t.scale, 0, 0}};
}

/// The same placement with its centre at the origin, as keys interpolate it.
RigidTransform about_origin(const RigidTransform &t)
{
  RigidTransform r;
  r.translation = t.apply({0, 0, 0});
  r.rotation = t.rotation;
  r.scale = t.scale;
  return r;
}

}  // namespace

PrescribedMotion::PrescribedMotion(const Scene &scene, Backend &backend)
    : backend_(backend), scene_obstacles_(scene.obstacles), pins_(scene.pins),
      attached_(backend, scene_obstacles_, obstacle_first_), transform_(backend), handle_position_(backend),
      handle_vertex_(backend)
{
  for (const Cloth &cloth : scene.cloths) {
    cloth_first_.push_back(static_cast<int>(start_.size()));
    start_.insert(start_.end(), cloth.mesh.position.begin(), cloth.mesh.position.end());
  }
  cloth_vertices_ = static_cast<int>(start_.size());
  for (const Obstacle &obstacle : scene.obstacles) {
    obstacle_first_.push_back(static_cast<int>(start_.size()));
    std::vector<dvec3> placed;
    obstacle.motion.evaluate(0, obstacle.mesh.position, placed);
    start_.insert(start_.end(), placed.begin(), placed.end());
  }
  for (std::size_t o = 0; o < scene.obstacles.size(); ++o)
    if (!scene.obstacles[o].rigid && !scene.obstacles[o].is_static())
      obstacles_.push_back({static_cast<int>(o), scene.obstacles[o].motion, obstacle_first_[o],
                            static_cast<int>(scene.obstacles[o].mesh.position.size()), false, -1, -1,
                            Stream<dvec3>(backend), Stream<dvec3>(backend)});
  set_up();
}

/// Handles and attachments as the scene has them.
void PrescribedMotion::set_up()
{
  handles_.clear();
  attached_.list.clear();
  driven_.clear();
  freed_.clear();
  for (const Pin &pin : pins_) {
    std::vector<int> vertices;
    for (int v : pin.vertices) vertices.push_back(cloth_first_[pin.cloth] + v);
    if (pin.obstacle) {
      for (int v : vertices) attached_.add(v, static_cast<int>(*pin.obstacle), start_, pin.release, false);
    } else {
      std::vector<dvec3> rest;
      for (int v : vertices) rest.push_back(start_[v]);
      handles_.push_back({pin.motion, std::move(vertices), std::move(rest), pin.release});
    }
  }
  attached_.upload();
}

dvec3 PrescribedMotion::Driven::at(double time) const
{
  if (time >= end) return to;
  return time <= start ? from : kernels::dlerp(from, to, (time - start) / (end - start));
}

/// Makes free vertices prescribed, and prescribed ones free.
void PrescribedMotion::hold(const Rooms &state, const std::vector<int> &fixed_now, const std::vector<int> &free_now)
{
  std::vector<int> fixed = state.mesh.fixed.download();
  const auto none = [&](const std::vector<int> &vertices, int value) {
    return std::all_of(vertices.begin(), vertices.end(), [&](int v) { return fixed[v] == value; });
  };
  if (none(fixed_now, 1) && none(free_now, 0)) return;
  std::vector<double> inverse_mass = state.mesh.inverse_mass.download();   // (empty without contact)
  const std::vector<double> mass = state.system.masses();
  for (int v : fixed_now) {
    if (fixed[v]) continue;
    fixed[v] = 1;
    if (inverse_mass.empty()) continue;
    free_inverse_mass_[v] = inverse_mass[v];
    inverse_mass[v] = 0;
  }
  for (int v : free_now) {
    if (!fixed[v]) continue;
    fixed[v] = 0;
    if (inverse_mass.empty()) continue;
    const auto known = free_inverse_mass_.find(v);
    inverse_mass[v] = known != free_inverse_mass_.end() ? known->second : 1 / mass[v];
  }
  state.mesh.fixed.assign(fixed);
  if (!inverse_mass.empty()) state.mesh.inverse_mass.assign(inverse_mass);
  ++state.mesh.pin_changes;
}

/// Removes the vertices for which of(vertex) holds from handles, attachments and driven pins.
template <class Of> void PrescribedMotion::forget(Of &&of)
{
  for (Handle &h : handles_) {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < h.vertices.size(); ++i) {
      if (of(h.vertices[i])) {
        freed_.insert(h.vertices[i]);
        continue;
      }
      h.vertices[kept] = h.vertices[i];
      h.rest[kept++] = h.rest[i];
    }
    h.vertices.resize(kept);
    h.rest.resize(kept);
  }
  std::vector<Attachments::Attached> &list = attached_.list;
  const std::size_t before = list.size();
  list.erase(std::remove_if(list.begin(), list.end(),
                            [&](const Attachments::Attached &a) {
                              const bool gone = of(a.row.vertex);
                              if (gone && !a.driven) freed_.insert(a.row.vertex);
                              return gone;
                            }),
             list.end());
  if (list.size() != before) attached_.upload();
  driven_.erase(std::remove_if(driven_.begin(), driven_.end(), [&](const Driven &d) { return of(d.vertex); }),
                driven_.end());
}

void PrescribedMotion::release_due(const Rooms &state, double time)
{
  const auto due = [time](const auto &p) { return p.release <= time; };
  std::vector<Attachments::Attached> &list = attached_.list;
  if (std::none_of(handles_.begin(), handles_.end(), due) && std::none_of(list.begin(), list.end(), due)) return;
  std::vector<int> vertices;
  for (const Handle &h : handles_)
    if (due(h)) vertices.insert(vertices.end(), h.vertices.begin(), h.vertices.end());
  std::vector<kernels::attachment> kept;
  for (const Attachments::Attached &a : list)
    if (due(a))
      vertices.push_back(a.row.vertex);
    else
      kept.push_back(a.row);
  hold(state, {}, vertices);
  // Nothing below allocates: either everything is done or, if memory ran out above, nothing.
  if (attached_.rows.size()) attached_.rows.assign(kept);
  released_ = time;
  handles_.erase(std::remove_if(handles_.begin(), handles_.end(), due), handles_.end());
  list.erase(std::remove_if(list.begin(), list.end(), due), list.end());
}

std::vector<char> PrescribedMotion::pinned() const
{
  std::vector<char> result(static_cast<std::size_t>(cloth_vertices_), 0);
  for (const Driven &d : driven_) result[d.vertex] = 1;
  return result;
}

void PrescribedMotion::pin(const Rooms &state, const std::vector<int> &vertices, const std::vector<dvec3> &targets,
                           double duration)
{
  const double now = state.time.now, end = now + duration;
  std::vector<int> place_of(static_cast<std::size_t>(cloth_vertices_), -1);
  for (std::size_t i = 0; i < vertices.size(); ++i) place_of[vertices[i]] = static_cast<int>(i);
  std::vector<char> done(vertices.size(), 0);
  for (Driven &d : driven_)
    if (const int i = place_of[d.vertex]; i >= 0) {
      d = {d.vertex, d.at(now), targets[i], now, end};
      done[i] = 1;
    }
  std::vector<int> others;
  for (std::size_t i = 0; i < vertices.size(); ++i)
    if (!done[i]) others.push_back(vertices[i]);
  if (others.empty()) return;
  forget([&](int v) { return place_of[v] >= 0 && !done[place_of[v]]; });
  const std::vector<dvec3> x = state.mesh.position.download();
  for (int v : others) driven_.push_back({v, x[v], targets[place_of[v]], now, end});
  hold(state, others, {});
}

void PrescribedMotion::release(const Rooms &state, const std::vector<int> &vertices)
{
  std::vector<char> listed(static_cast<std::size_t>(cloth_vertices_), 0);
  for (int v : vertices) listed[v] = 1;
  forget([&](int v) { return listed[v] != 0; });
  hold(state, {}, vertices);
}

void PrescribedMotion::attach(const Rooms &state, const std::vector<int> &vertices, int obstacle)
{
  std::vector<char> listed(static_cast<std::size_t>(cloth_vertices_), 0);
  for (int v : vertices) listed[v] = 1;
  forget([&](int v) { return listed[v] != 0; });
  const std::vector<dvec3> x = state.mesh.position.download();
  for (int v : vertices) attached_.add(v, obstacle, x, std::numeric_limits<double>::infinity(), true);
  attached_.upload();
  hold(state, vertices, {});
}

PrescribedMotion::MovingObstacle &PrescribedMotion::moving(const Rooms &state, int obstacle)
{
  const auto at = std::find_if(obstacles_.begin(), obstacles_.end(),
                               [obstacle](const MovingObstacle &o) { return o.index == obstacle; });
  if (!state.mesh.rest_position.backend()) {
    std::vector<dvec3> rest(static_cast<std::size_t>(cloth_vertices_), dvec3{0, 0, 0});  // cloth has no rigid motion
    for (const Obstacle &o : scene_obstacles_) rest.insert(rest.end(), o.mesh.position.begin(), o.mesh.position.end());
    state.mesh.rest_position = Stream<dvec3>(backend_, rest);
  }
  if (at != obstacles_.end()) return *at;
  obstacles_.push_back({obstacle, scene_obstacles_[obstacle].motion, obstacle_first_[obstacle],
                        static_cast<int>(scene_obstacles_[obstacle].mesh.position.size()), false, -1, -1,
                        Stream<dvec3>(backend_), Stream<dvec3>(backend_)});
  state.mesh.object_static[cloth_first_.size() + static_cast<std::size_t>(obstacle)] = 0;
  ++state.mesh.motion_changes;
  return obstacles_.back();
}

const Motion *PrescribedMotion::motion_of(int obstacle) const
{
  for (const MovingObstacle &o : obstacles_)
    if (o.index == obstacle) return &o.motion;
  return nullptr;
}

void PrescribedMotion::move_obstacle(const Rooms &state, int obstacle, const RigidTransform &target, double duration)
{
  MovingObstacle &o = moving(state, obstacle);
  const double now = state.time.now;
  const RigidTransform from = about_origin(o.motion.at(now));
  RigidTransform to = target;
  to.scale = from.scale;
  Motion motion;
  motion.sampled = o.motion.sampled;
  motion.keys = {{now, from}, {now + duration, to}};
  o.motion = motion;
  o.driven = true;
}

void PrescribedMotion::move_obstacle(const Rooms &state, int obstacle, const std::vector<dvec3> &target,
                                     double duration)
{
  MovingObstacle &o = moving(state, obstacle);
  const double now = state.time.now;
  const std::vector<dvec3> x = state.mesh.position.download();
  auto sampled = std::make_shared<Motion::Sampled>();
  sampled->time = {now, now + duration};
  sampled->position = {std::vector<dvec3>(x.begin() + o.first, x.begin() + o.first + o.count), target};
  o.motion = Motion{};
  o.motion.sampled = sampled;
  o.frame_a = o.frame_b = -1;
  o.driven = true;
}

void PrescribedMotion::place(const Rooms &state, double time)
{
  for (MovingObstacle &o : obstacles_) {
    transform_.assign(transform_rows(o.motion.at(time)));
    if (o.motion.is_rigid()) {
      CAMA_LAUNCH(*state.backend, move_rigid, o.count, state.mesh.rest_position, transform_, o.first,
                  state.mesh.position_next);
      continue;
    }
    const Motion::Sampled &s = *o.motion.sampled;
    const int last = static_cast<int>(s.time.size()) - 1;
    const int b = std::clamp(static_cast<int>(std::upper_bound(s.time.begin(), s.time.end(), time) - s.time.begin()),
                             std::min(1, last), last);
    const int a = std::max(b - 1, 0);
    const double t = b > a ? std::clamp((time - s.time[a]) / (s.time[b] - s.time[a]), 0.0, 1.0) : 0.0;
    if (a != o.frame_a || b != o.frame_b) {
      o.a.assign(s.position[a]);
      o.b.assign(s.position[b]);
      o.frame_a = a;
      o.frame_b = b;
    }
    CAMA_LAUNCH(*state.backend, move_sampled, o.count, o.a, o.b, t, o.first, state.mesh.position_next);
    // Sampled frames first, then the rigid part, as in Motion::evaluate.
    CAMA_LAUNCH(*state.backend, move_rigid, o.count, state.mesh.position_next, transform_, o.first,
                state.mesh.position_next);
  }
  for (const RigidBody &body : state.rigid.body) {
    transform_.assign(transform_rows(body.pose_next()));
    CAMA_LAUNCH(*state.backend, move_rigid, body.last - body.first, state.mesh.rest_position, transform_, body.first,
                state.mesh.position_next);
  }
  std::vector<int> vertex;
  std::vector<dvec3> position;
  for (const Handle &h : handles_) {
    const RigidTransform t = h.motion.at(time);
    for (std::size_t i = 0; i < h.vertices.size(); ++i) {
      vertex.push_back(h.vertices[i]);
      position.push_back(t.apply(h.rest[i]));
    }
  }
  for (const Driven &d : driven_) {
    vertex.push_back(d.vertex);
    position.push_back(d.at(time));
  }
  if (!vertex.empty()) {
    handle_vertex_.assign(vertex);
    handle_position_.assign(position);
    CAMA_LAUNCH(*state.backend, scatter_positions, handle_vertex_.size(), handle_vertex_, handle_position_,
                state.mesh.position_next);
  }
  attached_.move(*state.backend, state.mesh.position_next);
}

void PrescribedMotion::run_on(const Rooms &state)
{
  release_due(state, state.time.now);
  place(state, state.time.now + state.time.step);
  CAMA_LAUNCH(*state.backend, prescribe_velocities, state.mesh.vertices, state.mesh.fixed,
              state.mesh.base_position(state.time), state.mesh.position_next, state.time.implicit_step,
              state.mesh.velocity_next);
}

}  // namespace cama
