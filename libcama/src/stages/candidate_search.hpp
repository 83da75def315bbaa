// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>

#include "run/pipeline.hpp"

namespace cama {

/// The rooms of the state that a search accesses.
using SearchRooms = Access<const Options, StepReport, const MeshState, ContactState, const Exemptions, BoundsState>;

/// Candidate pairs of the step: features whose boxes over the motion from `position` to a target overlap. One search
/// feeds proximity checking, continuous detection and the commit; it grows as vertices leave their boxes. A search may
/// leave out pairs that one coordinate separates throughout, if all vertices go all of their way at the same rate.
class CandidateSearch {
public:
  /// What happened to the lists. renewed: all pairs are new, without bounds and directions.
  enum class Change { none, grown, renewed };
  explicit CandidateSearch(Backend &backend)
      : end_boxes_(backend), wanted_(backend), place_(backend), kept_(backend), corners_(backend)
  {}
  virtual ~CandidateSearch() = default;
  /// What `run` may let the device do aside while it searches, or nothing: work that needs no pairs.
  std::function<void(Fork &)> meanwhile;
  /// Fills state.contact.vertex_face and state.contact.edge_edge for motion from -> to.
  virtual void run(const SearchRooms &state, const Stream<dvec3> &from, const Stream<dvec3> &to) = 0;
  /// Makes the lists hold every pair of the motion from -> to, with at least `margin` around it. Earlier pairs stay,
  /// with `direction` and `gap_bound`, and further ones are appended; after large changes, all pairs are searched for
  /// again.
  virtual Change update(const SearchRooms &state, const Stream<dvec3> &from, const Stream<dvec3> &to,
                        double margin) = 0;
  /// The same, and never all pairs anew, for a motion of which some vertices go a part only. Returns whether pairs were
  /// appended; only searches that leave out such pairs need it.
  virtual bool complete(const SearchRooms &state, const Stream<dvec3> &from, const Stream<dvec3> &to, double margin)
  {
    static_cast<void>(state), static_cast<void>(from), static_cast<void>(to), static_cast<void>(margin);
    return false;
  }
  /// [vertices] by which pairs that a coordinate separates are left out; empty: none are.
  const Stream<kernels::end_boxes> &end_boxes() const { return end_boxes_; }

  /// Finds directions between the closest points at `from`, for the pairs from `first_*` on and for those without one.
  static void find_directions(const SearchRooms &state, const Stream<dvec3> &from, int first_vertex_face,
                              int first_edge_edge);

protected:
  Stream<kernels::end_boxes> end_boxes_;

  /// Removes the exempt pairs among those from `first` on.
  void drop_exempt(const SearchRooms &state, int kind, int first);

  /// Bounds of all positions of the motion, in state.bounds.bounds.
  void find_bounds(const SearchRooms &state, const Stream<dvec3> &from, const Stream<dvec3> &to);

private:
  Stream<int> wanted_, place_;
  Stream<kernels::pair> kept_;
  Stream<dvec3> corners_;
};

}  // namespace cama
