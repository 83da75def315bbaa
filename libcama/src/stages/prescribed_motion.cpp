// SPDX-License-Identifier: Apache-2.0
#include "stages/prescribed_motion.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

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

/// The foot point of x on the obstacle's triangles, and the offset in the triangle's frame.
kernels::attachment attach(const dvec3 &x, int vertex, const Obstacle &obstacle, const std::vector<dvec3> &position,
                           int first)
{
  using namespace kernels;
  kernels::attachment best{};
  double smallest = std::numeric_limits<double>::infinity();
  for (const Triangle &f : obstacle.mesh.face) {
    const dvec3 a = position[f[0]], b = position[f[1]], c = position[f[2]];
    const proximity p = vertex_face_proximity(x, a, b, c);
    if (p.distance >= smallest) continue;
    smallest = p.distance;
    best.vertex = vertex;
    const dvec3 foot = dadd(dadd(dscale(-p.weight[1], a), dscale(-p.weight[2], b)), dscale(-p.weight[3], c));
    const dvec3 t = dnormalize(dsub(b, a)), n = dnormalize(dcross(dsub(b, a), dsub(c, a))), s = dcross(n, t),
                off = dsub(x, foot);
    for (int k = 0; k < 3; ++k) {
      best.node[k] = first + f[k];
      best.weight[k] = -p.weight[k + 1];
    }
    best.offset[0] = ddot(off, t);
    best.offset[1] = ddot(off, s);
    best.offset[2] = ddot(off, n);
  }
  return best;
}

}  // namespace

PrescribedMotion::PrescribedMotion(const Scene &scene, Backend &backend)
    : transform_(backend, 6), handle_position_(backend), handle_vertex_(backend), attachments_(backend)
{
  std::vector<int> cloth_first, obstacle_first;
  std::vector<dvec3> start;
  for (const Cloth &cloth : scene.cloths) {
    cloth_first.push_back(static_cast<int>(start.size()));
    start.insert(start.end(), cloth.mesh.position.begin(), cloth.mesh.position.end());
  }
  for (const Obstacle &obstacle : scene.obstacles) {
    const int first = static_cast<int>(start.size());
    obstacle_first.push_back(first);
    std::vector<dvec3> placed;
    obstacle.motion.evaluate(0, obstacle.mesh.position, placed);
    start.insert(start.end(), placed.begin(), placed.end());
    if (!obstacle.motion.is_static())
      obstacles_.push_back({obstacle.motion, first, static_cast<int>(placed.size()), -1, -1, Stream<dvec3>(backend),
                            Stream<dvec3>(backend)});
  }
  std::vector<kernels::attachment> attachments;
  for (const Pin &pin : scene.pins) {
    std::vector<int> vertices;
    for (int v : pin.vertices) vertices.push_back(cloth_first[pin.cloth] + v);
    if (pin.obstacle) {
      const Obstacle &obstacle = scene.obstacles[*pin.obstacle];
      const int first = obstacle_first[*pin.obstacle];
      const std::vector<dvec3> placed(start.begin() + first,
                                      start.begin() + first + static_cast<long>(obstacle.mesh.position.size()));
      for (int v : vertices) attachments.push_back(attach(start[v], v, obstacle, placed, first));
      attached_.push_back({std::move(vertices), pin.release});
    } else {
      std::vector<dvec3> rest;
      for (int v : vertices) rest.push_back(start[v]);
      handles_.push_back({pin.motion, std::move(vertices), std::move(rest), pin.release});
    }
  }
  if (!attachments.empty()) attachments_.assign(attachments);
}

void PrescribedMotion::release_due(const Rooms &state, double time)
{
  const auto due = [time](const auto &p) { return !p.released && p.release <= time; };
  if (std::none_of(handles_.begin(), handles_.end(), due) && std::none_of(attached_.begin(), attached_.end(), due))
    return;
  std::vector<int> fixed = state.mesh.fixed.download();
  std::vector<double> inverse_mass = state.mesh.inverse_mass.download();   // (empty without contact)
  const std::vector<double> mass = state.system.masses();
  const auto let_go = [&](const auto &list) {
    for (const auto &p : list)
      if (due(p))
        for (int v : p.vertices) {
          fixed[v] = 0;
          if (!inverse_mass.empty()) inverse_mass[v] = 1 / mass[v];
        }
  };
  let_go(handles_);
  let_go(attached_);
  const std::vector<kernels::attachment> all = attachments_.download();
  std::vector<kernels::attachment> kept;
  std::size_t at = 0;
  for (const Attached &a : attached_)
    for (std::size_t i = 0; i < a.vertices.size(); ++i, ++at)
      if (!due(a)) kept.push_back(all[at]);
  // Nothing below allocates: either everything is done or, if memory ran out above, nothing.
  attachments_.assign(kept);
  state.mesh.fixed.assign(fixed);
  if (!inverse_mass.empty()) state.mesh.inverse_mass.assign(inverse_mass);
  ++state.mesh.releases;
  released_ = time;
  for (const Handle &h : handles_)
    if (due(h)) last_end_ = std::max(last_end_, h.release);
  for (const Attached &a : attached_)
    if (due(a)) last_end_ = std::max(last_end_, a.release);
  for (Handle &h : handles_) h.released |= due(h);
  attached_.erase(std::remove_if(attached_.begin(), attached_.end(), due), attached_.end());
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
  std::vector<int> vertex;
  std::vector<dvec3> position;
  for (const Handle &h : handles_) {
    if (h.released) continue;
    const RigidTransform t = h.motion.at(time);
    for (std::size_t i = 0; i < h.vertices.size(); ++i) {
      vertex.push_back(h.vertices[i]);
      position.push_back(t.apply(h.rest[i]));
    }
  }
  if (!vertex.empty()) {
    handle_vertex_.assign(vertex);
    handle_position_.assign(position);
    CAMA_LAUNCH(*state.backend, scatter_positions, handle_vertex_.size(), handle_vertex_, handle_position_,
                state.mesh.position_next);
  }
  if (attachments_.size())
    CAMA_LAUNCH(*state.backend, move_attached, attachments_.size(), attachments_, state.mesh.position_next);
}

void PrescribedMotion::save(State &, Checkpoint &checkpoint) { checkpoint.released = released_; }

void PrescribedMotion::restore(State &state, const Checkpoint &checkpoint)
{
  if (last_end_ > checkpoint.released)
    throw SceneError("checkpoint: has pins that this simulation has released; restore it into a new simulation of the "
                     "scene");
  release_due(state, checkpoint.released);
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
