// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "pipeline.hpp"

namespace cama {

/// Candidate pairs of the step: boxes over the motion from `position` to a target, two trees, count-scan-fill queries.
/// One search feeds proximity checking, continuous detection and the commit, as long as no vertex leaves its box.
class CandidateSearch {
public:
  explicit CandidateSearch(Backend &backend);
  /// Fills state.vertex_face and state.edge_edge for motion from -> to.
  void run(State &state, const Stream<dvec3> &from, const Stream<dvec3> &to);
  /// Is every motion from -> to inside the boxes of the last search, with `margin` to spare?
  bool covers(State &state, const Stream<dvec3> &from, const Stream<dvec3> &to, double margin);

private:
  void find_bounds(State &state, const Stream<dvec3> &from, const Stream<dvec3> &to);
  void build_tree(State &state, int leaves, const Stream<kernels::box> &boxes, Stream<int> &order, Stream<kernels::box> &tree, bool sort);

  Stream<dvec3> corners_, reduced_;
  Stream<key64> key_;
  Stream<int> slot_, count_, offset_, escaped_;
  Stream<int> identity_;
  int searches_since_sort_ = 0;
};

/// The step's search, over the ballistic motion.
class ProximitySearch final : public Stage {
public:
  explicit ProximitySearch(CandidateSearch &search) : search_(search) {}
  std::string_view name() const override { return "candidate search"; }
  std::string reason() const override { return "contact"; }
  void run(State &state) override;

private:
  CandidateSearch &search_;
};

}  // namespace cama
