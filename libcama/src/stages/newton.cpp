// SPDX-License-Identifier: Apache-2.0
#include "stages/newton.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "device/ceil_divide.hpp"
#include "device/launch.hpp"
#include "stages/bending.hpp"

namespace cama {
namespace {
// patience: iterations in a row that lower neither the potential beyond rounding nor the residual.
constexpr int max_halvings = 10, patience = 3;
// A step by an error has further solves where contacts that opened or closed leave a residual, relative to all forces:
// one, or more where it is as large as all forces.
constexpr double open_residual = 0.3, lost_residual = 1;
constexpr int solves_of_open = 1, solves_of_lost = 3;
// A step of BDF2 of fixed length has further solves where Newton's method contracts slowly, that is where the second
// change has more than a share of the energy of the first and several times what the cloth moves with, until a change
// has less than a part of that: cloth of fine meshes that is struck would gain energy. The predictions of the steps
// after it are smoothed. Cloth that encloses gas has none of this: it does not make a squeezed cushion better.
constexpr double slow_contraction = 0.02, much_energy = 5, little_energy = 0.5;
constexpr int solves_of_slow = 8;
constexpr double further_slack = 3;  // of the tolerance: a further solve begins with a small residual
constexpr double sufficient = 1e-4;  // of the decrease that the slope predicts
constexpr double rounding_units = 16;  // of the sum of the potential's parts
constexpr int parts_of_host = 512;  // most sums of chunks that the host adds up

/// With the chunks of reduce_lists, so that its sums do not depend on who adds.
double sum_of(const double *value, int count)
{
  if (count == 1) return *value;
  std::vector<double> chunk;
  for (int i = 0; i < count; i += PARTIAL_CHUNK) {
    double sum = 0;
    for (int j = i; j < std::min(i + PARTIAL_CHUNK, count); ++j) sum += value[j];
    chunk.push_back(sum);
  }
  return sum_of(chunk.data(), static_cast<int>(chunk.size()));
}
}  // namespace

template <class Real>
NewtonIterations<Real>::NewtonIterations(Backend &b, EvaluateElements<Real> &elements, AssembleMatrix<Real> &assembly,
                                         LinearSolve<Real> &solve, const std::vector<double> &masses)
    : elements_(elements), assembly_(assembly), solve_(solve), outer_(b), outer_before_(b), start_(b), given_(b),
      solved_(b), moved_(b), vertex_{Stream<double>(b), Stream<double>(b)},
      triangle_{Stream<double>(b), Stream<double>(b)}, hinge_(b), term_(b), slope_(b),
      part_{Stream<double>(b), Stream<double>(b)}, sums_(b), push_(b), load_(b), pull_(b), share_(b), pressing_(b)
{
  for (double m : masses) fastest_ += m * FASTEST * FASTEST;
}

template <class Real>
typename NewtonIterations<Real>::Sums NewtonIterations<Real>::sum(const Rooms &state,
                                                                  const std::vector<const Stream<double> *> &streams)
{
  Sums sums;
  sums.lists = static_cast<int>(streams.size());
  const Stream<double> *list[4] = {&slope_, &slope_, &slope_, &slope_};
  auto &count = sums.count, &first = sums.first;
  for (std::size_t k = 0; k < streams.size(); ++k) {
    list[k] = streams[k];
    count[k] = streams[k]->size();
  }
  for (int round = 0;; ++round) {
    int part[4], chunks[4], parts = 0, max_chunks = 0;
    for (int k = 0; k < 4; ++k) {
      chunks[k] = ceil_divide(count[k], PARTIAL_CHUNK);
      part[k] = parts;
      parts += chunks[k];
      max_chunks = std::max(max_chunks, chunks[k]);
    }
    const bool last = parts <= parts_of_host || max_chunks <= 1;
    Stream<double> &to = last ? sums_ : part_[round % 2];
    const int at = last ? sums_.size() : 0;
    if (last)
      to.grow(static_cast<long long>(at) + parts);
    else
      to.resize(parts);
    CAMA_LAUNCH(*state.backend, reduce_lists, parts, count[0], count[1], count[2], count[3], first[0], first[1],
                first[2], first[3], *list[0], *list[1], *list[2], *list[3], at, to);
    for (int k = 0; k < 4; ++k) {
      list[k] = &to;
      count[k] = chunks[k];
      first[k] = at + part[k];
    }
    if (last) return sums;
  }
}

template <class Real> std::vector<double> NewtonIterations<Real>::Sums::of(const std::vector<double> &chunks) const
{
  std::vector<double> totals(static_cast<std::size_t>(lists), 0);
  for (int k = 0; k < lists; ++k)
    if (count[k] > 0) totals[static_cast<std::size_t>(k)] = sum_of(chunks.data() + first[k], count[k]);
  return totals;
}

template <class Real> void NewtonIterations<Real>::find_pushes(const Rooms &state, Friction friction)
{
  Backend &b = *state.backend;
  System<Real> &s = state.system.template of<Real>();
  const Incidence &incidence = state.system.term_incidence;
  const int rows = state.mesh.cloth_vertices, contacts = state.contact.contacts;
  push_.resize(contacts);
  load_.resize(rows);
  pull_.resize(rows);
  share_.resize(rows);
  if (friction == Friction::of_first_solve)
    CAMA_LAUNCH_REAL(Real, b, solved_pushes, contacts, s.term, s.solution, push_);
  else
    CAMA_LAUNCH_REAL(Real, b, contact_pushes, contacts, 1, s.term, s.solution, push_);
  CAMA_LAUNCH_REAL(Real, b, solved_loads, rows, contacts, incidence.row, incidence.entry, s.term, push_, load_, pull_);
  CAMA_LAUNCH_REAL(Real, b, remaining_loads, rows, s.matrix.row, s.matrix.column, load_, pull_, share_);
}

template <class Real> void NewtonIterations<Real>::iterate_friction(const Rooms &state, bool again)
{
  Backend &b = *state.backend;
  System<Real> &s = state.system.template of<Real>();
  pressing_.resize(state.contact.contacts);
  CAMA_LAUNCH_REAL(Real, b, iterate_friction, state.contact.contacts, again ? 1 : 0, state.mesh.cloth_vertices,
                   state.contact.contact, state.mesh.inverse_mass, push_, load_, share_, state.mesh.velocity_next,
                   static_cast<Real>(state.time.implicit_step), pressing_, s.term, s.hold);
}

template <class Real>
typename NewtonIterations<Real>::Sums NewtonIterations<Real>::find_norms(const Rooms &state, Friction friction,
                                                                         bool with_slope, std::optional<Fork> *ahead)
{
  Backend &b = *state.backend;
  System<Real> &s = state.system.template of<Real>();
  const int rows = state.mesh.cloth_vertices;
  const Real h = static_cast<Real>(state.time.implicit_step);
  const Stream<dvec3> &x = state.mesh.position_next, &v = state.mesh.velocity_next;
  elements_.evaluate(state, x, v, outer_);
  if (ahead) ahead->emplace(b).aside([&] { assemble(state); });
  if (state.system.terms) {
    const int refresh = state.options.contact_refresh == ContactRefresh::iteration;
    const bool rough = state.contact.friction && state.contact.contacts;
    if (rough && friction == Friction::of_first_solve) find_pushes(state, friction);
    CAMA_LAUNCH_REAL(Real, b, update_contact_terms, state.contact.contacts, state.time.predicted ? 1 : 0, refresh, 0,
                     state.contact.contact, state.mesh.position, x, v, state.mesh.inverse_mass,
                     state.contact.vertex_contact, h, s.term);
    if (rough && friction == Friction::of_iterate) find_pushes(state, friction);
    if (rough && friction != Friction::as_it_is) iterate_friction(state, friction == Friction::of_first_pushes);
    CAMA_LAUNCH_REAL(Real, b, make_stitch_terms, state.elements.stitches, state.elements.stitch, x, h,
                     state.contact.contacts, s.term);
  }
  solve_.find_residual(state);
  for (Stream<double> &values : vertex_) values.resize(rows);
  CAMA_LAUNCH_REAL(Real, b, newton_norms, rows, h, s.mass, state.mesh.fixed, state.elements.gravity, s.right_side,
                   state.elements.triangle_incidence.row, state.elements.triangle_incidence.entry, s.triangle_force,
                   state.elements.hinge_incidence.row, state.elements.hinge_incidence.entry, s.hinge_force,
                   state.mesh.hinges, state.system.terms > 0 ? 1 : 0, state.system.term_incidence.row,
                   state.system.term_incidence.entry, s.term, vertex_[0], vertex_[1]);
  std::vector<const Stream<double> *> lists = {&vertex_[0], &vertex_[1]};
  if (with_slope) lists.push_back(&slope_);
  return sum(state, lists);
}

template <class Real>
typename NewtonIterations<Real>::Norms NewtonIterations<Real>::evaluate(const Rooms &state, Friction friction,
                                                                        bool ahead)
{
  std::optional<Fork> fork;   // until the norms are read
  sums_.resize(0);
  const Sums sums = find_norms(state, friction, false, ahead ? &fork : nullptr);
  const std::vector<double> totals = sums.of(sums_.download());
  if (!std::isfinite(totals[0]))
    throw SolverError("step " + std::to_string(state.report.step) +
                      ": Newton's method met forces that are not finite; check the material's stiffness and density "
                      "and the time step");
  return norms_of(totals);
}

template <class Real> void NewtonIterations<Real>::assemble(const Rooms &state)
{
  if (elements_.windy() || elements_.mass_damped())
    elements_.find_drag(state, state.mesh.position_next, state.mesh.velocity_next, elements_.windy());
  assembly_.run_on(state);
}

template <class Real>
typename NewtonIterations<Real>::Sums NewtonIterations<Real>::measure(const Rooms &state, const Stream<vec3> &outer)
{
  Backend &b = *state.backend;
  System<Real> &s = state.system.template of<Real>();
  const Stream<dvec3> &x = state.mesh.position_next, &v = state.mesh.velocity_next;
  const bool held = elements_.pushed(state);
  vertex_[0].resize(state.mesh.cloth_vertices);
  CAMA_LAUNCH_REAL(Real, b, measure_inertia, state.mesh.cloth_vertices, state.time.implicit_step, s.mass,
                   state.mesh.fixed, state.mesh.base_velocity(state.time), v, state.mesh.position, x,
                   state.elements.gravity, held ? 1 : 0, held ? outer : s.force, vertex_[0]);
  for (Stream<double> &values : triangle_) values.resize(state.mesh.triangles);
  CAMA_LAUNCH_REAL(Real, b, measure_triangles, state.mesh.triangles, s.triangle_rest, s.stretching_table,
                   s.stretching_start, x, triangle_[0], triangle_[1]);
  if (s.strain_limit.size())
    CAMA_LAUNCH_REAL(Real, b, measure_limits, state.mesh.triangles, s.triangle_rest, s.stretching_table,
                     s.stretching_start, s.strain_limit, x, triangle_[0]);
  hinge_.resize(state.mesh.hinges);
  if (state.mesh.hinges) measure_bending(b, state.options, s, state.mesh.hinges, x, hinge_);
  term_.resize(state.system.terms);
  CAMA_LAUNCH_REAL(Real, b, measure_terms, state.system.terms, state.contact.contacts, state.time.predicted ? 1 : 0,
                   state.options.contact_refresh == ContactRefresh::iteration ? 1 : 0, state.time.implicit_step,
                   state.contact.contact, state.elements.stitch, state.mesh.position, x, v, state.mesh.inverse_mass,
                   state.contact.vertex_contact, s.term, s.hold, term_);
  return sum(state, {&vertex_[0], &triangle_[0], &hinge_, &term_});
}

template <class Real>
typename NewtonIterations<Real>::Potential NewtonIterations<Real>::potential(const std::vector<double> &parts)
{
  Potential result;
  for (double part : parts) {
    result.value += part;
    result.size += std::abs(part);
  }
  return result;
}

template <class Real>
bool NewtonIterations<Real>::falls(const Potential &before, const Potential &now, double alpha, double slope)
{
  const double slack = rounding_units * std::numeric_limits<Real>::epsilon() * (before.size + now.size);
  if (!(now.value <= before.value + sufficient * alpha * slope + slack)) return false;
  fell_ = now.value < before.value - slack;
  return true;
}

template <class Real> void NewtonIterations<Real>::move(const Rooms &state, double alpha)
{
  Backend &b = *state.backend;
  CAMA_LAUNCH_REAL(Real, b, move_iterate, state.mesh.cloth_vertices, alpha, state.mesh.fixed, start_,
                   state.system.template of<Real>().solution, state.mesh.velocity_next);
  CAMA_LAUNCH(b, advance, state.mesh.cloth_vertices, state.time.implicit_step, state.mesh.fixed,
              state.mesh.velocity_next, state.mesh.base_position(state.time), state.mesh.position_next);
}

template <class Real> bool NewtonIterations<Real>::contracts_slowly(const Rooms &state, double first_energy)
{
  const bool stopped = state.contact.contacts > 0, gas = state.system.gas.vertex_part.size() > 0;
  if (!stopped || gas || !(solve_.start() > slow_contraction * first_energy)) return false;
  vertex_[0].resize(state.mesh.cloth_vertices);
  CAMA_LAUNCH(*state.backend, kinetic_energies, state.mesh.cloth_vertices, state.time.step, state.elements.gravity,
              state.mesh.inverse_mass, state.mesh.velocity, vertex_[0]);
  sums_.resize(0);
  const Sums energies = sum(state, {&vertex_[0]});
  kinetic_ = energies.of(sums_.download())[0];
  return solve_.start() > much_energy * kinetic_;
}

/// Forces from sampled stiffness are not exactly the gradient of an energy: close to the solution the residual decides.
template <class Real> bool NewtonIterations<Real>::search_line(const Rooms &state, Norms &norms, bool &evaluated)
{
  System<Real> &s = state.system.template of<Real>();
  evaluated = fell_ = false;
  alpha_ = 0;
  slope_.resize(state.mesh.cloth_vertices);
  CAMA_LAUNCH_REAL(Real, *state.backend, descent, state.mesh.cloth_vertices, state.mesh.fixed, s.right_side, s.solution,
                   slope_);
  start_.copy_from(state.mesh.velocity_next);
  sums_.resize(0);
  const Sums slopes = sum(state, {&slope_}), parts = measure(state, outer_.force);
  const std::vector<double> chunks = sums_.download();
  const double slope = slopes.of(chunks)[0];
  if (!(slope < 0)) return false;
  const Potential before = potential(parts.of(chunks));
  double alpha = 1;
  for (int halving = 0; halving <= max_halvings; ++halving, alpha /= 2) {
    move(state, alpha);
    alpha_ = alpha;
    sums_.resize(0);
    const Sums now = measure(state, outer_.force);
    if (falls(before, potential(now.of(sums_.download())), alpha, slope)) return true;
    if (halving > 0) continue;
    sums_.resize(0);
    const Sums sums = find_norms(state, Friction::as_it_is, false);
    const std::vector<double> totals = sums.of(sums_.download());
    if (!(totals[0] < norms.residual)) continue;
    norms = norms_of(totals);
    return evaluated = true;
  }
  move(state, 0);
  alpha_ = 0;
  return false;
}

/// The residual is asked first, since it is reported anyway and spares both potentials. Where the last such search
/// needed them and a device would wait for the question, they are found at the same time.
template <class Real> bool NewtonIterations<Real>::search_last(const Rooms &state, Norms &norms, bool &evaluated)
{
  System<Real> &s = state.system.template of<Real>();
  // Whether the potential is the same wherever terms were evaluated last.
  const bool fixed_terms = state.options.contact_refresh != ContactRefresh::iteration,
             at_once = by_potential_ && fixed_terms && !state.backend->wide_workers();
  evaluated = fell_ = false;
  slope_.resize(state.mesh.cloth_vertices);
  CAMA_LAUNCH_REAL(Real, *state.backend, descent, state.mesh.cloth_vertices, state.mesh.fixed, s.right_side, s.solution,
                   slope_);
  start_.copy_from(state.mesh.velocity_next);
  sums_.resize(0);
  Sums parts_before, parts;
  if (at_once) parts_before = measure(state, outer_.force);
  move(state, 1);
  alpha_ = 1;
  outer_before_.swap(outer_.force);
  const Sums sums = find_norms(state, Friction::as_it_is, true);
  if (at_once) parts = measure(state, outer_before_);
  std::vector<double> chunks = sums_.download();
  const std::vector<double> totals = sums.of(chunks);
  const Norms there = norms_of(totals);
  const double slope = totals[2];
  by_potential_ = slope < 0 && !(there.residual < norms.residual);
  if (slope < 0 && !by_potential_) {
    norms = there;
    return evaluated = true;
  }
  alpha_ = 0;
  if (!by_potential_) {
    move(state, 0);
    return false;
  }
  if (!at_once) {
    move(state, 0);
    if (!fixed_terms) evaluate(state);
    sums_.resize(0);
    parts_before = measure(state, outer_before_);
    move(state, 1);
    parts = measure(state, outer_before_);
    chunks = sums_.download();
  }
  const Potential before = potential(parts_before.of(chunks));
  Potential now = potential(parts.of(chunks));
  Norms norms_here = there;  // at the last iterate that was evaluated
  double alpha = 1;
  for (int halving = 0; halving <= max_halvings; ++halving, alpha /= 2) {
    if (halving > 0) {
      move(state, alpha);
      sums_.resize(0);
      Sums sums_here;
      if (fixed_terms) sums_here = find_norms(state, Friction::as_it_is, false);
      const Sums halved = measure(state, outer_before_);
      chunks = sums_.download();
      now = potential(halved.of(chunks));
      if (fixed_terms) norms_here = norms_of(sums_here.of(chunks));
    }
    alpha_ = alpha;
    if (!falls(before, now, alpha, slope)) continue;
    evaluated = fixed_terms && std::isfinite(norms_here.residual);
    if (evaluated) norms = norms_here;
    return true;
  }
  move(state, 0);
  alpha_ = 0;
  if (fixed_terms) evaluate(state);
  evaluated = fixed_terms;
  return false;
}

template <class Real>
void NewtonIterations<Real>::find_solved_impulses(const Rooms &state, bool done, Stream<dvec3> &impulses)
{
  System<Real> &s = state.system.template of<Real>();
  const int contacts = state.contact.contacts, form = static_cast<int>(state.options.paper.contact_form);
  if (!done) {
    moved_.copy_from(state.mesh.velocity_next);
    CAMA_LAUNCH_REAL(Real, *state.backend, move_iterate, state.mesh.cloth_vertices, 1.0, state.mesh.fixed,
                     state.mesh.velocity_next, s.solution, moved_);
  }
  impulses.resize(contacts);
  CAMA_LAUNCH_REAL(Real, *state.backend, contact_impulses, contacts, 0, form, 0, 0.0, s.term, s.hold,
                   state.contact.abrupt, done ? state.mesh.velocity_next : moved_, s.solution, impulses);
}

template <class Real> void NewtonIterations<Real>::find_remainders(const Rooms &state)
{
  System<Real> &s = state.system.template of<Real>();
  const int contacts = state.contact.contacts, form = static_cast<int>(state.options.paper.contact_form);
  solved_.resize(contacts);
  CAMA_LAUNCH_REAL(Real, *state.backend, contact_impulses, contacts, 1, form, 0, 0.0, s.term, s.hold,
                   state.contact.abrupt, state.mesh.velocity_next, s.solution, solved_);
  CAMA_LAUNCH(*state.backend, add_impulses, contacts, -1.0, solved_, given_);
  state.contact.remainder.copy_from(given_);
}

template <class Real> void NewtonIterations<Real>::run_on(const Rooms &state)
{
  const double goal = state.options.newton_tolerance * state.options.newton_tolerance;
  int linear = state.report.iterations, taken = 1, idle = 0;
  const double first_energy = solve_.start();
  bool slow = false;
  const bool rough = state.contact.friction && state.contact.contacts;
  const bool received = state.contact.remainder.backend();
  if (received) find_solved_impulses(state, true, given_);
  // The matrix of the next solve is made while the norms are on their way, which seldom say that there is none; then
  // the option forces would need the one of this solve, and bodies, which set it.
  bool ahead = state.backend->forks() && assembly_.independent(state.options) && !state.options.forces;
  Norms norms = evaluate(state, Friction::of_first_solve, ahead), best = norms;
  const auto relative = [](const Norms &n) { return n.size > 0 ? std::sqrt(n.residual / n.size) : 0; };
  const bool may_go_on = state.options.integrator == Integrator::bdf2,
             fixed_step = may_go_on && !(state.time.error > 0);
  const auto max_solves = [&] {
    const auto above = [&](double share) { return norms.residual > share * share * norms.size; };
    const int further = !may_go_on || norms.residual >= fastest_ ? 0
                        : fixed_step                             ? (slow ? solves_of_slow : 0)
                        : above(lost_residual)                   ? solves_of_lost
                        : above(open_residual)                   ? solves_of_open
                                                                 : 0;
    return state.options.newton_iterations + further;
  };
  while (norms.residual > goal * norms.size && taken < max_solves() && idle < patience) {
    if (rough && taken == 2)
      best = norms = evaluate(state, Friction::of_first_pushes);
    else if (rough && taken > state.options.newton_iterations)
      best = norms = evaluate(state, Friction::of_iterate);
    if (!std::exchange(ahead, false)) assemble(state);
    solve_.solve_from_zero(state, further_slack);
    linear += state.report.iterations;
    ++taken;
    if (fixed_step && taken == 2 && (slow = contracts_slowly(state, first_energy)))
      state.time.smoothed_steps = most_smoothed_steps;
    slow = slow && solve_.start() > little_energy * kinetic_;
    bool evaluated = false;
    if (received) find_solved_impulses(state, false, solved_);
    const bool last = taken >= state.options.newton_iterations,
               found = last ? search_last(state, norms, evaluated) : search_line(state, norms, evaluated);
    if (received) {
      CAMA_LAUNCH(*state.backend, scale_vectors, given_.size(), 1 - alpha_, given_);
      CAMA_LAUNCH(*state.backend, add_impulses, given_.size(), alpha_, solved_, given_);
    }
    if (!found) {
      if (!evaluated && (state.options.forces || (state.time.multistep && state.contact.contacts)))
        evaluate(state);  // the terms are those of an iterate that was refused
      break;
    }
    if (!evaluated) norms = evaluate(state);
    idle = fell_ || norms.residual < 0.25 * best.residual ? 0 : idle + 1;
    if (norms.residual < best.residual) best = norms;
  }
  if (received) find_remainders(state);
  state.report.iterations = linear;
  state.report.newton_iterations = taken;
  state.report.newton_residual = relative(norms);
}

template class NewtonIterations<double>;
template class NewtonIterations<float>;

}  // namespace cama
