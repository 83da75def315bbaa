// SPDX-License-Identifier: Apache-2.0
#include "run/step.hpp"

#include <algorithm>
#include <optional>

#include "cama/error.hpp"

namespace cama {
namespace {

constexpr int max_divisions = 4;   // of a step that fails: down to 1/16

/// What a step that threw comes back to.
struct Start {
  explicit Start(const State &s) : position(s.position.buffer()), time(s.time), history(s.history), report(s.report) {}
  Buffer position;
  double time;
  bool history;
  StepReport report;
};

/// Back to the start of a step that threw: positions, velocities, time and report as they were, no contacts, no
/// candidates.
void undo_step(State &s, const Start &start) noexcept
{
  if (s.position.buffer() != start.position) {   // the step had been taken
    if (s.position_before.backend()) {
      s.position_next.swap(s.position_before);
      s.velocity_next.swap(s.velocity_before);
    }
    s.position.swap(s.position_next);
    s.velocity.swap(s.velocity_next);
  }
  s.exemptions.restore();
  s.forget_contacts();
  s.time = start.time;
  s.history = start.history;
  s.report = start.report;
}

/// Adds what a piece of a step did to what those before it did; what is of a moment stays that of the last piece.
void add_piece(StepReport &sum, const StepReport &piece)
{
  StepReport r = piece;
  r.retries = sum.retries;
  r.searches += sum.searches;
  r.impacts += sum.impacts;
  r.impact_passes += sum.impact_passes;
  r.truncated += sum.truncated;
  r.lost_motion += sum.lost_motion;
  r.released += sum.released;
  r.substeps += sum.substeps;
  r.iterations += sum.iterations;
  r.newton_iterations += sum.newton_iterations;
  r.newton_residual = std::max(r.newton_residual, sum.newton_residual);
  sum = r;
}

void run_pipeline(State &s, Pipeline &step, int number)
{
  if (s.options.integrator == Integrator::backward_euler) s.set_implicit_step(s.time_step);  // else extrapolation does
  s.exemptions.begin_step();
  s.report = StepReport{};
  s.report.step = number;
  step.timed_run(s);
}

/// A step whose whole has failed, in pieces. Each begins without a history.
class DividedStep {
public:
  DividedStep(State &state, Pipeline &step)
      : state_(state), step_(step), whole_(state.time_step), start_(state.time), exempt_(state.exemptions.kept()),
        position_(*state.backend), velocity_(*state.backend)
  {
    position_.copy_from(state.position);
    velocity_.copy_from(state.velocity);
  }
  ~DividedStep() { state_.time_step = whole_; }
  double whole() const { return whole_; }

  void run(int number, const std::string &problem)
  {
    sum_.substeps = sum_.newton_iterations = 0;
    sum_.retries = 1;
    advance(1, 0, number, problem);
    advance(1, 1, number, problem);
    state_.history = false;
    state_.report = sum_;
  }
  void undo() noexcept
  {
    try {
      state_.position.copy_from(position_);
      state_.velocity.copy_from(velocity_);
    } catch (const Error &) {  // a device that is lost
    }
    state_.exemptions.keep(exempt_);
    state_.history = false;
  }

private:
  /// Piece `index` of 2^division.
  void advance(int division, int index, int number, const std::string &problem)
  {
    const double step = whole_ / (1 << division);
    state_.time = start_ + index * step;
    state_.time_step = step;
    state_.history = false;
    const Start start(state_);
    try {
      run_pipeline(state_, step_, number);
      return add_piece(sum_, state_.report);
    } catch (const SolverError &) {
      undo_step(state_, start);
    }
    ++sum_.retries;
    if (division == max_divisions)
      throw SolverError(problem + "; pieces of this step down to 1/" + std::to_string(1 << max_divisions) +
                        " of it failed too");
    advance(division + 1, 2 * index, number, problem);
    advance(division + 1, 2 * index + 1, number, problem);
  }

  State &state_;
  Pipeline &step_;
  double whole_, start_;
  Exemptions::Kept exempt_;
  Stream<dvec3> position_, velocity_;
  StepReport sum_;
};

}  // namespace

void take_step(State &s, Pipeline &step, const std::function<void()> &finish)
{
  const int number = s.report.step + 1;
  Start start(s);
  std::optional<DividedStep> divided;
  try {
    std::string problem;
    try {
      run_pipeline(s, step, number);
    } catch (const SolverError &e) {
      problem = e.what();
      undo_step(s, start);
    }
    if (!problem.empty()) {
      divided.emplace(s, step);
      divided->run(number, problem);
      s.time_step = divided->whole();
    }
    s.time = s.start_time + (number - s.start_step) * s.time_step;
    s.report.time = s.time;
    finish();
  } catch (...) {
    if (divided) {
      divided->undo();
      start.position = s.position.buffer();
      start.history = false;
    }
    undo_step(s, start);
    throw;
  }
}

}  // namespace cama
