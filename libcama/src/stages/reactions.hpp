// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "run/pipeline.hpp"

namespace cama {

/// The impulses of the solve: of contacts, and of the cloth on obstacles, pins and attachments.
template <class Real>
class SolveReactions final
    : public StageOn<const Options, const Clock, const MeshState, const ContactState, SystemState, ReactionState> {
public:
  using Rooms = Access<const Options, const Clock, const MeshState, const ContactState, SystemState, ReactionState>;
  explicit SolveReactions(Backend &backend) : count_(backend) {}
  std::string_view name() const override { return "forces of the solve"; }
  std::string reason() const override { return "option forces"; }
  void run_on(const Rooms &state) override;
  /// The impulses of the solve on what is prescribed, as its terms are now.
  void measure(const Rooms &state, Impulses &impulses);
  const Incidence &terms() const { return terms_; }  ///< at all vertices, since measure

private:
  Incidence terms_;  // at all vertices
  Stream<int> count_;
};

extern template class SolveReactions<double>;
extern template class SolveReactions<float>;

/// Adds the impulses of penetration handling, once the step is complete.
class ImpactReactions final
    : public StageOn<const StepReport, const Clock, const MeshState, const ContactState, ReactionState> {
public:
  explicit ImpactReactions(Backend &backend)
      : remainder_(backend), nearest_(backend), surface_(backend), count_(backend), nodes_(backend)
  {}
  std::string_view name() const override { return "forces of impacts"; }
  std::string reason() const override { return "option forces"; }
  void run_on(const Rooms &state) override;

private:
  void add_remainders(const Rooms &state);

  Stream<dvec3> remainder_;
  Stream<int> nearest_, surface_, count_;
  Stream<kernels::element_nodes> nodes_;
  Incidence takers_;
};

}  // namespace cama
