// SPDX-License-Identifier: Apache-2.0
#include "stages/rigid_bodies.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "cama/error.hpp"
#include "device/launch.hpp"

namespace cama {
namespace {

constexpr int run_length = 32;  // vertices that one sum is over
constexpr int long_run = 256;  // likewise, of all vertices
constexpr int max_solves = 12;  // of cloth in a step; one more where the last is not the best of them
constexpr double tolerance = 3e-4;  // of the impulse, in the norm of the kinetic energy that it gives
constexpr double least_share = 1e-6;  // of the momentum: smaller impulses do not matter
constexpr double solve_tolerance =
    3e-5;  // of the cloth's linear solves: what they leave looks like a force on the body
constexpr double too_far = 0.2;  // residual of a step that is divided

using kernels::dadd;
using kernels::daxpy;
using kernels::dcross;
using kernels::dscale;
using kernels::dsub;

/// Moves all bodies by their impulses; contacts: null without. step: its number.
void move_bodies(const BodyContacts::Rooms &state, BodyContacts *contacts, int step)
{
  try {
    if (contacts) return contacts->move(state);
    for (RigidBody &body : state.rigid.body) BodyContacts::move_alone(state, body);
  } catch (const SolverError &e) {
    throw SolverError("step " + std::to_string(step) + ": " + e.what());
  }
}

/// About the centre of mass at the start of the step.
BodyWrench about_center(const RigidBody &body, const BodyWrench &about_origin)
{
  return {about_origin.force, dsub(about_origin.torque, dcross(body.center, about_origin.force))};
}

BodyWrench carried(const RigidBody &body, double memory)
{
  return {dscale(memory, body.smooth.force), dscale(memory, body.smooth.torque)};
}

BodyWrench sum_of(const BodyWrench &a, const BodyWrench &b)
{
  return {dadd(a.force, b.force), dadd(a.torque, b.torque)};
}

using Matrix6 = std::array<std::array<double, 6>, 6>;
using Vector6 = std::array<double, 6>;

// Without Eigen, which fuses products and sums where the CPU can, so that the bits would depend on it.

/// Lower triangular factor of a positive definite matrix; reads the lower triangle.
Matrix6 cholesky(Matrix6 a)
{
  for (std::size_t j = 0; j < 6; ++j) {
    for (std::size_t k = 0; k < j; ++k) a[j][j] -= a[j][k] * a[j][k];
    a[j][j] = std::sqrt(a[j][j]);
    for (std::size_t i = j + 1; i < 6; ++i) {
      for (std::size_t k = 0; k < j; ++k) a[i][j] -= a[i][k] * a[j][k];
      a[i][j] /= a[j][j];
      a[j][i] = 0;
    }
  }
  return a;
}

Vector6 forward(const Matrix6 &lower, Vector6 b)
{
  for (std::size_t i = 0; i < 6; ++i) {
    for (std::size_t k = 0; k < i; ++k) b[i] -= lower[i][k] * b[k];
    b[i] /= lower[i][i];
  }
  return b;
}

Vector6 backward(const Matrix6 &lower, Vector6 b)
{
  for (std::size_t i = 6; i-- > 0;) {
    for (std::size_t k = i + 1; k < 6; ++k) b[i] -= lower[k][i] * b[k];
    b[i] /= lower[i][i];
  }
  return b;
}

Vector6 vector_of(const BodyWrench &w) { return {w.force.x, w.force.y, w.force.z, w.torque.x, w.torque.y, w.torque.z}; }

/// Lets the linear solves be more accurate while it lives.
class TighterSolves {
public:
  explicit TighterSolves(State &state) : tolerance_(state.options.tolerance), before_(tolerance_)
  {
    tolerance_ = std::min(tolerance_, solve_tolerance);
  }
  ~TighterSolves() { tolerance_ = before_; }

private:
  double &tolerance_;
  const double before_;
};

double norm(const std::vector<double> &x)
{
  double sum = 0;
  for (double value : x) sum += value * value;
  return std::sqrt(sum);
}

/// The state at the end of the step, after the cloth's impulse `whole`, of which BDF2 carries `smooth` on. stopped:
/// abruptly.
void advance(double step, const dvec3 &gravity, RigidBody &body, const BodyWrench &whole, const BodyWrench &smooth,
             bool stopped)
{
  const dvec3 fall = dscale(step, gravity);
  body.velocity = daxpy(dadd(body.velocity, fall), 1 / body.mass, whole.force);
  body.angular_momentum = dadd(body.angular_momentum, whole.torque);
  if (body.touching) {
    body.velocity = daxpy(body.velocity, 1 / body.mass, body.contact.force);
    body.angular_momentum = dadd(body.angular_momentum, body.contact.torque);
  }
  const dvec3 spin = body.angular_velocity(body.rotation_next, body.angular_momentum);
  body.shift = dsub(body.center_next, body.center);
  body.turn = body.turn_next;
  if (body.touching) {  // without what parted the sides
    body.shift = dscale(step, body.velocity);
    body.turn = dscale(step, spin);
  } else if (stopped) {
    // The motion that would have led here smoothly (keep_history).
    const dvec3 change = daxpy(fall, 1 / body.mass, smooth.force);
    body.shift = dscale(step, daxpy(body.velocity, -0.5, change));
    body.turn = dscale(step, daxpy(spin, -0.5, body.angular_velocity(body.rotation_next, smooth.torque)));
  }
  body.contact_force = dscale(1 / step, body.contact.force);
  body.smooth = smooth;
  body.load = {dscale(1 / step, whole.force), dscale(1 / step, whole.torque)};
  body.center = body.center_next;
  body.rotation = body.rotation_next;
}

}  // namespace

void PredictBodies::run_on(const Rooms &state)
{
  state.rigid.gravity = state.elements.gravity.at(0);
  if (contacts_) contacts_->begin_step(state.rigid);
  for (RigidBody &body : state.rigid.body)
    body.impulse = {dscale(state.time.step, body.load.force), dscale(state.time.step, body.load.torque)};
  move_bodies(state, contacts_.get(), state.report.step);
}

WholeSums::Sums WholeSums::sum(const State &state, const Impulses &impulses)
{
  const MeshState &mesh = state.mesh;
  const int runs = (mesh.vertices + long_run - 1) / long_run;
  if (row_.size() == 0) {
    std::vector<int> row{0}, member(static_cast<std::size_t>(mesh.vertices));
    for (int v = 0; v < mesh.vertices; ++v) member[static_cast<std::size_t>(v)] = v;
    for (int r = 0; r < runs; ++r) row.push_back(std::min((r + 1) * long_run, mesh.vertices));
    member_.assign(member);
    row_.assign(row);
  }
  if (known_changes_ != mesh.pin_changes) {
    std::vector<int> free = mesh.fixed.download();
    for (int &value : free) value = 1 - value;
    free_.assign(free);
    known_changes_ = mesh.pin_changes;
  }
  wrench_.resize(4 * runs);
  CAMA_LAUNCH(*state.backend, sum_wrenches, runs, 0, row_, member_, free_, impulses.linear, impulses.angular, wrench_);
  CAMA_LAUNCH(*state.backend, sum_wrenches, runs, 2 * runs, row_, member_, mesh.fixed, impulses.linear,
              impulses.angular, wrench_);
  const std::vector<dvec3> parts = wrench_.download();
  Sums sums;
  for (std::size_t r = 0; r < static_cast<std::size_t>(runs); ++r) {
    sums.free = sum_of(sums.free, {parts[2 * r], parts[2 * r + 1]});
    const std::size_t at = 2 * (static_cast<std::size_t>(runs) + r);
    sums.prescribed = sum_of(sums.prescribed, {parts[at], parts[at + 1]});
  }
  return sums;
}

void BodySums::prepare(const State &state)
{
  std::vector<int> members, row{0}, range;
  attached_ = false;
  body_.clear();
  for (std::size_t b = 0; b < state.rigid.body.size(); ++b) {
    const RigidBody &body = state.rigid.body[b];
    const std::vector<int> others = motion_.attached(body.obstacle);
    attached_ |= !others.empty();
    const std::size_t first = members.size();
    for (int v = body.first; v < body.last; ++v) members.push_back(v);
    members.insert(members.end(), others.begin(), others.end());
    for (std::size_t at = first; at < members.size();) {
      at = std::min(at + run_length, members.size());
      row.push_back(static_cast<int>(at));
      body_.push_back(static_cast<int>(b));
      range.insert(range.end(), {body.first, body.last});
    }
  }
  if (members == known_) return;
  member_.assign(members);
  row_.assign(row);
  range_.assign(range);
  known_ = std::move(members);
}

std::vector<std::vector<BodyWrench>> BodySums::sum(const State &state, std::initializer_list<const Impulses *> impulses)
{
  const int runs = static_cast<int>(body_.size());
  wrench_.resize(2 * runs * static_cast<int>(impulses.size()));
  int first = 0;
  for (const Impulses *i : impulses) {
    CAMA_LAUNCH(*state.backend, sum_wrenches, runs, first, row_, member_, state.mesh.fixed, i->linear, i->angular,
                wrench_);
    first += 2 * runs;
  }
  const std::vector<dvec3> parts = wrench_.download();
  std::vector<std::vector<BodyWrench>> sums(impulses.size(), std::vector<BodyWrench>(state.rigid.body.size()));
  std::size_t at = 0;
  for (std::vector<BodyWrench> &bodies : sums)
    for (int body : body_) {
      bodies[static_cast<std::size_t>(body)] =
          sum_of(bodies[static_cast<std::size_t>(body)], {parts[at], parts[at + 1]});
      at += 2;
    }
  return sums;
}

template <class Real>
std::vector<std::array<double, RESISTANCE>> BodySums::resistance(const State &state, const Incidence &terms)
{
  const int runs = static_cast<int>(body_.size());
  System<Real> &s = *[&] {
    if constexpr (sizeof(Real) == 8)
      return state.system.f64.get();
    else
      return state.system.f32.get();
  }();
  resistance_.resize(RESISTANCE * runs);
  CAMA_LAUNCH_REAL(Real, *state.backend, motion_resistance, runs, state.mesh.cloth_vertices, row_, member_, range_,
                   state.mesh.fixed, terms.row, terms.entry, s.term, s.matrix.row, s.matrix.column, s.matrix.block,
                   state.mesh.position, resistance_);
  const std::vector<double> parts = resistance_.download();
  std::vector<std::array<double, RESISTANCE>> sums(state.rigid.body.size());
  for (auto &sum : sums) sum.fill(0);
  std::size_t at = 0;
  for (int body : body_)
    for (double &value : sums[static_cast<std::size_t>(body)]) value += parts[at++];
  return sums;
}

template <class Real> void CoupleBodies<Real>::place(State &state)
{
  move_bodies(BodyContacts::Rooms(state), contacts_.get(), state.report.step);
  motion_.run(state);
}

template <class Real> void CoupleBodies<Real>::find_scales(const State &state)
{
  scale_.clear();
  for (const RigidBody &body : state.rigid.body) {
    const SymmetricMatrix i = body.inertia(body.rotation);
    Matrix6 mass{};
    for (std::size_t k = 0; k < 3; ++k) {
      mass[k][k] = body.mass;
      mass[3 + k][3 + k] = i[k];
    }
    mass[4][3] = i[3];
    mass[5][4] = i[4];
    mass[5][3] = i[5];
    scale_.push_back(cholesky(mass));
  }
}

template <class Real> void CoupleBodies<Real>::find_factors(const State &state)
{
  factor_.clear();
  const auto all = sums.resistance<Real>(state, reactions_.terms());
  for (std::size_t b = 0; b < state.rigid.body.size(); ++b) {
    Matrix6 r;
    std::size_t at = 0;
    for (std::size_t i = 0; i < 6; ++i)
      for (std::size_t j = i; j < 6; ++j) r[i][j] = r[j][i] = all[b][at++];
    // About the centre of mass: torques lose center x force, on either side.
    const dvec3 c = state.rigid.body[b].center;
    const auto shift = [&](auto &&entry) {
      for (std::size_t j = 0; j < 6; ++j) {
        const dvec3 moment = dcross(c, {entry(0, j), entry(1, j), entry(2, j)});
        entry(3, j) -= moment.x;
        entry(4, j) -= moment.y;
        entry(5, j) -= moment.z;
      }
    };
    shift([&](std::size_t i, std::size_t j) -> double & { return r[i][j]; });
    shift([&](std::size_t i, std::size_t j) -> double & { return r[j][i]; });
    for (std::size_t k = 0; k < 6; ++k) r[k] = forward(scale_[b], r[k]);  // rows: R L^-T
    Matrix6 a;
    for (std::size_t k = 0; k < 6; ++k) {
      const Vector6 column = forward(scale_[b], {r[0][k], r[1][k], r[2][k], r[3][k], r[4][k], r[5][k]});
      for (std::size_t i = 0; i < 6; ++i) a[i][k] = column[i] + (i == k ? 1 : 0);
    }
    factor_.push_back(cholesky(a));
  }
}

template <class Real> std::vector<double> CoupleBodies<Real>::scaled(const std::vector<BodyWrench> &wrenches) const
{
  std::vector<double> x;
  for (std::size_t b = 0; b < wrenches.size(); ++b) {
    const Vector6 own = forward(scale_[b], vector_of(wrenches[b]));
    x.insert(x.end(), own.begin(), own.end());
  }
  return x;
}

template <class Real> void CoupleBodies<Real>::set_impulses(State &state, const std::vector<double> &x) const
{
  for (std::size_t b = 0; b < scale_.size(); ++b) {
    Vector6 own{};
    for (std::size_t i = 0; i < 6; ++i)
      for (std::size_t k = 0; k <= i; ++k) own[i] += scale_[b][i][k] * x[6 * b + k];
    state.rigid.body[b].impulse = {{own[0], own[1], own[2]}, {own[3], own[4], own[5]}};
  }
}

template <class Real> void CoupleBodies<Real>::relax(std::vector<double> &residual) const
{
  for (std::size_t b = 0; b < factor_.size(); ++b) {
    Vector6 own;
    std::copy_n(residual.begin() + static_cast<std::ptrdiff_t>(6 * b), 6, own.begin());
    own = backward(factor_[b], forward(factor_[b], own));
    std::copy_n(own.begin(), 6, residual.begin() + static_cast<std::ptrdiff_t>(6 * b));
  }
}

template <class Real> void CoupleBodies<Real>::run(State &state)
{
  std::vector<RigidBody> &bodies = state.rigid.body;
  const double memory = state.time.memory;
  sums.prepare(state);
  if (state.contact.contacts == 0 && !sums.attached()) {  // free flight
    for (RigidBody &body : bodies) body.impulse = carried(body, memory);
    place(state);
    return Pipeline::run(state);
  }
  const TighterSolves tighter(state);
  find_scales(state);
  std::vector<BodyWrench> impulses, fall, momentum;
  for (const RigidBody &body : bodies) {
    impulses.push_back(body.impulse);
    fall.push_back({dscale(body.mass * state.time.step, state.rigid.gravity), {0, 0, 0}});
    momentum.push_back({dscale(body.mass, body.velocity), body.angular_momentum});
  }
  std::vector<double> x = scaled(impulses), best = x;
  const double weight = norm(scaled(fall)), least = least_share * norm(scaled(momentum));
  mixing_.begin();
  double size = 0, whole = 0, best_size = std::numeric_limits<double>::infinity();
  int solves = 1, iterations = 0, newton = 0;
  for (;; ++solves) {
    state.report.newton_iterations = 1;
    Pipeline::run(state);
    iterations += state.report.iterations;
    newton += state.report.newton_iterations;
    reactions_.measure(state, state.reactions.piece);
    impulses = sums.sum(state, {&state.reactions.piece}).front();
    for (std::size_t b = 0; b < bodies.size(); ++b)
      impulses[b] = sum_of(about_center(bodies[b], impulses[b]), carried(bodies[b], memory));
    const std::vector<double> found = scaled(impulses);
    std::vector<double> residual = found;
    for (std::size_t i = 0; i < x.size(); ++i) residual[i] -= x[i];
    size = norm(residual);
    whole = norm(found) + weight;
    state.report.rigid_residual = size > 0 ? size / (whole + least / tolerance) : 0;
    if (size < best_size) {
      best = x;
      best_size = size;
    }
    if (!(size > tolerance * whole + least)) break;
    if (solves >= max_solves) {
      if (size == best_size || solves > max_solves) break;
      x = best;
    } else {
      find_factors(state);  // of the contacts that are closed now
      relax(residual);
      x = mixing_.next(x, residual);
    }
    set_impulses(state, x);
    place(state);
  }
  if (size > too_far * whole + least && state.time.division < state.options.max_divisions)
    throw SolverError(
        "step " + std::to_string(state.report.step) + ": the motions of rigid bodies and cloth differ by " +
        std::to_string(state.report.rigid_residual) + " of the impulses after " + std::to_string(solves) + " solves");
  state.report.rigid_solves = solves;
  state.report.iterations = iterations;
  state.report.newton_iterations = newton;
}

template class CoupleBodies<double>;
template class CoupleBodies<float>;

void FinishBodies::run(State &state)
{
  const Clock &time = state.time;
  ReactionState &r = state.reactions;
  const auto found = r.carries ? sums_.sum(state, {&r.piece, &r.smooth_next}) : sums_.sum(state, {&r.piece});
  const WholeSums::Sums sums = whole_.sum(state, r.piece);
  dvec3 others = sums.prescribed.force;
  double received = 0;
  for (const BodyWrench &own : found[0]) {
    others = dsub(others, own.force);
    received += kernels::dnorm(own.force);
  }
  received += kernels::dnorm(others);
  std::vector<BodyWrench> whole, smooth;
  std::vector<char> stopped;
  for (std::size_t b = 0; b < state.rigid.body.size(); ++b) {
    RigidBody &body = state.rigid.body[b];
    // What the step carried on acted about the centre of mass as it was in the step before.
    const BodyWrench before = about_center(body, {body.smooth.force, body.smooth_moment});
    const BodyWrench moved{{0, 0, 0}, dscale(time.memory, dsub(body.smooth.torque, before.torque))};
    whole.push_back(sum_of(about_center(body, found[0][b]), moved));
    smooth.push_back(whole[b]);
    if (r.carries) {
      smooth[b] = sum_of(about_center(body, found[1][b]), moved);
      body.smooth_moment = found[1][b].torque;
    }
    stopped.push_back(vector_of(whole[b]) != vector_of(smooth[b]));
    if (received > 0) {
      const double share = kernels::dnorm(found[0][b].force) / received;
      const BodyWrench lost = about_center(body, sums.free);
      whole[b] = sum_of(whole[b], {dscale(share, lost.force), dscale(share, lost.torque)});
    }
  }
  if (contacts_) contacts_->finish(state, whole);
  for (std::size_t b = 0; b < whole.size(); ++b) {
    advance(time.step, state.rigid.gravity, state.rigid.body[b], whole[b], smooth[b], stopped[b]);
    const RigidBody &body = state.rigid.body[b];
    motion_.assign({body.center, body.velocity, body.angular_velocity(body.rotation, body.angular_momentum)});
    CAMA_LAUNCH(*state.backend, rigid_velocities, body.last - body.first, state.mesh.position, motion_, body.first,
                state.mesh.velocity);
  }
}

}  // namespace cama
