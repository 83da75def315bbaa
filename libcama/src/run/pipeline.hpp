// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <chrono>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "cama/checkpoint.hpp"
#include "model/access.hpp"

namespace cama {

/// One box of the paper's Figure 3: enqueues work on the state's streams and owns only scratch memory.
class Stage {
public:
  virtual ~Stage() = default;
  virtual std::string_view name() const = 0;
  virtual std::string reason() const { return "always"; }   ///< why the scene needs this stage
  virtual void run(State &state) = 0;
  virtual const std::vector<std::unique_ptr<Stage>> &children() const
  {
    static const std::vector<std::unique_ptr<Stage>> none;
    return none;
  }
  /// Saves what the stage keeps from one step to the next.
  virtual void save(State &state, Checkpoint &checkpoint)
  {
    for (auto &stage : children()) stage->save(state, checkpoint);
  }
  virtual void restore(State &state, const Checkpoint &checkpoint)
  {
    for (auto &stage : children()) stage->restore(state, checkpoint);
  }
  double milliseconds() const { return milliseconds_; }     ///< time of the last run

  void timed_run(State &state)
  {
    timed(state, [&] { run(state); });
  }
  /// Takes the time of work in place of `run`. With state.wait_for_stages it waits for the device, so that times
  /// measure work and not its enqueueing.
  template <class Work> void timed(State &state, Work &&work)
  {
    const auto start = std::chrono::steady_clock::now();
    work();
    if (state.wait_for_stages) state.backend->synchronize();
    milliseconds_ = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  }

private:
  double milliseconds_ = 0;
};

/// A stage that accesses only these rooms of the state, and only reads const ones.
template <class... R> class StageOn : public Stage {
public:
  using Rooms = Access<R...>;
  void run(State &state) final { run_on(state); }
  virtual void run_on(const Rooms &state) = 0;
};

/// Stages in order; a pipeline is a stage itself, so pipelines nest.
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
  /// Inserts a stage behind the one with this name, or at the end if there is none.
  void insert_after(std::string_view name, std::unique_ptr<Stage> stage)
  {
    auto at = stages_.begin();
    while (at != stages_.end() && (*at)->name() != name) ++at;
    stages_.insert(at == stages_.end() ? at : at + 1, std::move(stage));
  }
  void insert(std::size_t place, std::unique_ptr<Stage> stage)
  {
    stages_.insert(stages_.begin() + static_cast<std::ptrdiff_t>(place), std::move(stage));
  }
  void run(State &state) override
  {
    for (auto &stage : stages_) stage->timed_run(state);
  }

private:
  std::string name_, reason_;
  std::vector<std::unique_ptr<Stage>> stages_;
};

}  // namespace cama
