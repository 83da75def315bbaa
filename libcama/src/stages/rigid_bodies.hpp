// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <initializer_list>
#include <memory>
#include <vector>

#include "run/pipeline.hpp"
#include "solver/anderson.hpp"
#include "stages/body_contacts.hpp"
#include "stages/prescribed_motion.hpp"
#include "stages/reactions.hpp"

namespace cama {

/// Expects of every rigid body the motion of the step under the load of the last one.
class PredictBodies final
    : public StageOn<const StepReport, const Clock, const MeshState, const ElementState, RigidState> {
public:
  /// contacts: null if bodies can touch nothing but cloth.
  explicit PredictBodies(std::shared_ptr<BodyContacts> contacts) : contacts_(std::move(contacts)) {}
  std::string_view name() const override { return "rigid prediction"; }
  std::string reason() const override { return "rigid bodies"; }
  void run_on(const Rooms &state) override;

private:
  std::shared_ptr<BodyContacts> contacts_;
};

/// Sums of impulses over all cloth that is free, and over everything that is prescribed.
class WholeSums {
public:
  explicit WholeSums(Backend &backend) : row_(backend), member_(backend), free_(backend), wrench_(backend) {}
  struct Sums {
    BodyWrench free, prescribed;  // moments about the origin
  };
  Sums sum(const State &state, const Impulses &impulses);

private:
  int known_changes_ = -1;  // MeshState::pin_changes
  Stream<int> row_, member_, free_;
  Stream<dvec3> wrench_;
};

/// Sums over the vertices of each rigid body and over the cloth vertices that are attached to it.
class BodySums {
public:
  BodySums(Backend &backend, const PrescribedMotion &motion)
      : motion_(motion), row_(backend), member_(backend), range_(backend), wrench_(backend), resistance_(backend)
  {}
  /// Finds the vertices; for the sums of this step.
  void prepare(const State &state);
  bool attached() const { return attached_; }  ///< whether cloth is attached to a body
  /// [impulses][bodies] force, N s, and moment about the origin, N m s.
  std::vector<std::vector<BodyWrench>> sum(const State &state, std::initializer_list<const Impulses *> impulses);
  /// [bodies] the resistance of the terms and the matrix to motion (motion_resistance), about the origin.
  template <class Real>
  std::vector<std::array<double, RESISTANCE>> resistance(const State &state, const Incidence &terms);

private:
  const PrescribedMotion &motion_;
  bool attached_ = false;
  std::vector<int> known_;       // members, body by body, as the streams have them
  std::vector<int> body_;        // [runs]
  Stream<int> row_, member_, range_;
  Stream<dvec3> wrench_;
  Stream<double> resistance_;
};

/// Solves for cloth and rigid bodies together. The stages in it compute the cloth's step while bodies move as they are
/// told; this repeats them with the motion that follows from the impulse of the cloth, until both agree.
template <class Real> class CoupleBodies final : public Pipeline {
public:
  CoupleBodies(Backend &backend, PrescribedMotion &motion, std::shared_ptr<BodyContacts> contacts)
      : Pipeline("rigid coupling", "rigid bodies"), motion_(motion), sums(backend, motion),
        contacts_(std::move(contacts)), reactions_(backend)
  {}
  void run(State &state) override;

private:
  PrescribedMotion &motion_;

public:
  BodySums sums;

private:
  void place(State &state);
  void find_scales(const State &state);
  void find_factors(const State &state);
  std::vector<double> scaled(const std::vector<BodyWrench> &wrenches) const;
  void set_impulses(State &state, const std::vector<double> &scaled_impulses) const;
  void relax(std::vector<double> &residual) const;

  using Matrix6 = std::array<std::array<double, 6>, 6>;
  std::shared_ptr<BodyContacts> contacts_;
  SolveReactions<Real> reactions_;
  AndersonMixing mixing_;
  std::vector<Matrix6> scale_;   // [bodies] lower triangular L, L L' the mass matrix
  std::vector<Matrix6> factor_;  // [bodies] lower triangular, of 1 + L^-1 (resistance) L^-T
};

/// Gives every rigid body the impulses of the step, once it is complete. What the cloth has lost to nothing that is
/// prescribed, such as the history of a blow, goes to them and to the rest of what is prescribed in proportion to the
/// impulses of the step.
class FinishBodies final : public Stage {
public:
  FinishBodies(Backend &backend, BodySums &sums, std::shared_ptr<BodyContacts> contacts)
      : sums_(sums), contacts_(std::move(contacts)), whole_(backend), motion_(backend)
  {}
  std::string_view name() const override { return "rigid bodies"; }
  std::string reason() const override { return "rigid bodies"; }
  void run(State &state) override;

private:
  BodySums &sums_;
  std::shared_ptr<BodyContacts> contacts_;
  WholeSums whole_;
  Stream<dvec3> motion_;
};

extern template class CoupleBodies<double>;
extern template class CoupleBodies<float>;

}  // namespace cama
