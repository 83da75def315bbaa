// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "model/access.hpp"

namespace cama {

/// Inelastic projection of all impacts at once (section 4): by default with the condition that impulses only push, by
/// an accelerated projected gradient method; or as one linear system by the conjugate gradient method with an active
/// set, as in the paper. Both are matrix-free.
class ImpactProjection {
public:
  using Rooms = Access<const Options, const MeshState, const ContactState>;
  explicit ImpactProjection(Backend &backend);
  /// Called before the first run of a step. from: start of the motion; wanted: positions that the solve proposes.
  void start(const Rooms &state, const Stream<dvec3> &from, const Stream<dvec3> &wanted);
  /// Moves `positions` so that every impact of the state ends separated by at least its target, but no vertex further
  /// than the motion and target of some impact require.
  void run(const Rooms &state, Stream<dvec3> &positions);
  /// [vertices] 1: moved by the last run.
  const Stream<int> &moved() const { return moved_; }

private:
  void solve_linear_system(const Rooms &state);
  void solve_pushing(const Rooms &state);
  void multiply(const Rooms &state, double regularisation, const Stream<double> &x, Stream<double> &q);
  void spread(const Rooms &state, const Stream<double> &lambda);

  Stream<kernels::element_nodes> nodes_;
  Incidence incidence_;
  Stream<int> count_, active_, dropped_, moved_;
  Stream<double> constraint_, diagonal_, majorant_, lambda_, r_, z_, p_, q_, partial_, scalar_;
  Stream<dvec3> y_, wanted_;
  // lengths of motions: of each vertex, and the longest of impacts
  Stream<double> length_, longest_, longer_, largest_;
};

}  // namespace cama
