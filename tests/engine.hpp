// SPDX-License-Identifier: Apache-2.0
// What Simulation hides, opened: the state, the stages, and one step in pieces.
#pragma once
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "model/setup.hpp"
#include "run/pipeline_factory.hpp"

/// One thread.
inline cama::Options serial(const std::string &accuracy = "production")
{
  cama::Options options = cama::Options::preset(accuracy);
  options.threads = 1;
  return options;
}

class Engine {
public:
  explicit Engine(const cama::Scene &scene, const cama::Options &options = serial())
      : Engine(scene, options, cama::make_backend(options.backend, options.device, options.threads))
  {}
  Engine(const cama::Scene &scene, const cama::Options &options, std::unique_ptr<cama::Backend> device)
      : backend(std::move(device)), state(*backend), topology(cama::build_topology(scene))
  {
    scene.validate();
    state.options = options;
    if (options.precision == "single") {
      cama::set_up<float>(state, scene, topology);
      pipeline = cama::make_pipeline<float>(scene, state);
    } else {
      cama::set_up<double>(state, scene, topology);
      pipeline = cama::make_pipeline<double>(scene, state);
    }
    collect(*pipeline.step);
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
  void end_step() { state.time = state.report.step * state.time_step; }
  void step()
  {
    begin_step();
    for (cama::Stage *stage : leaves_) stage->run(state);
    end_step();
  }
  /// Runs the step's stages before the one of this name.
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
    state.visit(
        [&](const char *stream_name, auto &stream) { found |= name == stream_name && stream.backend() != nullptr; });
    return found;
  }

  std::unique_ptr<cama::Backend> backend;
  cama::State state;
  cama::Topology topology;
  cama::StepPipeline pipeline;

private:
  void collect(cama::Stage &stage)
  {
    if (stage.children().empty()) leaves_.push_back(&stage);
    for (const auto &child : stage.children()) collect(*child);
  }
  std::vector<cama::Stage *> leaves_;
};
