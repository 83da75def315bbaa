// SPDX-License-Identifier: Apache-2.0
#include "stages/prescribed_motion.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <string>

#include "cama/error.hpp"
#include "device/launch.hpp"

namespace cama {
namespace {

// numbers in a row of the tables of a checkpoint
constexpr std::size_t pin_row = 9, attachment_row = 16, earlier_attachment_row = 10, pose_row = 10;

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

void put(std::vector<double> &row, const dvec3 &v) { row.insert(row.end(), {v.x, v.y, v.z}); }
dvec3 get(const double *row) { return {row[0], row[1], row[2]}; }

}  // namespace

PrescribedMotion::PrescribedMotion(const Scene &scene, Backend &backend)
    : backend_(backend), scene_obstacles_(scene.obstacles), pins_(scene.pins), transform_(backend),
      handle_position_(backend), handle_vertex_(backend), faces_row_stream_(backend), faces_of_stream_(backend),
      attachments_(backend)
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
  attached_.clear();
  driven_.clear();
  freed_.clear();
  for (const Pin &pin : pins_) {
    std::vector<int> vertices;
    for (int v : pin.vertices) vertices.push_back(cloth_first_[pin.cloth] + v);
    if (pin.obstacle) {
      for (int v : vertices)
        attached_.push_back(attached_to(v, static_cast<int>(*pin.obstacle), start_, pin.release, false));
    } else {
      std::vector<dvec3> rest;
      for (int v : vertices) rest.push_back(start_[v]);
      handles_.push_back({pin.motion, std::move(vertices), std::move(rest), pin.release});
    }
  }
  upload_attachments();
}

void PrescribedMotion::find_faces()
{
  if (!faces_row_.empty()) return;
  std::vector<std::vector<int>> around(start_.size() - static_cast<std::size_t>(cloth_vertices_));
  for (std::size_t o = 0; o < scene_obstacles_.size(); ++o)
    for (const Triangle &f : scene_obstacles_[o].mesh.face)
      for (int k = 0; k < 3; ++k)
        for (int next : {f[(k + 1) % 3], f[(k + 2) % 3]})
          around[static_cast<std::size_t>(obstacle_first_[o] - cloth_vertices_ + f[k])].push_back(obstacle_first_[o] +
                                                                                                  next);
  std::vector<int> row{0}, of;
  for (const std::vector<int> &faces : around) {
    of.insert(of.end(), faces.begin(), faces.end());
    row.push_back(static_cast<int>(of.size() / 2));
  }
  faces_row_.swap(row);
  faces_of_.swap(of);
}

PrescribedMotion::Attached PrescribedMotion::attached_at(kernels::attachment foot, const std::vector<dvec3> &position,
                                                         double release, bool driven)
{
  using namespace kernels;
  find_faces();
  dvec3 off = position[foot.vertex];
  for (int j = 0; j < 3; ++j) off = daxpy(off, -foot.weight[j], position[foot.node[j]]);
  for (int j = 0; j < 3; ++j) {
    dvec3 axis[3];
    surface_frame(foot.node[j], cloth_vertices_, faces_row_.data(), faces_of_.data(), position.data(), axis);
    for (int k = 0; k < 3; ++k) foot.offset[3 * j + k] = ddot(off, axis[k]);
  }
  return {foot, release, driven};
}

PrescribedMotion::Attached PrescribedMotion::attached_to(int vertex, int obstacle, const std::vector<dvec3> &position,
                                                         double release, bool driven)
{
  kernels::attachment best{};
  best.vertex = vertex;
  double smallest = std::numeric_limits<double>::infinity();
  const int first = obstacle_first_[obstacle];
  for (const Triangle &f : scene_obstacles_[static_cast<std::size_t>(obstacle)].mesh.face) {
    const kernels::proximity p = kernels::vertex_face_proximity(position[vertex], position[first + f[0]],
                                                                position[first + f[1]], position[first + f[2]]);
    if (p.distance >= smallest) continue;
    smallest = p.distance;
    for (int k = 0; k < 3; ++k) {
      best.node[k] = first + f[k];
      best.weight[k] = -p.weight[k + 1];
    }
  }
  return attached_at(best, position, release, driven);
}

void PrescribedMotion::upload_attachments()
{
  std::vector<kernels::attachment> rows;
  for (const Attached &a : attached_) rows.push_back(a.row);
  if (!rows.empty() && faces_row_stream_.size() == 0) {
    faces_of_stream_.assign(faces_of_);
    faces_row_stream_.assign(faces_row_);   // last: it says that both are there
  }
  if (!rows.empty() || attachments_.size()) attachments_.assign(rows);
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
  const std::size_t before = attached_.size();
  attached_.erase(std::remove_if(attached_.begin(), attached_.end(),
                                 [&](const Attached &a) {
                                   const bool gone = of(a.row.vertex);
                                   if (gone && !a.driven) freed_.insert(a.row.vertex);
                                   return gone;
                                 }),
                  attached_.end());
  if (attached_.size() != before) upload_attachments();
  driven_.erase(std::remove_if(driven_.begin(), driven_.end(), [&](const Driven &d) { return of(d.vertex); }),
                driven_.end());
}

void PrescribedMotion::release_due(const Rooms &state, double time)
{
  const auto due = [time](const auto &p) { return p.release <= time; };
  if (std::none_of(handles_.begin(), handles_.end(), due) && std::none_of(attached_.begin(), attached_.end(), due))
    return;
  std::vector<int> vertices;
  for (const Handle &h : handles_)
    if (due(h)) vertices.insert(vertices.end(), h.vertices.begin(), h.vertices.end());
  std::vector<kernels::attachment> kept;
  for (const Attached &a : attached_)
    if (due(a))
      vertices.push_back(a.row.vertex);
    else
      kept.push_back(a.row);
  hold(state, {}, vertices);
  // Nothing below allocates: either everything is done or, if memory ran out above, nothing.
  if (attachments_.size()) attachments_.assign(kept);
  released_ = time;
  handles_.erase(std::remove_if(handles_.begin(), handles_.end(), due), handles_.end());
  attached_.erase(std::remove_if(attached_.begin(), attached_.end(), due), attached_.end());
}

std::vector<int> PrescribedMotion::attached(int obstacle) const
{
  const auto o = static_cast<std::size_t>(obstacle);
  const int first = obstacle_first_[o], last = first + static_cast<int>(scene_obstacles_[o].mesh.position.size());
  std::vector<int> vertices;
  for (const Attached &a : attached_)
    if (a.row.node[0] >= first && a.row.node[0] < last) vertices.push_back(a.row.vertex);
  return vertices;
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
  for (int v : vertices)
    attached_.push_back(attached_to(v, obstacle, x, std::numeric_limits<double>::infinity(), true));
  upload_attachments();
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
  if (attachments_.size())
    CAMA_LAUNCH(*state.backend, move_attached, attachments_.size(), cloth_vertices_, attachments_, faces_row_stream_,
                faces_of_stream_, state.mesh.position_next);
}

void PrescribedMotion::save(State &, Checkpoint &checkpoint)
{
  checkpoint.released = released_;
  const auto table = [&](const char *name, std::vector<double> values) {
    if (!values.empty()) checkpoint.driving[name] = std::move(values);
  };
  std::vector<double> pins, attached, poses;
  for (const Driven &d : driven_) {
    pins.push_back(d.vertex);
    put(pins, d.from);
    put(pins, d.to);
    pins.insert(pins.end(), {d.start, d.end});
  }
  for (const Attached &a : attached_) {
    if (!a.driven) continue;
    attached.push_back(a.row.vertex);
    for (int k = 0; k < 3; ++k) attached.push_back(a.row.node[k]);
    for (int k = 0; k < 3; ++k) attached.push_back(a.row.weight[k]);
    for (double offset : a.row.offset) attached.push_back(offset);
  }
  for (const MovingObstacle &o : obstacles_) {
    if (!o.driven) continue;
    for (const Motion::Key &key : o.motion.keys) {
      poses.insert(poses.end(), {static_cast<double>(o.index), key.time});
      put(poses, key.transform.translation);
      poses.insert(poses.end(), key.transform.rotation.begin(), key.transform.rotation.end());
      poses.push_back(key.transform.scale);
    }
    if (!o.motion.sampled || o.motion.sampled == scene_obstacles_[o.index].motion.sampled) continue;
    std::vector<double> frames(o.motion.sampled->time);
    for (const auto &frame : o.motion.sampled->position)
      for (const dvec3 &x : frame) put(frames, x);
    table(("vertices." + std::to_string(o.index)).c_str(), std::move(frames));
  }
  table("freed", std::vector<double>(freed_.begin(), freed_.end()));
  table("pins", std::move(pins));
  table("attachments", std::move(attached));
  table("poses", std::move(poses));
}

void PrescribedMotion::restore(State &s, const Checkpoint &checkpoint)
{
  const Rooms state(s);
  const auto table = [&](const std::string &name) {
    const auto at = checkpoint.driving.find(name);
    return at == checkpoint.driving.end() ? std::vector<double>() : at->second;
  };
  std::vector<int> fixed_now, driven;
  for (const Driven &d : driven_) driven.push_back(d.vertex);
  for (const Attached &a : attached_)
    if (a.driven) driven.push_back(a.row.vertex);
  release(state, driven);
  set_up();
  released_ = -std::numeric_limits<double>::infinity();
  for (const Handle &h : handles_) fixed_now.insert(fixed_now.end(), h.vertices.begin(), h.vertices.end());
  for (const Attached &a : attached_) fixed_now.push_back(a.row.vertex);
  hold(state, fixed_now, {});
  release_due(state, checkpoint.released);
  std::vector<int> freed;
  for (double v : table("freed")) freed.push_back(static_cast<int>(v));
  release(state, freed);
  freed_.insert(freed.begin(), freed.end());
  fixed_now.clear();
  const std::vector<double> pins = table("pins"), poses = table("poses");
  for (std::size_t i = 0; i + pin_row <= pins.size(); i += pin_row) {
    const double *row = pins.data() + i;
    driven_.push_back({static_cast<int>(row[0]), get(row + 1), get(row + 4), row[7], row[8]});
    fixed_now.push_back(driven_.back().vertex);
  }
  const auto attach_again = [&](const std::string &name, std::size_t width) {
    const std::vector<double> rows = table(name);
    for (const double *row = rows.data(), *end = row + rows.size(); row != end; row += width) {
      kernels::attachment a{};
      a.vertex = static_cast<int>(row[0]);
      for (int k = 0; k < 3; ++k) {
        a.node[k] = static_cast<int>(row[1 + k]);
        a.weight[k] = row[4 + k];
      }
      attached_.push_back(
          attached_at(a, checkpoint.vectors.at("position"), std::numeric_limits<double>::infinity(), true));
      if (width == attachment_row) std::copy(row + 7, row + width, attached_.back().row.offset);
      fixed_now.push_back(a.vertex);
    }
  };
  attach_again("attachments", attachment_row);
  attach_again("attached", earlier_attachment_row);  // whose offsets are in the frame of the triangle
  upload_attachments();
  hold(state, fixed_now, {});
  for (MovingObstacle &o : obstacles_) {
    o.motion = scene_obstacles_[o.index].motion;
    o.driven = false;
    o.frame_a = o.frame_b = -1;
  }
  for (std::size_t i = 0; i + pose_row <= poses.size(); i += pose_row) {
    const double *row = poses.data() + i;
    MovingObstacle &o = moving(state, static_cast<int>(row[0]));
    if (!o.driven) {
      Motion motion;
      motion.sampled = o.motion.sampled;
      o.motion = motion;
      o.driven = true;
    }
    RigidTransform t;
    t.translation = get(row + 2);
    t.rotation = {row[5], row[6], row[7], row[8]};
    t.scale = row[9];
    o.motion.keys.push_back({row[1], t});
  }
  for (std::size_t i = 0; i < scene_obstacles_.size(); ++i) {
    const std::vector<double> frames = table("vertices." + std::to_string(i));
    if (frames.empty()) continue;
    MovingObstacle &o = moving(state, static_cast<int>(i));
    auto sampled = std::make_shared<Motion::Sampled>();
    sampled->time = {frames[0], frames[1]};
    for (int frame = 0; frame < 2; ++frame) {
      std::vector<dvec3> x;
      for (int v = 0; v < o.count; ++v)
        x.push_back(get(frames.data() + 2 + 3 * (static_cast<std::size_t>(frame) * o.count + v)));
      sampled->position.push_back(std::move(x));
    }
    if (!o.driven) o.motion = Motion{};
    o.motion.sampled = sampled;
    o.driven = true;
  }
}

void PrescribedMotion::check(const Checkpoint &checkpoint) const
{
  const auto refuse = [](const std::string &name, const char *what) {
    throw SceneError("checkpoint: driving: " + name + ": " + what);
  };
  const auto index = [](double value, std::size_t count) {
    return value >= 0 && value < static_cast<double>(count) && value == std::floor(value);
  };
  const std::size_t cloth = static_cast<std::size_t>(cloth_vertices_);
  for (const auto &[name, values] : checkpoint.driving) {
    for (double value : values)
      if (!std::isfinite(value)) refuse(name, "has a value that is not finite");
    const std::size_t width = name == "pins"          ? pin_row
                              : name == "attachments" ? attachment_row
                              : name == "attached"    ? earlier_attachment_row
                              : name == "poses"       ? pose_row
                                                      : 1;
    if (values.size() % width) refuse(name, "ends within a row");
    for (std::size_t i = 0; i < values.size(); i += width) {
      const bool attachment = name == "attachments" || name == "attached";
      if ((name == "pins" || attachment || name == "freed") && !index(values[i], cloth))
        refuse(name, "has a vertex that is not there");
      if (attachment)
        for (int k = 1; k < 4; ++k)
          if (!index(values[i + k], start_.size()) || values[i + k] < cloth_vertices_)
            refuse(name, "has a vertex that is not of an obstacle");
      if (name == "poses" && !index(values[i], scene_obstacles_.size()))
        refuse(name, "has an obstacle that is not there");
    }
    if (name.rfind("vertices.", 0) == 0) {
      const std::string number = name.substr(9);
      std::size_t o = scene_obstacles_.size();
      for (std::size_t k = 0; k < scene_obstacles_.size(); ++k)
        if (std::to_string(k) == number) o = k;
      if (o == scene_obstacles_.size() || values.size() != 2 + 6 * scene_obstacles_[o].mesh.position.size())
        refuse(name, "does not fit an obstacle");
    } else if (width == 1 && name != "freed" && name != "force" && name != "gravity" && name != "wind" &&
               name != "pressure" && name != "gas") {
      refuse(name, "is not known");
    }
  }
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
