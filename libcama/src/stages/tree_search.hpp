// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "stages/candidate_search.hpp"
#include "stages/listed_pairs.hpp"

namespace cama {

/// The default: vertices query trees of faces, edges query trees of edges, by count, scan and fill. The cloth, moving
/// obstacles and static ones have separate trees, so that obstacles are never tested against obstacles, cloth is tested
/// against cloth only if contact.self is on, and static obstacles are boxed and sorted once in a thousand searches.
/// Pairs that one coordinate separates at both ends of the step are left out: cloth that moves far in a step passes the
/// places of much other cloth at other times.
/// Localised updates (section 4.1 of the paper): only features with vertices that left their boxes query, and only for
/// pairs that did not overlap before.
class TreeSearch final : public CandidateSearch {
public:
  /// listed: every search overwrites its flags.
  TreeSearch(Backend &backend, ListedPairs &listed);
  void run(const SearchRooms &state, const Stream<dvec3> &from, const Stream<dvec3> &to) override;
  Change update(const SearchRooms &state, const Stream<dvec3> &from, const Stream<dvec3> &to, double margin) override;
  bool complete(const SearchRooms &state, const Stream<dvec3> &from, const Stream<dvec3> &to, double margin) override;

  /// Blocks of hits that there may be beside the rows of so many items.
  static long long most_hit_blocks(int items);

  TreeState &streams() { return trees_; }  ///< for State::visit

private:
  /// Features of some objects, under trees of the state.
  struct Group {
    explicit Group(Backend &b) : face(b), edge(b), query_vertices(b), query_order(b), leaf_face(b), leaf_edge(b) {}
    Stream<int> face, edge, query_vertices;  // by number; query_vertices: those that are tested against faces
    Stream<int> query_order;  // query_vertices along the curve
    Stream<kernels::face_nodes> leaf_face;
    Stream<kernels::edge_nodes> leaf_edge;
    FeatureTrees *trees = nullptr;
  };
  /// Vertices that query the tree of some faces.
  struct FaceQuery {
    int mode;
    const Stream<int> *items;
    int leaves;
    const Stream<int> *order;
    const Stream<kernels::face_nodes> *leaf_face;
    const Stream<kernels::bvh8_node> *tree;
    int shares = 1;
  };
  /// Edges that query the tree of some edges.
  struct EdgeQuery {
    int mode;
    const Stream<int> *items;
    const Stream<kernels::edge_nodes> *item_edge;
    const Group *group;
    int shares = 1;
  };
  void find_groups(const SearchRooms &state);
  void sort_features(const SearchRooms &state, Group &group);
  /// Features of a group, for trees of these.
  struct Features {
    Group *group;
    bool faces, edges;
  };
  /// A tree that has its first level.
  struct NewTree {
    int leaves;
    Stream<kernels::bvh8_node> *nodes;
  };
  /// changed: [vertices] flags; groups of leaves without such a vertex stay as they are. Empty: all are made.
  void build_trees(const SearchRooms &state, const std::vector<Features> &features, const Stream<int> &changed);
  static NewTree group_faces(const SearchRooms &state, int leaves, const Stream<kernels::face_nodes> &leaf_face,
                             const Stream<int> &changed, Stream<kernels::bvh8_node> &tree);
  enum class Motion { predicted, known };  ///< where a predicted motion ends is uncertain
  void search(const SearchRooms &state, const Stream<dvec3> &from, const Stream<dvec3> &to, Motion motion);
  void make_boxes(const SearchRooms &state, int n, const Stream<dvec3> &from, const Stream<dvec3> &to, Motion motion);
  void place_static(const SearchRooms &state, const Stream<dvec3> &from, const Stream<dvec3> &to, Motion motion);
  long long blocks_wanted() const;
  static void build_levels(Backend &backend, const std::vector<NewTree> &trees);
  bool in_parts(const FaceQuery &query) const;  ///< of the tree, with a work-item for each
  int part_of(const FaceQuery &query) const;
  int items_of(const FaceQuery &query) const;  ///< each vertex once for each part and share
  static int items_of(const EdgeQuery &query);
  int shares_of(int items) const;  ///< of a tree, in a full search: several if the device has enough work-items
  int vertex_shares_of(int vertices) const;
  /// How items walk a tree: a work-item for each, or for a batch; a team for neighbours together, or for each.
  enum class Walk { alone, batch, together, team };
  Walk walk_of(const FaceQuery &query) const;
  Walk walk_of(const EdgeQuery &query) const;
  Walk walk_of(int mode, int items, bool in_order) const;  ///< in_order: along the curve
  void query(const SearchRooms &state, const std::vector<FaceQuery> &faces, const std::vector<EdgeQuery> &edges);
  /// Lets boxes grow where the motion leaves them; returns how much that changes. Waits.
  kernels::change_counts find_changed(const SearchRooms &state, const Stream<dvec3> &from, const Stream<dvec3> &to,
                                      double margin);
  /// Appends the fresh pairs of the changed vertices.
  void query_changed(const SearchRooms &state, const Stream<dvec3> &from, const kernels::change_counts &of);

  const int batch_;  // items that a thread walks a tree for: 8 on CPUs, 1 on GPUs
  const int workers_;
  Motion motion_ = Motion::predicted;  // of the last search for all pairs
  // Of hits, for those of the next search that do not find room in their item's row; by motion, 0: not known.
  long long blocks_[2] = {0, 0};
  TreeState trees_;
  Group cloth_, moving_, static_;  // static_: obstacles that never move
  int boxed_ = 0;  // number of vertices, the first ones, whose boxes are made in every search
  bool self_ = false, found_ = false;
  Stream<key64> key_;
  Stream<int> &hit_;  // of items, in the memory of flags, which a search does not need
  Stream<int> taken_;  // blocks of hits, by pool; 0 between searches
  Stream<int> count_, offset_;
  Stream<int> identity_;
  Stream<kernels::face_nodes> changed_leaf_face_;
  Stream<kernels::edge_nodes> changed_leaf_edge_;
  Stream<int> found_totals_;
  Stream<int> changed_, vertex_offsets_, flag_, offsets_, changed_vertex_, changed_face_, changed_edge_;
  Stream<kernels::change_counts> changes_;
  Stream<kernels::box> before_;
  Stream<kernels::end_boxes> end_boxes_before_;
  Stream<int> grown_;  // [1] number of vertices whose boxes have grown
  Stream<int> far_ends_;  // [1] number of vertices whose predicted end is too uncertain
  Stream<kernels::bvh8_node> changed_groups_;
  const Stream<int> all_;  // without memory: everything has changed
  int searches_since_sort_ = 0, sorts_since_placed_ = 0;
  int motion_changes_ = 0;  // mesh.motion_changes when the groups were found
};

}  // namespace cama
