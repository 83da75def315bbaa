// SPDX-License-Identifier: Apache-2.0
// Backend, state and stages of one scene, which Simulation hides and tests inspect.
#pragma once
#include <functional>
#include <memory>

#include "cama/backend.hpp"
#include "cama/untangle.hpp"
#include "model/topology.hpp"
#include "run/pipeline.hpp"

namespace cama {

class Engine {
public:
  /// Validates the scene; throws before any kernel runs.
  Engine(const Scene &scene, const ResolvedOptions &options);
  /// What the constructor above makes besides the backend: topology and start of the scene.
  struct Start {
    Topology topology;
    UntangleReport untangled;
  };
  Engine(const Scene &scene, const ResolvedOptions &options, std::unique_ptr<Backend> device, Start start);

  const int threads;                    // CPU threads, of the CPU backend and of audits
  std::unique_ptr<Backend> backend;
  State state;
  Topology topology;
  UntangleReport untangled;
  std::vector<ChosenOption> chosen;
  bool guarded = false;                 // the state must be free of intersections
  std::unique_ptr<Pipeline> pipeline;

  /// Takes one time step; see take_step. finished: called when the step is complete, before it is accepted.
  void take(const std::function<void()> &finished);

private:
  Engine(const Scene &scene, const ResolvedOptions &options, std::unique_ptr<Backend> device);
};

}  // namespace cama
