// SPDX-License-Identifier: Apache-2.0
#include "stages/penetration_handling.hpp"

#include <algorithm>
#include <array>
#include <cstdio>

#include "device/ceil_divide.hpp"
#include "device/launch.hpp"
#include "stages/rigid_zones.hpp"

namespace cama {
namespace {
constexpr int max_pauses = 64;   // of moving obstacles in a step
// Passes that find no fewer impacts than an earlier one: without a commit (paper mode), the cloth is then tangled
// permanently.
constexpr int max_idle_passes = 10;
// With impact zones: the step is divided, at most this often, where impacts are left after so many passes or where
// their projection stretches an edge too much.
constexpr int max_divisions_of_impacts = 2, passes_until_divided = 10;
// With impact zones: passes after which every impact that is found counts as found before.
constexpr int passes_until_rigid = 20;
}  // namespace

PenetrationHandling::PenetrationHandling(Backend &b, CandidateSearch &search, ListedPairs &listed, GapBounds &bounds)
    : search_(search), projection_(b), commit_(b, listed), from_(b), listed_(listed), bounds_(bounds), error_(b),
      motion_(b), detection_(b, DETECTION_COUNTS), found_(b), repeated_(b, 1)
{}

void PenetrationHandling::find_errors(const Rooms &state, bool localized)
{
  const long long features = static_cast<long long>(state.mesh.vertices) + state.mesh.faces + state.mesh.edges;
  error_.resize(features);
  motion_.resize(features);
  detection_.fill_zero();
  CAMA_LAUNCH(*state.backend, find_prediction_errors, state.mesh.vertices, from_, state.mesh.position_next,
              state.bounds.predicted, state.mesh.inverse_mass, localized ? 1 : 0, projection_.moved(),
              state.bounds.vertex_box, search_.end_boxes(), state.bounds.box_origin(),
              certified_distance * state.contact.largest_thickness, error_, motion_, detection_);
}

void PenetrationHandling::find_feature_errors(const Rooms &state)
{
  CAMA_LAUNCH(*state.backend, find_feature_motions, state.mesh.faces + state.mesh.edges, state.mesh.vertices,
              state.mesh.faces, state.mesh.face, state.mesh.edge, error_, motion_);
}

CandidateSearch::Change PenetrationHandling::update(const Rooms &state)
{
  const CandidateSearch::Change change =
      search_.update(state, from_, state.mesh.position_next, certified_distance * state.contact.largest_thickness);
  if (change == CandidateSearch::Change::renewed) {
    state.bounds.predicted.copy_from(state.mesh.position_next);
    bounds_.find_all(state, from_, state.bounds.predicted);
  }
  return change;
}

PenetrationHandling::Detection PenetrationHandling::detect(const Rooms &state, bool bounded, bool localized,
                                                           int vertex_face_from, int edge_edge_from)
{
  Backend &b = *state.backend;
  const PairList &vertex_face = state.contact.vertex_face, &edge_edge = state.contact.edge_edge;
  const int all = 0x7fffffff, first = vertex_face.pairs.size() - vertex_face_from,
            pairs = first + edge_edge.pairs.size() - edge_edge_from;
  CandidateSearch::find_directions(state, from_, all, all);
  listed_.resize(state);
  find_errors(state, localized);
  find_feature_errors(state);
  CAMA_LAUNCH_TEAMS(void, b, select_open_pairs, PAIR_TEAM, ceil_divide(pairs, RUN_PAIRS), pairs, first,
                    state.mesh.vertices, state.mesh.faces, state.options.paper.impact_zones ? 1 : 0, vertex_face.pairs,
                    edge_edge.pairs, certified_distance, state.contact.largest_thickness, error_, motion_,
                    vertex_face_from, edge_edge_from, bounded ? vertex_face.gap_bound.size() : 0, vertex_face.gap_bound,
                    bounded ? edge_edge.gap_bound.size() : 0, edge_edge.gap_bound, listed_.flag, detection_);
  CAMA_LAUNCH_TEAMS(void, b, select_ccd_pairs, PAIR_TEAM, listed_.list_teams(), vertex_face.pairs, edge_edge.pairs,
                    state.mesh.face, state.mesh.edge, certified_distance, from_, state.mesh.position_next,
                    state.contact.vertex_contact, vertex_face.direction, edge_edge.direction, listed_.flag,
                    listed_.list, detection_);
  const auto find_impacts = [&](auto &&...arguments) {
    if (listed_.many())
      CAMA_LAUNCH_TEAMS(void, b, find_many_impacts, PAIR_TEAM, listed_.list_teams(), arguments...);
    else
      CAMA_LAUNCH_TEAMS(void, b, find_impacts, PAIR_TEAM, listed_.list_teams(), arguments...);
  };
  find_impacts(state.options.paper.cubic_impacts ? 1 : 0, vertex_face.pairs, edge_edge.pairs, state.mesh.face,
               state.mesh.edge, from_, state.mesh.position_next, state.contact.vertex_contact, certified_distance,
               listed_.list, detection_);
  const std::vector<int> counts = detection_.download();
  return {counts[DETECTION_ESCAPED], counts[DETECTION_IMPACTS]};
}

void PenetrationHandling::collect(const Rooms &state, int found)
{
  if (found == 0) return;
  const int first = found_.size();
  found_.grow(static_cast<long long>(first) + found);
  CAMA_LAUNCH_TEAMS(void, *state.backend, collect_impacts, PAIR_TEAM, listed_.list_teams(), first, listed_.list, found_,
                    detection_);
}

void PenetrationHandling::add_impacts(const Rooms &state, bool repeat)
{
  Backend &b = *state.backend;
  const int first = state.contact.impact.size(), found = found_.size();
  listed_.order(state, found_, found);
  state.contact.impact.grow(static_cast<long long>(first) + found);
  CAMA_LAUNCH(b, fill_impacts, found, state.options.paper.cubic_impacts ? 1 : 0, repeat ? 1 : 0, listed_.index,
              state.contact.vertex_face.pairs, state.contact.edge_edge.pairs, state.mesh.face, state.mesh.edge, from_,
              state.mesh.position_next, state.contact.vertex_contact, certified_distance, impact_distance, first,
              state.contact.vertex_face.gap_bound, state.contact.edge_edge.gap_bound, state.contact.impact, repeated_);
}

namespace {

/// The four vertices of a pair; side A's come first.
std::array<int, 4> vertices_of(int kind, const kernels::pair &p, const MeshState &mesh)
{
  if (kind == 0) {
    const auto f = mesh.face.at(p.b);
    return {p.a, f.node[0], f.node[1], f.node[2]};
  }
  const auto e = mesh.edge.at(p.a), f = mesh.edge.at(p.b);
  return {e.node[0], e.node[1], f.node[0], f.node[1]};
}

}  // namespace

std::string PenetrationHandling::place(const Rooms &state, const std::vector<std::pair<int, kernels::pair>> &pausing)
{
  if (pausing.empty()) return "";
  const auto &[kind, pair] = pausing.front();
  const std::array<int, 4> v = vertices_of(kind, pair, state.mesh);
  const dvec3 x = from_.at(v[0]);
  const auto coordinate = [](double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.4g", value);
    return std::string(text);
  };
  return " at (" + coordinate(x.x) + ", " + coordinate(x.y) + ", " + coordinate(x.z) + ") m, between " +
         state.mesh.describe(v[0]) + " and " + state.mesh.describe(v[static_cast<std::size_t>(kind + 1)]) +
         (pausing.size() > 1 ? ", and at " + std::to_string(pausing.size() - 1) + " more pairs" : "");
}

bool PenetrationHandling::release(const Rooms &state, const std::vector<std::pair<int, kernels::pair>> &pausing)
{
  const int before = state.exemptions.temporary();
  for (const auto &[kind, pair] : pausing) {
    const std::array<int, 4> v = vertices_of(kind, pair, state.mesh);
    for (int a = 0; a <= kind; ++a)
      for (int b = kind + 1; b < 4; ++b) {
        const bool cloth_a = v[a] < state.mesh.cloth_vertices, cloth_b = v[b] < state.mesh.cloth_vertices;
        if (cloth_a && cloth_b)
          state.exemptions.let_pass(v[a], v[b]);
        else if (cloth_a)
          state.exemptions.let_go(v[a], state.mesh.object_of(v[b]));
        else
          state.exemptions.let_go(v[b], state.mesh.object_of(v[a]));
      }
  }
  const int added = state.exemptions.temporary() - before;
  state.report.released += added;
  if (added > 0) state.exemptions.upload();
  return added > 0;
}

void PenetrationHandling::check_stretch(const Rooms &state)
{
  repeated_.fill_zero();
  CAMA_LAUNCH(*state.backend, count_stretched, state.mesh.edges, state.mesh.cloth_vertices, state.mesh.edge, no_rest_,
              from_, state.mesh.position_next, repeated_);
  if (const int edges = repeated_.at(0))
    throw SolverError("step " + std::to_string(state.report.step) + ": impacts stretch " + std::to_string(edges) +
                      " edges by half of their length");
}

void PenetrationHandling::run_on(const Rooms &state)
{
  Backend &b = *state.backend;
  from_.copy_from(state.mesh.position);
  const bool zones = state.options.paper.impact_zones,
             divisible = zones && state.time.division < std::min(state.options.max_divisions, max_divisions_of_impacts);
  bool projected = false, bounded = true;  // bounded: the bounds of pairs are for a motion that starts here
  state.contact.impact.resize(0);
  if (state.reactions.measured) state.reactions.push.fill_zero();
  for (int pauses = 0;; ++state.report.substeps, bounded = false) {
    if (state.contact.impact.size()) {
      state.contact.impact.resize(0);
      for (PairList *list : {&state.contact.vertex_face, &state.contact.edge_edge})
        CAMA_LAUNCH(b, forget_impacts, list->gap_bound.size(), list->gap_bound);
    }
    // certified: every pair except known impacts is certified for the current motion; localized: except those that
    // moved since.
    bool certified = false, localized = false;
    if (zones) {  // about the motion of this piece
      repeated_.fill_zero();
      projected = false;
    }
    int fewest = 0x7fffffff, idle_passes = 0;
    for (int pass = 0; pass < state.options.max_impact_passes; ++pass) {
      found_.resize(0);
      // Where vertices left their boxes in the last such pass, pairs are looked for before all are tested.
      bool &expected = escapes_[pass > 0];
      Detection now = {0, 0};
      int faces = 0, edges = 0;
      if (expected) {
        find_errors(state, localized);
        now.escaped = detection_.at(DETECTION_ESCAPED);
      } else {
        now = detect(state, bounded, localized, 0, 0);
        if (now.escaped) {
          faces = state.contact.vertex_face.pairs.size();
          edges = state.contact.edge_edge.pairs.size();
          collect(state, now.found);
        }
      }
      if (now.escaped && update(state) == CandidateSearch::Change::renewed) {
        localized = false;
        bounded = true;
        faces = edges = 0;
        found_.resize(0);
      }
      if (now.escaped || expected) now.found = detect(state, bounded, localized, faces, edges).found;
      expected = now.escaped > 0;
      collect(state, now.found);
      const int found = found_.size();
      if (pass == 0 && state.report.substeps == 1) state.report.impacts = found;
      certified = found == 0 && !state.options.paper.cubic_impacts;  // the cubic certifies no distances
      if (found == 0) break;
      idle_passes = found < fewest ? 0 : idle_passes + 1;
      fewest = std::min(fewest, found);
      if (divisible && pass == passes_until_divided)
        throw SolverError("step " + std::to_string(state.report.step) + ": " + std::to_string(found) +
                          " impacts are found after " + std::to_string(pass) + " projections");
      if (idle_passes == max_idle_passes && !state.options.commit && !zones) break;
      add_impacts(state, zones && pass >= passes_until_rigid);
      ++state.report.impact_passes;
      if (!projected) projection_.start(state, from_, state.mesh.position_next);
      projected = localized = true;
      projection_.run(state, state.mesh.position_next);
      if (zones && repeated_.at(0) > 0)
        move_rigid_zones(state, from_, projection_.wanted(), state.mesh.position_next, projection_.moved());
    }
    if (divisible && projected) check_stretch(state);
    if (!state.options.commit) break;
    if (certified && state.contact.impact.size() == 0) break;  // every pair keeps its distance throughout
    if (!certified) {
      bounded |= update(state) == CandidateSearch::Change::renewed;
      CandidateSearch::find_directions(state, from_, 0x7fffffff, 0x7fffffff);
      find_errors(state, false);
      find_feature_errors(state);
    }
    const double sigma = commit_.run(state, search_, from_, certified, bounded ? &error_ : nullptr);
    if (sigma >= 1) {
      state.mesh.position_next.swap(commit_.committed());
      break;
    }
    if (++pauses >= max_pauses) {
      const auto pausing = commit_.pausing_pairs(state);
      if (state.options.pinch == Pinch::stop || !release(state, pausing))
        throw CollisionError(
            "step " + std::to_string(state.report.step) + ": a moving obstacle or pin pinches cloth without a way out" +
            place(state, pausing) +
            "; slow the motion, lower the contact thickness, keep the obstacles apart, leave limbs of a character that "
            "pass through it out (leave_out), or set pinch to release");
    }
    // The obstacles pause at the share sigma of their way; cloth continues towards the same target from there.
    from_.swap(commit_.committed());
    if (pauses == max_pauses) {
      pauses = 0;
      search_.run(state, from_, state.mesh.position_next);
    }
  }
  if (state.time.predicted) return;  // FinishStep keeps what led to the positions
  CAMA_LAUNCH(*state.backend, follow_positions, state.mesh.cloth_vertices, state.time.step, state.time.implicit_step,
              state.mesh.fixed, state.mesh.position, state.mesh.base_position(state.time), state.mesh.position_next,
              state.mesh.velocity_next);
}

}  // namespace cama
