// SPDX-License-Identifier: Apache-2.0
// Backend, state and stages of one scene, which Simulation hides and tests inspect.
#pragma once
#include <array>
#include <functional>
#include <memory>
#include <vector>

#include "cama/backend.hpp"
#include "cama/untangle.hpp"
#include "device/loans.hpp"
#include "model/topology.hpp"
#include "run/pipeline.hpp"
#include "stages/prescribed_motion.hpp"

namespace cama {

class Engine {
public:
  /// Validates the scene; throws before any kernel runs.
  Engine(const Scene &scene, const ResolvedOptions &options);
  /// On this device; null: that of the options.
  Engine(const Scene &scene, const ResolvedOptions &options, std::unique_ptr<Backend> device);
  /// What the constructors above make besides the backend: topology and start of the scene.
  struct Start {
    Topology topology;
    UntangleReport untangled;
  };
  Engine(const Scene &scene, const ResolvedOptions &options, std::unique_ptr<Backend> device, Start start);
  Engine(Engine &&) = default;
  ~Engine();

  const int threads;                    // CPU threads, of the CPU backend and of audits
  std::shared_ptr<Backend> backend;     // shared with borrowers of memory
  OpenLoans loans;
  State state;
  Topology topology;
  UntangleReport untangled;
  std::vector<ChosenOption> chosen;
  bool guarded = false;                 // the state must be free of intersections
  std::unique_ptr<Pipeline> pipeline;

  /// Takes one time step; see take_step. finished: called when the step is complete, before it is accepted.
  void take(const std::function<void()> &finished);

  // Driving, between steps; see Simulation. They throw SceneError and change nothing where the arguments do not fit.
  void pin(const std::vector<int> &vertices, const std::vector<dvec3> &targets, double duration);
  void set_targets(const std::vector<int> &vertices, const std::vector<dvec3> &targets, double duration);
  void release(const std::vector<int> &vertices);
  void attach(const std::vector<int> &vertices, int obstacle);
  void set_obstacle_pose(int obstacle, const dvec3 &translation, const std::array<double, 4> &rotation,
                         double duration);
  void set_obstacle_vertices(int obstacle, const std::vector<dvec3> &positions, double duration);
  void set_force(const std::vector<int> &vertices, const std::vector<dvec3> &forces);
  void set_force(const std::vector<int> &vertices, const DeviceVectors &forces);
  void set_gravity(const dvec3 &gravity);
  void set_wind(const dvec3 &velocity);
  void set_pressure(int cloth, double pressure);
  void set_gas(int cloth, double amount, double ambient);
  // What they check first. No targets: vertices are held where they are.
  void check_pin(const std::vector<int> &vertices, const std::vector<dvec3> &targets, double duration) const;
  void check_targets(const std::vector<int> &vertices, const std::vector<dvec3> &targets, double duration) const;
  void check_vertices(const char *what, const std::vector<int> &vertices) const;
  void check_pose(int obstacle, const dvec3 &translation, const std::array<double, 4> &rotation, double duration) const;
  void check_force(const std::vector<int> &vertices, const std::vector<dvec3> &forces) const;
  void check_gravity(const dvec3 &gravity) const;
  void check_wind(const dvec3 &velocity) const;
  std::vector<double> pressures() const;
  /// Throws SceneError if the obstacle is not rigid.
  const RigidBody &rigid_body(const char *what, int obstacle) const;
  /// What has been driven, for a checkpoint, and back; check_driving throws SceneError and changes nothing.
  void save_driving(Checkpoint &checkpoint);
  void check_driving(const Checkpoint &checkpoint);
  void restore_driving(const Checkpoint &checkpoint);

  /// Before positions or velocities change: who has borrowed them keeps them as they are.
  void before_writing() { loans->before_writing({&state.mesh.position, &state.mesh.velocity}); }
  /// The vectors in double precision; count: their number. Throws SceneError.
  Stream<dvec3> received(const char *what, const DeviceVectors &vectors, int count);

private:
  /// The stage of prescribed motion, put into the pipeline if it is not there.
  PrescribedMotion &driver();
  const PrescribedMotion &motion() const { return idle_motion_ ? *idle_motion_ : *motion_; }
  double duration_of(const char *what, double duration) const;
  void check_obstacle(const char *what, int obstacle) const;
  /// Throws SceneError for an obstacle that is rigid, which nothing but forces moves.
  void check_driven(const char *what, int obstacle) const;

  std::unique_ptr<PrescribedMotion> idle_motion_;   // until something is driven in a scene without motion
  PrescribedMotion *motion_ = nullptr;              // the stage of the pipeline
  int gas_index(int cloth) const;  // -1: it has none
  void assign_pressures(const std::vector<double> &pressures);
  dvec3 scene_gravity_, scene_wind_{0, 0, 0};
  std::vector<double> scene_pressure_;  // [cloths]
  std::vector<kernels::gas> gas_, scene_gas_;  // as now, and as the scene has them
  std::vector<ObstacleShape> shape_;                // [obstacles]
};

}  // namespace cama
