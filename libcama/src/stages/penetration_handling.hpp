// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <utility>
#include <vector>

#include "run/pipeline.hpp"
#include "stages/candidate_search.hpp"
#include "stages/flagged_pairs.hpp"

namespace cama {

/// Inelastic projection of all impacts at once (section 4). As one linear system by conjugate gradient with an active
/// set, as in the paper; or, the default, with the condition that impulses only push, by accelerated projected
/// gradient. Matrix-free both.
class ImpactProjection {
public:
  explicit ImpactProjection(Backend &backend);
  /// Before the first run of a step: where the solve wants the vertices, and from where.
  void start(State &state, const Stream<dvec3> &from, const Stream<dvec3> &wanted);
  /// Moves `positions` so that every impact of the state ends apart by its target at least, but no vertex further than
  /// any impact's motion and target ask for.
  void run(State &state, Stream<dvec3> &positions);
  /// [vertices] 1: moved by the last run.
  const Stream<int> &moved() const { return moved_; }

private:
  void solve_linear_system(State &state);
  void solve_pushing(State &state);
  void multiply(State &state, double regularisation, const Stream<double> &x, Stream<double> &q);
  void spread(State &state, const Stream<double> &lambda);

  Stream<kernels::element_nodes> nodes_;
  Incidence incidence_;
  Stream<int> count_, active_, dropped_, moved_;
  Stream<double> constraint_, diagonal_, majorant_, lambda_, r_, z_, p_, q_, partial_, scalar_;
  Stream<dvec3> y_, wanted_;
  Stream<double> length_, longest_, longer_, largest_;  // of motions: by vertex; the longest of what is hit
};

/// Continuous detection, projection of impacts, repeated; then the certified commit. Moving obstacles that would run
/// over cloth within the step divide it.
class PenetrationHandling final : public Stage {
public:
  PenetrationHandling(Backend &backend, CandidateSearch &search, FlaggedPairs &flagged);
  std::string_view name() const override { return "penetration handling"; }
  std::string reason() const override { return "contact"; }
  void run(State &state) override;
  /// Shares of a pair's smallest contact thickness: certified distance, distance after an impact.
  void set_distances(double certified, double target)
  {
    certified_ = certified;
    target_ = target;
  }

private:
  /// What one look at the motion finds; one wait. first_piece: motion starts where proximity checking saw the pairs.
  /// *_done: pairs that an earlier look at it has found to be no impacts.
  struct Detection {
    int escaped, found;
  };  // vertices that leave their boxes; impacts not yet known, of the pairs in the lists
  Detection detect(State &state, bool first_piece, bool localized, int vertex_face_done, int edge_edge_done);
  void add_impacts(State &state, int found);
  double commit(State &state, bool certified);
  std::vector<std::pair<int, kernels::pair>> pausing_pairs(State &state);
  std::string place(State &state, const std::vector<std::pair<int, kernels::pair>> &pausing);
  bool release(State &state, const std::vector<std::pair<int, kernels::pair>> &pausing);

  CandidateSearch &search_;
  ImpactProjection projection_;
  Stream<dvec3> from_, committed_;
  FlaggedPairs &flagged_;  // in the commit its flags are what became of each pair
  Stream<float> prediction_error_;
  Stream<int> detection_;
  Stream<int> fraction_, fraction_before_, sigma_, counter_;
  double certified_ = 1e-2, target_ = 0.1;
};

}  // namespace cama
