// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <utility>
#include <vector>

#include "run/pipeline.hpp"
#include "stages/candidate_search.hpp"
#include "stages/certified_commit.hpp"
#include "stages/gap_bounds.hpp"
#include "stages/impact_projection.hpp"
#include "stages/listed_pairs.hpp"

namespace cama {

/// Repeats continuous detection and projection of impacts; then the certified commit. Moving obstacles that would pass
/// through cloth within the step divide the step.
class PenetrationHandling final : public StageOn<const Options, StepReport, const Clock, MeshState, ContactState,
                                                 Exemptions, BoundsState, ReactionState> {
public:
  PenetrationHandling(Backend &backend, CandidateSearch &search, ListedPairs &listed, GapBounds &bounds);
  std::string_view name() const override { return "penetration handling"; }
  std::string reason() const override { return "contact"; }
  void run_on(const Rooms &state) override;

private:
  struct Detection {
    int escaped;   // vertices that leave their boxes
    int found;     // new impacts, which are in the list of pairs with work
  };
  /// Finds how far vertices end from where they were predicted, and how many leave their boxes.
  void find_errors(const Rooms &state, bool localized);
  /// The same for faces and edges.
  void find_feature_errors(const Rooms &state);
  /// Updates the search for the motion; bounds after a new one are those of this motion.
  CandidateSearch::Change update(const Rooms &state);
  /// Continuous detection over the motion; waits for the device once. bounded: the motion starts where that starts for
  /// which pairs have bounds. *_from: pairs that an earlier detection over the same motion has decided.
  Detection detect(const Rooms &state, bool bounded, bool localized, int vertex_face_from, int edge_edge_from);
  /// Appends what the last detection has found to the impacts of a pass.
  void collect(const Rooms &state, int found);
  /// Makes the impacts of a pass. repeat: they count as found before in this step.
  void add_impacts(const Rooms &state, bool repeat);
  std::string place(const Rooms &state, const std::vector<std::pair<int, kernels::pair>> &pausing);
  /// Throws SolverError where the motion makes edges of the cloth much longer.
  void check_stretch(const Rooms &state);
  bool release(const Rooms &state, const std::vector<std::pair<int, kernels::pair>> &pausing);

  CandidateSearch &search_;
  ImpactProjection projection_;
  CertifiedCommit commit_;
  Stream<dvec3> from_;
  ListedPairs &listed_;
  GapBounds &bounds_;
  Stream<float> error_;  // of vertices, then of faces and edges, as in impact.h
  Stream<unsigned char> motion_;  // likewise
  bool escapes_[2] = {false, false};  // vertices left their boxes in the first pass, in a later one, last time
  Stream<int> detection_;
  Stream<int> found_;  // impacts of a pass, by the codes of their pairs, in any order
  const Stream<float> no_rest_;
  Stream<int> repeated_;  // [1] number of impacts that were found before in this step; then of stretched edges
};

}  // namespace cama
