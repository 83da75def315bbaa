// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "run/pipeline.hpp"
#include "stages/flagged_pairs.hpp"

namespace cama {

/// Candidate pairs of the step: features whose boxes over the motion from `position` to a target overlap. One search
/// feeds proximity checking, continuous detection and the commit; it grows as vertices leave their boxes.
class CandidateSearch {
public:
  enum class Change { none, grown, renewed };   ///< of the lists
  explicit CandidateSearch(Backend &backend)
      : wanted_(backend), place_(backend), kept_(backend), corners_(backend), reduced_(backend)
  {}
  virtual ~CandidateSearch() = default;
  /// Fills state.vertex_face and state.edge_edge for motion from -> to.
  virtual void run(State &state, const Stream<dvec3> &from, const Stream<dvec3> &to) = 0;
  /// Makes the lists hold every pair of the motion from -> to with `margin` to spare. Earlier pairs stay, with
  /// `direction` and `gap_bound`; further ones come behind them, or, after large changes, all are made anew.
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

/// The default: vertices ask trees of faces, edges ask trees of edges, by count, scan and fill. The cloth, obstacles
/// that move and those that do not have trees of their own, so that obstacles never meet obstacles, cloth meets cloth
/// only where contact.self is on, and obstacles at rest are boxed and sorted once in a thousand searches. Localised
/// updates (section 4.1 of the paper): only features with vertices that left their boxes ask, and only for pairs that
/// did not overlap before.
class TreeSearch final : public CandidateSearch {
public:
  /// flagged: its flags are overwritten by every search.
  TreeSearch(Backend &backend, FlaggedPairs &flagged);
  void run(State &state, const Stream<dvec3> &from, const Stream<dvec3> &to) override;
  Change update(State &state, const Stream<dvec3> &from, const Stream<dvec3> &to, double margin) override;

private:
  /// Features of some objects, under trees of the state.
  struct Group {
    explicit Group(Backend &b) : face(b), edge(b), query_vertices(b), query_order(b), leaf_face(b), leaf_edge(b) {}
    Stream<int> face, edge, query_vertices;          // by number; vertices that are tested against faces
    Stream<int> query_order;                // along the curve
    Stream<kernels::face_nodes> leaf_face;
    Stream<kernels::edge_nodes> leaf_edge;
    FeatureTrees *trees = nullptr;
  };
  /// Vertices that ask the tree of some faces.
  struct FaceQuery {
    int mode;
    const Stream<int> *items;
    int leaves;
    const Stream<int> *order;
    const Stream<kernels::face_nodes> *leaf_face;
    const Stream<kernels::bvh8_node> *tree;
  };
  /// Edges that ask the tree of some edges.
  struct EdgeQuery {
    int mode;
    const Stream<int> *items;
    const Stream<kernels::edge_nodes> *item_edge;
    const Group *group;
  };
  void find_groups(State &state);
  void sort_features(State &state, Group &group);
  void build_trees(State &state, Group &group, bool faces, bool edges);
  void build_faces(State &state, int leaves, const Stream<kernels::face_nodes> &leaf_face,
                   Stream<kernels::bvh8_node> &tree);
  void place_static(State &state, const Stream<dvec3> &from, const Stream<dvec3> &to);
  static void build_levels(Backend &backend, int leaves, Stream<kernels::bvh8_node> &tree);
  void query(State &state, const std::vector<FaceQuery> &faces, const std::vector<EdgeQuery> &edges);

  const int
      batch_;   // items that walk a tree together: on cpu_count those of a group; on devices each has its own thread
  Group cloth_, moving_, static_;   // static_: obstacles that never move
  int boxed_ = 0;                  // vertices with fresh boxes in every search: the first ones
  bool self_ = false, found_ = false;
  Stream<key64> key_;
  Stream<int> &slot_;   // hits of items; the memory of flags, which are not needed during a search
  Stream<int> count_, offset_;
  Stream<int> identity_;
  Stream<kernels::face_nodes> changed_leaf_face_;
  Stream<kernels::edge_nodes> changed_leaf_edge_;
  Stream<kernels::pair> totals_;
  Stream<int> changed_, flag_, offsets_, changed_vertex_, changed_face_, changed_edge_;
  Stream<kernels::box> before_;
  Stream<kernels::bvh8_node> changed_groups_;
  int searches_since_sort_ = 0, sorts_since_placed_ = 0;
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
