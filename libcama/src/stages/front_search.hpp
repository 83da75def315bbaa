// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "stages/candidate_search.hpp"

namespace cama {

/// The paper's search (section 4.1, Figures 7 and 8): fronts of the traversal of cloth with itself and of cloth with
/// obstacles, kept between searches; triangle pairs from them; feature pairs that the triangles own; and orphans,
/// feature pairs whose owners are adjacent. It finds the same pairs as TreeSearch, in another order.
class FrontSearch final : public CandidateSearch {
public:
  explicit FrontSearch(const SearchRooms &state);
  void run(const SearchRooms &state, const Stream<dvec3> &from, const Stream<dvec3> &to) override;
  /// With the option `localized_search`, if few vertices left their boxes, it searches only for pairs near those:
  /// earlier pairs stay unchanged, with `direction` and `gap_bound`, and new ones are appended.
  Change update(const SearchRooms &state, const Stream<dvec3> &from, const Stream<dvec3> &to, double margin) override;

  int rebuilds() const { return rebuilds_; }     ///< number of rebuilds of trees and fronts
  int localized() const { return localized_; }   ///< number of localized updates

  FrontState &streams() { return fronts_; }   ///< for State::visit

private:
  struct Tree {
    int first, leaves, root;   // first face, faces, level of the root
    Stream<int> &order;
    Stream<kernels::box> &node;
    Stream<int> &dirty;
  };
  void find_features(const SearchRooms &state);
  void sort_leaves(const SearchRooms &state, Tree &tree);
  template <class Level> void for_each_level(const Tree &tree, Level &&level);
  void refit(const SearchRooms &state, Tree &tree);
  double surface(const SearchRooms &state, const Tree &tree);
  int partition(const SearchRooms &state, int size, const Stream<kernels::pair> &pairs, const Tree &a, const Tree &b,
                Stream<kernels::pair> *kept);
  void traverse(const SearchRooms &state, const Tree &a, const Tree &b, int open, Stream<kernels::pair> *kept);
  void update_front(const SearchRooms &state, const Tree &a, const Tree &b, Stream<kernels::pair> &front, bool restart);
  void follow_dirty(const SearchRooms &state, const Tree &a, const Tree &b, const Stream<kernels::pair> &front);
  void collect_features(const SearchRooms &state, bool only_new);

  FrontState fronts_;
  Tree cloth_, obstacles_;
  Stream<key64> key_;
  Stream<double> partial_, total_;
  Stream<int> outcome_, count_, offset_;                     // of the pairs of a front
  Stream<kernels::pair> kept_[2], open_, child_;         // kept_: of the self front and of the other
  Stream<int> mask_, found_[2], place_[2];                   // of triangle pairs, then of orphans
  Stream<int> vertex_dirty_, face_dirty_, edge_dirty_, cloth_dirty_, obstacle_dirty_, dirty_count_;
  Stream<kernels::box> vertex_before_, face_before_, edge_before_;
  double built_cloth_ = 0, built_obstacles_ = 0;             // surface ratios when the trees were built
  bool built_ = false;
  int rebuilds_ = 0, localized_ = 0;
};

}  // namespace cama
