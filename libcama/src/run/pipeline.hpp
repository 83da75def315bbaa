// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <chrono>
#include <cstdlib>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "cama/checkpoint.hpp"
#include "model/state.hpp"

namespace cama {

/// One box of the paper's Figure 3: enqueues work on the state's streams, owns only scratch.
class Stage {
public:
  virtual ~Stage() = default;
  virtual std::string_view name() const = 0;
  virtual std::string reason() const { return "always"; }   ///< why this scene has it
  virtual void run(State &state) = 0;
  virtual const std::vector<std::unique_ptr<Stage>> &children() const
  {
    static const std::vector<std::unique_ptr<Stage>> none;
    return none;
  }
  /// What it carries from one step to the next.
  virtual void save(State &state, Checkpoint &checkpoint)
  {
    for (auto &stage : children()) stage->save(state, checkpoint);
  }
  virtual void restore(State &state, const Checkpoint &checkpoint)
  {
    for (auto &stage : children()) stage->restore(state, checkpoint);
  }
  double milliseconds() const { return milliseconds_; }     ///< of the last run

  /// With the environment variable CAMA_WAIT_FOR_STAGES set, waits for the device, so that times are of work and not of
  /// enqueueing it.
  void timed_run(State &state)
  {
    const auto start = std::chrono::steady_clock::now();
    run(state);
    if (std::getenv("CAMA_WAIT_FOR_STAGES")) state.backend->synchronize();
    milliseconds_ = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  }

private:
  double milliseconds_ = 0;
};

/// Stages in order; itself a stage, so pipelines nest.
class Pipeline : public Stage {
public:
  explicit Pipeline(std::string name, std::string reason = "always")
      : name_(std::move(name)), reason_(std::move(reason))
  {}
  std::string_view name() const override { return name_; }
  std::string reason() const override { return reason_; }
  const std::vector<std::unique_ptr<Stage>> &children() const override { return stages_; }

  template <class S, class... A> S &add(A &&...arguments)
  {
    auto stage = std::make_unique<S>(std::forward<A>(arguments)...);
    S &reference = *stage;
    stages_.push_back(std::move(stage));
    return reference;
  }
  void run(State &state) override
  {
    for (auto &stage : stages_) {
      stage->timed_run(state);
    }
  }

private:
  std::string name_, reason_;
  std::vector<std::unique_ptr<Stage>> stages_;
};

}  // namespace cama
