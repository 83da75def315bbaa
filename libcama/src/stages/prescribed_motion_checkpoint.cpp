// SPDX-License-Identifier: Apache-2.0
// What prescribed motion keeps in a checkpoint: tables of what a driver has set.
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <string>

#include "cama/error.hpp"
#include "stages/prescribed_motion.hpp"

namespace cama {
namespace {

// numbers in a row of the tables of a checkpoint
constexpr std::size_t pin_row = 9, attachment_row = 16, earlier_attachment_row = 10, pose_row = 10;

void put(std::vector<double> &row, const dvec3 &v) { row.insert(row.end(), {v.x, v.y, v.z}); }
dvec3 get(const double *row) { return {row[0], row[1], row[2]}; }

}  // namespace

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
  for (const Attachments::Attached &a : attached_.list) {
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
  for (const Attachments::Attached &a : attached_.list)
    if (a.driven) driven.push_back(a.row.vertex);
  release(state, driven);
  set_up();
  released_ = -std::numeric_limits<double>::infinity();
  for (const Handle &h : handles_) fixed_now.insert(fixed_now.end(), h.vertices.begin(), h.vertices.end());
  for (const Attachments::Attached &a : attached_.list) fixed_now.push_back(a.row.vertex);
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
      attached_.add(a, checkpoint.vectors.at("position"), std::numeric_limits<double>::infinity(), true);
      if (width == attachment_row) std::copy(row + 7, row + width, attached_.list.back().row.offset);
      fixed_now.push_back(a.vertex);
    }
  };
  attach_again("attachments", attachment_row);
  attach_again("attached", earlier_attachment_row);  // whose offsets are in the frame of the triangle
  attached_.upload();
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

}  // namespace cama
