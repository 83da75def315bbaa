// SPDX-License-Identifier: Apache-2.0
// The engine of a simulation with a flat list of its stages, which can run a step stage by stage.
#pragma once
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "cama/simulation.hpp"
#include "precision.hpp"
#include "run/engine.hpp"

/// Options for one thread.
inline cama::Options serial(cama::Accuracy level = cama::Accuracy::production)
{
  cama::Options options = cama::Options::at(level);
  options.threads = 1;
  return options;
}

class StagedEngine : public cama::Engine {
public:
  /// Accepts starts with intersections.
  explicit StagedEngine(const cama::Scene &scene, const cama::Options &options = serial())
      : StagedEngine(scene, options, cama::make_backend(options.backend, options.device, options.threads))
  {}
  StagedEngine(const cama::Scene &scene, const cama::Options &options, std::unique_ptr<cama::Backend> device)
      : cama::Engine(scene, cama::resolve(options, scene), std::move(device), start_of(scene))
  {
    collect(*pipeline);
  }

  /// The stages that do the work, in order.
  const std::vector<cama::Stage *> &leaves() const { return leaves_; }
  cama::Stage *find(const std::string &name) const
  {
    for (cama::Stage *stage : leaves_)
      if (stage->name() == name) return stage;
    return nullptr;
  }

  void begin_step()
  {
    const int number = state.report.step + 1;
    state.report = cama::StepReport{};
    state.report.step = number;
  }
  void end_step() { state.time.now = state.report.step * state.time.step; }
  void step()
  {
    begin_step();
    for (cama::Stage *stage : leaves_) stage->run(state);
    end_step();
  }
  /// Runs the step's stages before the one with this name.
  void run_before(const std::string &name)
  {
    begin_step();
    for (cama::Stage *stage : leaves_) {
      if (stage->name() == name) return;
      stage->run(state);
    }
  }
  bool has_stream(const std::string &name)
  {
    bool found = false;
    state.visit_streams(
        [&](const char *stream_name, auto &stream) { found |= name == stream_name && stream.backend() != nullptr; });
    return found;
  }

private:
  static Start start_of(const cama::Scene &scene)
  {
    scene.validate();
    return {cama::build_topology(scene), {}};
  }
  void collect(cama::Stage &stage)
  {
    if (stage.children().empty()) leaves_.push_back(&stage);
    for (const auto &child : stage.children()) collect(*child);
  }
  std::vector<cama::Stage *> leaves_;
};
