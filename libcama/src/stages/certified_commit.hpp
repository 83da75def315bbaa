// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <utility>
#include <vector>

#include "run/pipeline.hpp"
#include "stages/candidate_search.hpp"
#include "stages/listed_pairs.hpp"
#include "stages/pair_runs.hpp"

namespace cama {

/// Shares of a pair's smallest contact thickness: the distance that a step keeps, and the distance after an impact.
inline constexpr double certified_distance = 1e-2, impact_distance = 0.1;

/// The certified commit: as much of the motion from `from` to `position_next` as keeps the distance of every candidate
/// pair. Each vertex goes a share of its way; moving obstacles pause where cloth has nowhere to go.
class CertifiedCommit {
public:
  using Rooms = SearchRooms;
  CertifiedCommit(Backend &backend, ListedPairs &listed);
  /// Fills committed(). Returns the share of their motion that obstacles completed; 1: all of it. certified: every pair
  /// except known impacts has been certified for this motion.
  /// search: has the candidates, and finds those that it left out where vertices go a part of their way only.
  /// errors: how far this motion is from that for which the bounds of pairs hold (impact.h); null: they do not hold.
  double run(const Rooms &state, CandidateSearch &search, const Stream<dvec3> &from, bool certified,
             const Stream<float> *errors);
  Stream<dvec3> &committed() { return committed_; }  ///< [vertices] m
  /// The pairs that made obstacles pause in the last run, with their kind, ordered.
  std::vector<std::pair<int, kernels::pair>> pausing_pairs(const Rooms &state);

private:
  /// Lists for a pass the conditional pairs of which the one before has truncated a vertex; truncated: how many it has.
  void recheck(const Rooms &state, const Stream<dvec3> &from, int pass, int truncated);
  /// Appends the pairs that the search left out and that meet where vertices are truncated, and lists them; returns
  /// whether there are any.
  bool complete(const Rooms &state, CandidateSearch &search, const Stream<dvec3> &from);

  ListedPairs &listed_;  // its flags hold the state of each pair
  Stream<dvec3> committed_;
  Stream<int> fraction_, fraction_before_, vertex_changed_, cell_marked_;
  PairRuns runs_;
  Stream<unsigned char> marked_;  // vertices, then faces and edges, as in commit.h
  Stream<kernels::commit_loss> loss_;
  Stream<int> outcome_;
  const Stream<float> no_errors_;
};

}  // namespace cama
