// SPDX-License-Identifier: Apache-2.0
#include "run/step.hpp"

#include <cmath>
#include <exception>
#include <optional>

#include "cama/error.hpp"
#include "run/step_control.hpp"

namespace cama {
namespace {

/// The numbers that the state keeps from step to step, in the order of State::visit.
std::vector<double> carried(State &s)
{
  std::vector<double> numbers;
  s.visit([&](const char *, Life life, auto &value) {
    if constexpr (!IsStream<std::decay_t<decltype(value)>>::value)
      if (life == Life::run) numbers.push_back(static_cast<double>(value));
  });
  return numbers;
}

void put_back(State &s, const std::vector<double> &numbers) noexcept
{
  std::size_t next = 0;
  s.visit([&](const char *, Life life, auto &value) {
    using T = std::decay_t<decltype(value)>;
    if constexpr (!IsStream<T>::value)
      if (life == Life::run) value = static_cast<T>(numbers[next++]);
  });
}

/// The state that a step which threw returns to.
struct Start {
  explicit Start(State &s) : position(s.mesh.position.buffer()), numbers(carried(s)), report(s.report) {}
  Buffer position;
  std::vector<double> numbers;
  StepReport report;
};

/// Returns to the start of a step that threw: restores positions, velocities, kept numbers and the report, and removes
/// contacts and candidates.
void undo_step(State &s, const Start &start) noexcept
{
  MeshState &mesh = s.mesh;
  if (mesh.position.buffer() != start.position) {   // the step was complete: buffers had been swapped
    if (mesh.position_before.backend()) {
      mesh.position_before.swap(mesh.position_base);
      mesh.velocity_before.swap(mesh.velocity_base);
    }
    mesh.position.swap(mesh.position_next);
    mesh.velocity.swap(mesh.velocity_next);
    s.contact.kept.swap(s.contact.kept_next);
    s.elements.plastic_curvature.swap(s.elements.plastic_curvature_next);
  }
  s.exemptions.restore();
  s.contact.forget();
  put_back(s, start.numbers);
  s.report = start.report;
}

void run_pipeline(State &s, Pipeline &step, int number)
{
  if (s.options.integrator == Integrator::backward_euler) {   // with BDF2 extrapolation scales them
    s.time.implicit_step = s.time.step;
    s.system.scale_materials(s.time.step, s.elements.damping);
  }
  s.exemptions.begin_step();
  s.report = StepReport{};
  s.report.step = number;
  step.timed_run(s);
}

/// What a step threw, if a shorter one may do better; nothing if it was done.
std::exception_ptr failure_of(State &s, Pipeline &step, int number)
{
  try {
    run_pipeline(s, step, number);
  } catch (const SolverError &) {
    return std::current_exception();
  } catch (const ListOverflow &) {
    return std::current_exception();
  }
  return nullptr;
}

[[noreturn]] void give_up(const std::exception_ptr &failure, int divisions)
{
  if (divisions == 0) std::rethrow_exception(failure);
  const std::string pieces =
      "; pieces of this step, down to 1/2^" + std::to_string(divisions) + " of it, failed as well";
  try {
    std::rethrow_exception(failure);
  } catch (const ListOverflow &e) {
    throw MemoryError(e.what() + pieces);
  } catch (const SolverError &e) {
    throw SolverError(e.what() + pieces);
  }
}

/// A step that failed as a whole, taken in pieces. Each begins without a history.
class DividedStep {
public:
  DividedStep(State &state, Pipeline &step)
      : state_(state), step_(step), whole_(state.time.step), start_(state.time.now), exempt_(state.exemptions.kept()),
        position_(*state.backend), velocity_(*state.backend), plastic_(*state.backend)
  {
    position_.copy_from(state.mesh.position);
    velocity_.copy_from(state.mesh.velocity);
    kept_.copy_from(state.contact.kept);
    if (state.elements.plastic_curvature.backend()) plastic_.copy_from(state.elements.plastic_curvature);
  }
  ~DividedStep()
  {
    state_.time.step = whole_;
    state_.time.division = 0;
  }
  double whole() const { return whole_; }

  /// failure: of the whole step.
  void run(int number, const std::exception_ptr &failure)
  {
    sum_.substeps = sum_.newton_iterations = 0;
    sum_.retries = 1;
    advance(1, 0, number, failure);
    advance(1, 1, number, failure);
    state_.time.history = false;
    state_.report = sum_;
  }
  void undo() noexcept
  {
    try {
      state_.mesh.position.copy_from(position_);
      state_.mesh.velocity.copy_from(velocity_);
      state_.contact.kept.copy_from(kept_);
      if (state_.elements.plastic_curvature.backend()) state_.elements.plastic_curvature.copy_from(plastic_);
    } catch (const Error &) {  // the device is lost
    }
    state_.exemptions.keep(exempt_);
    state_.time.history = false;
  }

private:
  /// Piece `index` of 2^division.
  void advance(int division, int index, int number, const std::exception_ptr &failure)
  {
    const double step = std::ldexp(whole_, -division);
    state_.time.now = start_ + index * step;
    state_.time.step = step;
    state_.time.division = division;
    state_.time.history = false;
    const Start start(state_);
    if (!failure_of(state_, step_, number)) return sum_.add(state_.report);
    undo_step(state_, start);
    ++sum_.retries;
    if (division == state_.options.max_divisions) give_up(failure, division);
    advance(division + 1, 2 * index, number, failure);
    advance(division + 1, 2 * index + 1, number, failure);
  }

  State &state_;
  Pipeline &step_;
  double whole_, start_;
  Exemptions::Kept exempt_;
  Stream<dvec3> position_, velocity_, plastic_;
  KeptFriction kept_;
  StepReport sum_;
};

}  // namespace

void take_step(State &s, Pipeline &step, const std::function<void()> &finish)
{
  const int number = s.report.step + 1;
  Start start(s);
  std::optional<DividedStep> divided;
  int rejected = 0;
  try {
    std::exception_ptr failure;
    for (bool again = true; again;) {
      again = false;
      s.reactions.begin_step();
      choose_step(s.time);
      failure = failure_of(s, step, number);
      if (failure)
        undo_step(s, start);
      else
        again = !judge_step(s.time);
      if (!again) continue;
      const double wanted = s.time.wanted, max_by_stretch = s.time.max_by_stretch;
      undo_step(s, start);
      s.time.wanted = wanted;
      s.time.max_by_stretch = max_by_stretch;
      ++rejected;
    }
    if (failure) {
      if (s.options.max_divisions == 0) give_up(failure, 0);
      divided.emplace(s, step);
      divided->run(number, failure);
      s.time.step = divided->whole();
      s.time.wanted = s.time.step / 2;
    }
    s.backend->hand_over();  // so that nothing of this step fails in the next
    if (s.time.error > 0) {
      s.time.now = s.time.start = s.time.end;
      s.time.start_step = number;
    } else {
      s.time.now = s.time.start + (number - s.time.start_step) * s.time.step;
    }
    s.report.time = s.time.now;
    s.report.time_step = s.time.step;
    s.report.rejected = rejected;
    s.report.over_error = !failure && over_error(s.time);
    s.reactions.accept_step(s.time.step);
    finish();
  } catch (...) {
    if (divided) {
      divided->undo();
      start.position = s.mesh.position.buffer();
    }
    undo_step(s, start);
    if (divided) s.time.history = false;
    throw;
  }
}

}  // namespace cama
