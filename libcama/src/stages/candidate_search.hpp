// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "pipeline.hpp"

namespace cama {

/// Candidate pairs of the step: features whose boxes over the motion from `position` to a target overlap. One search feeds proximity
/// checking, continuous detection and the commit; it grows as vertices leave their boxes.
class CandidateSearch {
public:
  explicit CandidateSearch(Backend &backend) : escaped_(backend, 1) {}
  virtual ~CandidateSearch() = default;
  /// Fills state.vertex_face and state.edge_edge for motion from -> to.
  virtual void run(State &state, const Stream<dvec3> &from, const Stream<dvec3> &to) = 0;
  /// Makes the lists hold every pair of the motion from -> to, with `margin` to spare. Where `known` and `direction` of earlier pairs
  /// are lost, or pairs are new, `direction` is made anew; returns false if no vertex had left its box.
  virtual bool update(State &state, const Stream<dvec3> &from, const Stream<dvec3> &to, double margin);

protected:
  /// Is every motion from -> to inside the boxes of the last search, with `margin` to spare?
  bool covers(State &state, const Stream<dvec3> &from, const Stream<dvec3> &to, double margin);
  /// Directions between the closest points at `from`, for the pairs from `first_*` on.
  void find_directions(State &state, const Stream<dvec3> &from, int first_vertex_face, int first_edge_edge);

private:
  Stream<int> escaped_;
};

/// The default: vertices ask a tree of faces, edges ask a tree of edges, by count, scan and fill.
class TreeSearch final : public CandidateSearch {
public:
  explicit TreeSearch(Backend &backend);
  void run(State &state, const Stream<dvec3> &from, const Stream<dvec3> &to) override;

private:
  void find_bounds(State &state, const Stream<dvec3> &from, const Stream<dvec3> &to);
  void build_tree(State &state, int leaves, const Stream<kernels::box> &boxes, Stream<int> &order, Stream<kernels::box> &tree, bool sort);

  Stream<dvec3> corners_, reduced_;
  Stream<key64> key_;
  Stream<int> slot_, count_, offset_;
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
