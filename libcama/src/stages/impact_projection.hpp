// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "model/access.hpp"

namespace cama {

/// Inelastic projection of all impacts at once (section 4) with impulses that only push, by an accelerated projected
/// gradient method, matrix-free: on positions, or with impact zones on the motion of the step.
class ImpactProjection {
public:
  using Rooms = Access<const Options, const MeshState, const ContactState, ReactionState>;
  explicit ImpactProjection(Backend &backend);
  /// tolerance: relative change of the impulses at which they suffice; impact zones have their own.
  ImpactProjection(Backend &backend, double tolerance);
  /// Called before the first run of a step. from: start of the motion; wanted: positions that the solve proposes.
  void start(const Rooms &state, const Stream<dvec3> &from, const Stream<dvec3> &wanted);
  /// Moves `positions` so that every impact of the state ends separated by at least its target, with impact zones so
  /// that its features do not approach each other, but no vertex further than the motion and target of some impact
  /// require.
  void run(const Rooms &state, Stream<dvec3> &positions);
  /// [vertices] 1: moved by the last run.
  Stream<int> &moved() { return moved_; }
  /// [vertices] the positions that the solve proposes, m.
  const Stream<dvec3> &wanted() const { return wanted_; }

private:
  void solve(const Rooms &state);
  /// Adds the pushes of the impacts to those of the step.
  void add_pushes(const Rooms &state, const Stream<dvec3> &positions);

  const double tolerance_;
  Stream<kernels::element_nodes> nodes_;
  Incidence incidence_, all_incidence_;  // of cloth vertices; of all, where forces are measured
  Stream<int> count_, moved_;
  Stream<double> constraint_, majorant_, partial_, scalar_;
  Stream<kernels::impulse> impulse_;
  Stream<dvec3> y_, from_, wanted_;
  Stream<kernels::row_head> head_;  // [entries of incidence_]
  Stream<kernels::impact_share> share_;  // likewise
  // lengths of motions: of each vertex, and the longest of impacts
  Stream<double> length_, longest_, longer_, largest_;
};

}  // namespace cama
