// SPDX-License-Identifier: Apache-2.0
#include "stages/penetration_handling.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstring>
#include <tuple>

#include "device/launch.hpp"

namespace cama {
namespace {
constexpr int active_set_rounds = 4, max_iterations = 200, max_waits = 64;
constexpr int max_idle_passes =
    10;  // that find no fewer impacts than one before: without a commit (paper mode), cloth that is tangled for good
constexpr int iterations_per_check = 8;  // even: scalars change places
constexpr double impulse_tolerance = 1e-4;  // relative residual of the linear system
constexpr double regularisation = 1e-6;  // of its diagonal: duplicate impacts make it singular
constexpr double pushing_tolerance = 1e-3;  // relative change of impulses: the result is certified afterwards

float as_fraction(int bits)
{
  float value;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}
int chunks(int n) { return (n + DOT_CHUNK - 1) / DOT_CHUNK; }
}  // namespace

ImpactProjection::ImpactProjection(Backend &b)
    : nodes_(b), count_(b), active_(b), dropped_(b, 1), moved_(b), constraint_(b), diagonal_(b), majorant_(b),
      lambda_(b), r_(b), z_(b), p_(b), q_(b), partial_(b), scalar_(b, SCALAR_COUNT), y_(b), wanted_(b), length_(b),
      longest_(b), longer_(b), largest_(b)
{}

void ImpactProjection::spread(State &state, const Stream<double> &lambda)
{
  CAMA_LAUNCH(*state.backend, spread_impulses, state.cloth_vertices, incidence_.row, incidence_.entry, state.impact,
              state.inverse_mass, lambda, y_);
}

void ImpactProjection::multiply(State &state, double regularisation, const Stream<double> &x, Stream<double> &q)
{
  spread(state, x);
  CAMA_LAUNCH(*state.backend, gather_impulses, state.impact.size(), state.cloth_vertices, regularisation, state.impact,
              active_, y_, diagonal_, x, q);
}

void ImpactProjection::solve_linear_system(State &state)
{
  Backend &b = *state.backend;
  const int n = state.impact.size();
  const auto dot = [&](const Stream<double> &x, const Stream<double> &y) {
    CAMA_LAUNCH(b, dot_scalars, chunks(n), n, x, y, partial_);
  };
  for (int round = 0; round < active_set_rounds; ++round) {
    CAMA_LAUNCH(b, start_impulses, n, active_, constraint_, diagonal_, lambda_, r_, z_, p_);
    dot(r_, z_);
    CAMA_LAUNCH(b, finish_beta, 1, chunks(n), 1, partial_, scalar_);
    const double start = scalar_.at(SCALAR_RZ);
    for (int i = 0; i < max_iterations; ++i) {
      if (i % 4 == 0 && scalar_.at(SCALAR_RZ) <= impulse_tolerance * impulse_tolerance * start) break;
      multiply(state, regularisation, p_, q_);
      dot(p_, q_);
      CAMA_LAUNCH(b, finish_alpha, 1, chunks(n), partial_, scalar_);
      CAMA_LAUNCH(b, update_impulses, n, scalar_, active_, diagonal_, p_, q_, lambda_, r_, z_);
      dot(r_, z_);
      CAMA_LAUNCH(b, finish_beta, 1, chunks(n), 0, partial_, scalar_);
      CAMA_LAUNCH(b, update_impulse_direction, n, scalar_, z_, p_);
    }
    dropped_.fill_zero();
    CAMA_LAUNCH(b, drop_pulling, n, lambda_, active_, dropped_);
    if (dropped_.at(0) == 0) break;
  }
  CAMA_LAUNCH(b, clamp_impulses, n, active_, lambda_);
}

void ImpactProjection::solve_pushing(State &state)
{
  Backend &b = *state.backend;
  const int n = state.impact.size(), teams = (n + PUSH_IMPACTS - 1) / PUSH_IMPACTS;
  partial_.resize(3 * teams);
  CAMA_LAUNCH(b, set_int, n, 0, 1, active_);
  CAMA_LAUNCH(b, set_double, n, 0.0, lambda_);
  CAMA_LAUNCH(b, set_double, n, 0.0, p_);
  CAMA_LAUNCH(b, start_momentum, PUSH_COUNT, scalar_);
  const auto iterate = [&] {
    for (int i = 0; i < iterations_per_check; ++i) {
      const int from = i % 2 * PUSH_COUNT, to = PUSH_COUNT - from;
      spread(state, p_);
      CAMA_LAUNCH_TEAMS(void, b, push_impulses, PUSH_TEAM, teams, n, state.cloth_vertices, state.impact, active_, y_,
                        constraint_, majorant_, p_, lambda_, r_, partial_);
      CAMA_LAUNCH_TEAMS(void, b, extrapolate_impulses, PUSH_TEAM, teams, n, teams, partial_, from, to, scalar_, lambda_,
                        r_, p_);
    }
  };
  for (int i = 0; i < max_iterations; i += iterations_per_check) {
    b.repeat(1, iterate, i > 0);
    const std::vector<double> scalar = scalar_.download();
    if (scalar[PUSH_MOVED] <= pushing_tolerance * pushing_tolerance * scalar[PUSH_SIZE]) break;
  }
}

void ImpactProjection::start(State &state, const Stream<dvec3> &from, const Stream<dvec3> &wanted)
{
  Backend &b = *state.backend;
  if (largest_.size() == 0) {  // the last to be made
    moved_.resize(state.vertices);
    moved_.fill_zero();
    length_.resize(state.vertices);
    largest_.resize(1);
  }
  wanted_.copy_from(wanted);
  CAMA_LAUNCH(b, motion_lengths, state.vertices, from, wanted, length_);
}

void ImpactProjection::run(State &state, Stream<dvec3> &positions)
{
  Backend &b = *state.backend;
  const int n = state.impact.size();
  nodes_.resize(n);
  for (Stream<double> *s : {&constraint_, &diagonal_, &majorant_, &lambda_, &r_, &z_, &p_, &q_}) s->resize(n);
  active_.resize(n);
  partial_.resize(chunks(n));
  y_.resize(state.cloth_vertices);
  count_.resize(state.cloth_vertices);
  CAMA_LAUNCH(b, impact_nodes, n, state.impact, nodes_);
  incidence_.reset(b, state.cloth_vertices);
  incidence_.build(b, nodes_, n, count_);
  CAMA_LAUNCH(b, start_impacts, n, state.cloth_vertices, state.impact, positions, state.inverse_mass, incidence_.row,
              constraint_, diagonal_, majorant_, active_);
  if (state.options.linear_impacts)
    solve_linear_system(state);
  else
    solve_pushing(state);
  spread(state, lambda_);
  const int first = std::clamp(n, 1, 4096), second = std::min(first, 64);
  longest_.resize(first);
  longer_.resize(second);
  CAMA_LAUNCH(b, farthest_pushes, first, n, state.impact, length_, longest_);
  CAMA_LAUNCH(b, largest_of, second, first, longest_, longer_);
  CAMA_LAUNCH(b, largest_of, 1, second, longer_, largest_);
  CAMA_LAUNCH(b, apply_impulses, state.cloth_vertices, largest_, wanted_, y_, positions, moved_);
}

PenetrationHandling::PenetrationHandling(Backend &b, CandidateSearch &search, FlaggedPairs &flagged)
    : search_(search), projection_(b), from_(b), committed_(b), flagged_(flagged), prediction_error_(b),
      detection_(b, 2), fraction_(b), fraction_before_(b), sigma_(b, 1), counter_(b, 2)
{}

PenetrationHandling::Detection PenetrationHandling::detect(State &state, bool first_piece, bool localized,
                                                           int vertex_face_done, int edge_edge_done)
{
  Backend &b = *state.backend;
  const PairList &vertex_face = state.vertex_face, &edge_edge = state.edge_edge;
  const int all = 0x7fffffff, first = vertex_face.pairs.size();
  CandidateSearch::find_directions(state, from_, all, all);
  flagged_.resize(state);
  prediction_error_.resize(state.vertices);
  detection_.fill_zero();
  CAMA_LAUNCH(b, find_prediction_errors, state.vertices, from_, state.position_next, state.predicted, state.vertex_box,
              state.box_origin(), certified_ * state.largest_thickness, prediction_error_, detection_);
  CAMA_LAUNCH(b, select_ccd_pairs, flagged_.flag.size(), first, localized ? 1 : 0, vertex_face.pairs, edge_edge.pairs,
              state.face, state.edge, state.inverse_mass, certified_, state.largest_thickness, prediction_error_,
              vertex_face_done, edge_edge_done, first_piece ? vertex_face.gap_bound.size() : 0, vertex_face.gap_bound,
              first_piece ? edge_edge.gap_bound.size() : 0, edge_edge.gap_bound, projection_.moved(), flagged_.flag);
  CAMA_LAUNCH_TEAMS(void, b, find_impacts, PAIR_TEAM, flagged_.pair_teams(), flagged_.flag.size(), first,
                    state.options.cubic_impacts ? 1 : 0, vertex_face.pairs, edge_edge.pairs, state.face, state.edge,
                    from_, state.position_next, state.vertex_contact, certified_, vertex_face.direction,
                    edge_edge.direction, flagged_.flag, detection_);
  const std::vector<int> counts = detection_.download();
  return {counts[0], counts[1]};
}

void PenetrationHandling::add_impacts(State &state, int found)
{
  Backend &b = *state.backend;
  const int known = state.impact.size();
  flagged_.compact(state, found);
  state.impact.grow(static_cast<long long>(known) + found);
  CAMA_LAUNCH(b, fill_impacts, found, state.vertex_face.pairs.size(), state.options.cubic_impacts ? 1 : 0,
              flagged_.index, state.vertex_face.pairs, state.edge_edge.pairs, state.face, state.edge, from_,
              state.position_next, state.vertex_contact, certified_, target_, known, state.vertex_face.gap_bound,
              state.edge_edge.gap_bound, state.impact);
}

double PenetrationHandling::commit(State &state, bool certified)
{
  Backend &b = *state.backend;
  fraction_.resize(state.vertices);
  fraction_before_.resize(state.vertices);
  CAMA_LAUNCH(b, commit_begin, state.vertices, fraction_, sigma_, counter_);
  PairList *lists[2] = {&state.vertex_face, &state.edge_edge};
  const int first[2] = {0, lists[0]->pairs.size()};
  Stream<int> &accepted = flagged_.flag;
  flagged_.resize(state);
  int settled = -1;
  for (int kind = 0; kind < 2; ++kind) {
    CAMA_LAUNCH(b, commit_screen, lists[kind]->pairs.size(), kind, first[kind], certified ? 1 : 0, lists[kind]->pairs,
                state.face, state.edge, from_, state.position_next, lists[kind]->direction, state.vertex_contact,
                lists[kind]->gap_bound, certified_, accepted);
  }
  for (int pass = 0;; ++pass) {
    if (pass > 0) fraction_before_.copy_from(fraction_);
    for (int kind = 0; kind < 2; ++kind)
      CAMA_LAUNCH(b, commit_pairs, lists[kind]->pairs.size(), kind, first[kind], pass, lists[kind]->pairs, state.face,
                  state.edge, from_, state.position_next, state.inverse_mass, state.vertex_contact, certified_, 0,
                  accepted, fraction_before_, fraction_, sigma_, counter_);
    const int now = counter_.at(0);
    if (now == settled) break;
    settled = now;
  }
  const double sigma = as_fraction(sigma_.at(0));
  committed_.resize(state.vertices);
  CAMA_LAUNCH(b, commit_apply, state.vertices, from_, state.position_next, fraction_, sigma_, committed_);
  const std::vector<int> fraction = fraction_.download();
  double lost = 0;
  for (int i = 0; i < state.cloth_vertices; ++i)
    if (fraction[i] != COMMIT_WHOLE) {
      ++state.report.truncated;
      lost += 1 - as_fraction(fraction[i]);
    }
  state.report.lost_motion += lost / state.cloth_vertices;
  return sigma;
}

std::vector<std::pair<int, kernels::pair>> PenetrationHandling::pausing_pairs(State &state)
{
  std::vector<std::pair<int, kernels::pair>> pausing;
  const std::vector<int> accepted = flagged_.flag.download();
  std::size_t at = 0;
  for (int kind = 0; kind < 2; ++kind)
    for (const kernels::pair &p : (kind == 0 ? state.vertex_face : state.edge_edge).pairs.download())
      if (accepted[at++] == COMMIT_PAUSING) pausing.emplace_back(kind, p);
  std::sort(pausing.begin(), pausing.end(), [](const auto &p, const auto &q) {
    return std::tie(p.first, p.second.a, p.second.b) < std::tie(q.first, q.second.a, q.second.b);
  });
  return pausing;
}

namespace {

/// The four vertices of a pair; side A's come first.
std::array<int, 4> vertices_of(int kind, const kernels::pair &p, const State &state)
{
  if (kind == 0) {
    const auto f = state.face.at(p.b);
    return {p.a, f.node[0], f.node[1], f.node[2]};
  }
  const auto e = state.edge.at(p.a), f = state.edge.at(p.b);
  return {e.node[0], e.node[1], f.node[0], f.node[1]};
}

}  // namespace

std::string PenetrationHandling::place(State &state, const std::vector<std::pair<int, kernels::pair>> &pausing)
{
  if (pausing.empty()) return "";
  const auto &[kind, pair] = pausing.front();
  const std::array<int, 4> v = vertices_of(kind, pair, state);
  const dvec3 x = from_.at(v[0]);
  const auto coordinate = [](double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.4g", value);
    return std::string(text);
  };
  return " at (" + coordinate(x.x) + ", " + coordinate(x.y) + ", " + coordinate(x.z) + ") m, between " +
         state.describe(v[0]) + " and " + state.describe(v[static_cast<std::size_t>(kind + 1)]) +
         (pausing.size() > 1 ? ", and at " + std::to_string(pausing.size() - 1) + " pairs more" : "");
}

bool PenetrationHandling::release(State &state, const std::vector<std::pair<int, kernels::pair>> &pausing)
{
  const int before = state.exemptions.temporary();
  for (const auto &[kind, pair] : pausing) {
    const std::array<int, 4> v = vertices_of(kind, pair, state);
    for (int a = 0; a <= kind; ++a)
      for (int b = kind + 1; b < 4; ++b) {
        const bool cloth_a = v[a] < state.cloth_vertices, cloth_b = v[b] < state.cloth_vertices;
        if (cloth_a && cloth_b)
          state.exemptions.let_pass(v[a], v[b]);
        else if (cloth_a)
          state.exemptions.let_go(v[a], state.object_of(v[b]));
        else
          state.exemptions.let_go(v[b], state.object_of(v[a]));
      }
  }
  const int added = state.exemptions.temporary() - before;
  state.report.released += added;
  if (added > 0) state.exemptions.upload();
  return added > 0;
}

void PenetrationHandling::run(State &state)
{
  Backend &b = *state.backend;
  from_.copy_from(state.position);
  const double margin = certified_ * state.largest_thickness;
  bool projected = false, first_piece = true;
  state.impact.resize(0);
  for (int waits = 0;; ++state.report.substeps, first_piece = false) {
    if (state.impact.size()) {
      state.impact.resize(0);
      for (PairList *list : {&state.vertex_face, &state.edge_edge})
        CAMA_LAUNCH(b, forget_impacts, list->gap_bound.size(), list->gap_bound);
    }
    bool certified = false,
         localized = false;  // every pair but known impacts, for the motion as it is; but for what moved since
    int fewest = 0x7fffffff, idle_passes = 0;
    for (int pass = 0; pass < state.options.max_impact_passes; ++pass) {
      Detection now = detect(state, first_piece, localized, 0, 0);
      if (now.escaped) {
        const int faces = now.found ? 0 : state.vertex_face.pairs.size(),
                  edges = now.found ? 0 : state.edge_edge.pairs.size();
        const bool renewed =
            search_.update(state, from_, state.position_next, margin) == CandidateSearch::Change::renewed;
        localized &= !renewed;
        now = detect(state, first_piece, localized, renewed ? 0 : faces, renewed ? 0 : edges);
      }
      if (pass == 0 && state.report.substeps == 1) state.report.impacts = now.found;
      certified = now.found == 0 && !state.options.cubic_impacts;  // the cubic knows no distances
      if (now.found == 0) break;
      idle_passes = now.found < fewest ? 0 : idle_passes + 1;
      fewest = std::min(fewest, now.found);
      if (idle_passes == max_idle_passes && !state.options.commit) break;
      add_impacts(state, now.found);
      ++state.report.impact_passes;
      if (!projected) projection_.start(state, from_, state.position_next);
      projected = localized = true;
      projection_.run(state, state.position_next);
    }
    if (!state.options.commit) break;
    if (certified && state.impact.size() == 0) break;  // every pair keeps its distance all the way
    if (!certified) {
      search_.update(state, from_, state.position_next, margin);
      CandidateSearch::find_directions(state, from_, 0x7fffffff, 0x7fffffff);
    }
    const double sigma = commit(state, certified);
    if (sigma >= 1) {
      state.position_next.swap(committed_);
      break;
    }
    if (++waits >= max_waits) {
      const auto pausing = pausing_pairs(state);
      if (state.options.pinch == Pinch::stop || !release(state, pausing))
        throw CollisionError(
            "step " + std::to_string(state.report.step) + ": a moving obstacle or pin pinches cloth without a way out" +
            place(state, pausing) +
            "; slow the motion, lower the contact thickness, keep the bodies apart, or set pinch to release");
    }
    // The obstacles wait at sigma of their way; cloth goes on towards the same target from there.
    from_.swap(committed_);
    if (waits == max_waits) {
      waits = 0;
      search_.run(state, from_, state.position_next);
    }
  }
  CAMA_LAUNCH(*state.backend, follow_positions, state.cloth_vertices, state.time_step, state.implicit_step, state.fixed,
              state.position, state.base_position(), state.position_next, state.velocity_next);
}

}  // namespace cama
