// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "pipeline.hpp"

namespace cama {

/// Candidate pairs of the step: features whose boxes over the motion from `position` to a target overlap. One search feeds proximity
/// checking, continuous detection and the commit; it grows as vertices leave their boxes.
class CandidateSearch {
public:
  enum class Change { none, grown, renewed };   ///< of the lists
  explicit CandidateSearch(Backend &backend) : wanted_(backend), place_(backend), kept_(backend), corners_(backend), reduced_(backend) {}
  virtual ~CandidateSearch() = default;
  /// Fills state.vertex_face and state.edge_edge for motion from -> to.
  virtual void run(State &state, const Stream<dvec3> &from, const Stream<dvec3> &to) = 0;
  /// Makes the lists hold every pair of the motion from -> to with `margin` to spare. Earlier pairs stay, with `known` and `direction`;
  /// further ones come behind them, or, after large changes, all are made anew.
  virtual Change update(State &state, const Stream<dvec3> &from, const Stream<dvec3> &to, double margin) = 0;

  /// Directions between the closest points at `from`, for the pairs from `first_*` on and those without one.
  static void find_directions(State &state, const Stream<dvec3> &from, int first_vertex_face, int first_edge_edge);

protected:
  /// Takes the pairs that are exempt out of those from `first` on.
  void drop_exempt(State &state, int kind, int first);

  /// Of all positions of the motion, into state.bounds.
  void find_bounds(State &state, const Stream<dvec3> &from, const Stream<dvec3> &to);

private:
  Stream<int> wanted_, place_;
  Stream<kernels::pair> kept_;
  Stream<dvec3> corners_, reduced_;
};

/// The default: vertices ask a tree of faces, edges ask a tree of edges, by count, scan and fill. Localised updates (section 4.1 of the
/// paper): only features with vertices that left their boxes ask, and only for pairs that did not overlap before.
class TreeSearch final : public CandidateSearch {
public:
  explicit TreeSearch(Backend &backend);
  void run(State &state, const Stream<dvec3> &from, const Stream<dvec3> &to) override;
  Change update(State &state, const Stream<dvec3> &from, const Stream<dvec3> &to, double margin) override;

private:
  /// Vertices that ask the tree of some faces.
  struct FaceQuery {
    int mode;
    const Stream<int> *items;
    int leaves;
    const Stream<int> *order;
    const Stream<kernels::face_nodes> *leaf_face;
    const Stream<kernels::box_group> *tree;
  };
  void sort_features(State &state);
  void build_trees(State &state);
  void build_faces(State &state, int leaves, const Stream<kernels::face_nodes> &leaf_face, Stream<kernels::box_group> &tree);
  static void build_levels(Backend &backend, int leaves, Stream<kernels::box_group> &tree);
  void query(State &state, const std::vector<FaceQuery> &faces, int edge_mode, const Stream<int> &leaves);

  const int batch_;   // items that walk a tree together: on processors those of a group; on devices each has its own thread
  Stream<key64> key_;
  Stream<int> slot_, count_, offset_;
  Stream<int> identity_, asking_;   // asking_: along the curve
  Stream<kernels::face_nodes> leaf_face_, changed_leaf_face_;
  Stream<kernels::edge_nodes> leaf_edge_;
  Stream<kernels::pair> totals_;
  Stream<int> changed_, flag_, offsets_, changed_vertex_, changed_face_, changed_edge_;
  Stream<kernels::box> before_;
  Stream<kernels::box_group> changed_groups_;
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
