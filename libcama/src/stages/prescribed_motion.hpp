// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <limits>
#include <map>
#include <set>
#include <vector>

#include "run/pipeline.hpp"
#include "stages/attachments.hpp"

namespace cama {

/// Moves obstacles, pins and attachments to their positions at the end of the step: as the scene prescribes, as a
/// driver sets them between steps, and rigid bodies by their pose at the end of the step. What a driver sets is reached
/// after a duration, linearly in time (rotations along the shortest arc), and held. Vertices are numbered through all
/// cloths.
class PrescribedMotion final : public StageOn<const Clock, MeshState, const SystemState, const RigidState> {
public:
  PrescribedMotion(const Scene &scene, Backend &backend);
  std::string_view name() const override { return "prescribed motion"; }
  std::string reason() const override { return "pins or moving obstacles"; }
  void run_on(const Rooms &state) override;
  void save(State &state, Checkpoint &checkpoint) override;
  void restore(State &state, const Checkpoint &checkpoint) override;
  /// Throws SceneError if what the checkpoint drives is not in the scene.
  void check(const Checkpoint &checkpoint) const;

  /// Writes the positions at a time to state.mesh.position_next; also used for the start of the simulation.
  void place(const Rooms &state, double time);

  /// Takes the vertices from pins, attachments and the cloth, and moves them to the targets. duration: s.
  void pin(const Rooms &state, const std::vector<int> &vertices, const std::vector<dvec3> &targets, double duration);
  void release(const Rooms &state, const std::vector<int> &vertices);
  void attach(const Rooms &state, const std::vector<int> &vertices, int obstacle);
  /// Cloth vertices that are attached to an obstacle.
  std::vector<int> attached(int obstacle) const { return attached_.of(obstacle); }
  /// The motion of an obstacle; null: it has never moved.
  const Motion *motion_of(int obstacle) const;
  std::vector<char> pinned() const;  ///< [cloth vertices] 1: by `pin`
  /// target: of the obstacle's vertices as the scene has them before any motion; its scale stays.
  void move_obstacle(const Rooms &state, int obstacle, const RigidTransform &target, double duration);
  void move_obstacle(const Rooms &state, int obstacle, const std::vector<dvec3> &target, double duration);

private:
  struct MovingObstacle {
    int index;
    Motion motion;
    int first, count;
    bool driven = false;
    int frame_a = -1, frame_b = -1;
    Stream<dvec3> a, b;
  };
  struct Handle {
    Motion motion;
    std::vector<int> vertices;
    std::vector<dvec3> rest;
    double release;
  };
  struct Driven {
    int vertex;
    dvec3 from, to;
    double start, end;  // s
    dvec3 at(double time) const;
  };

  void set_up();
  template <class Of> void forget(Of &&of);
  void hold(const Rooms &state, const std::vector<int> &fixed_now, const std::vector<int> &free_now);
  void release_due(const Rooms &state, double time);
  MovingObstacle &moving(const Rooms &state, int obstacle);

  Backend &backend_;
  std::vector<Obstacle> scene_obstacles_;
  std::vector<Pin> pins_;
  std::vector<int> cloth_first_, obstacle_first_;
  std::vector<dvec3> start_;  // [vertices] of the cloths and of the obstacles at time 0
  int cloth_vertices_ = 0;

  std::vector<MovingObstacle> obstacles_;
  std::vector<Handle> handles_;
  Attachments attached_;
  std::vector<Driven> driven_;
  std::set<int> freed_;  // vertices that the scene pins and a driver has taken or released
  std::map<int, double> free_inverse_mass_;  // of vertices that are prescribed now, 1/kg
  double released_ = -std::numeric_limits<double>::infinity();  // pins that end by this time have been released, s
  Stream<dvec3> transform_, handle_position_;
  Stream<int> handle_vertex_;
};

}  // namespace cama
