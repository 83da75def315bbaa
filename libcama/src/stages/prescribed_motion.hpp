// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <limits>

#include "run/pipeline.hpp"

namespace cama {

/// Moves obstacles, pins and attachments to where they are at the end of the step.
class PrescribedMotion final : public Stage {
public:
  PrescribedMotion(const Scene &scene, State &state);
  std::string_view name() const override { return "prescribed motion"; }
  std::string reason() const override { return "pins, handles or moving obstacles"; }
  void run(State &state) override;
  void save(State &state, Checkpoint &checkpoint) override;
  void restore(State &state, const Checkpoint &checkpoint) override;

  /// Positions at a time, written to state.position_next; used for the start of the simulation too.
  void place(State &state, double time);

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

  void release_due(State &state, double time);

  std::vector<MovingObstacle> obstacles_;
  std::vector<Handle> handles_;
  std::vector<Attached> attached_;
  double released_ = -std::numeric_limits<double>::infinity();   // s; pins whose end is not later have let go
  double last_end_ = released_;                                  // s, of those that have
  Stream<dvec3> transform_, handle_position_;
  Stream<int> handle_vertex_;
  Stream<kernels::attachment> attachments_;
};

}  // namespace cama
