// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <limits>

#include "run/pipeline.hpp"

namespace cama {

/// Moves obstacles, pins and attachments to their positions at the end of the step.
class PrescribedMotion final : public StageOn<const Clock, MeshState, const SystemState> {
public:
  PrescribedMotion(const Scene &scene, Backend &backend);
  std::string_view name() const override { return "prescribed motion"; }
  std::string reason() const override { return "pins or moving obstacles"; }
  void run_on(const Rooms &state) override;
  void save(State &state, Checkpoint &checkpoint) override;
  void restore(State &state, const Checkpoint &checkpoint) override;

  /// Writes the positions at a time to state.mesh.position_next; also used for the start of the simulation.
  void place(const Rooms &state, double time);

private:
  struct MovingObstacle {
    Motion motion;
    int first, count;
    int frame_a = -1, frame_b = -1;
    Stream<dvec3> a, b;
  };
  struct Handle {
    Motion motion;
    std::vector<int> vertices;
    std::vector<dvec3> rest;
    double release;
    bool released = false;
  };
  struct Attached {
    std::vector<int> vertices;
    double release;
    bool released = false;
  };

  void release_due(const Rooms &state, double time);

  std::vector<MovingObstacle> obstacles_;
  std::vector<Handle> handles_;
  std::vector<Attached> attached_;
  double released_ = -std::numeric_limits<double>::infinity();   // pins that end by this time have been released, s
  double last_end_ = released_;                                  // latest end of the released pins, s
  Stream<dvec3> transform_, handle_position_;
  Stream<int> handle_vertex_;
  Stream<kernels::attachment> attachments_;
};

}  // namespace cama
