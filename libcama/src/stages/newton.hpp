// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>

#include "stages/contact_terms.hpp"
#include "stages/element_forces.hpp"
#include "stages/linear_solve.hpp"
#include "stages/matrix_assembly.hpp"

namespace cama {

/// Newton's method on the nonlinear equation of the step, starting from the linearised step that the stages before have
/// computed: elements and terms at the iterate, assembly, solve for the change of velocity, line search on the
/// incremental potential (inertia, elasticity, gravity, penalty; friction by the normal forces and speeds of the
/// linearised step, in further solves the speeds of the iterate, wind, pressure, gas and damping constant at their
/// values of the iterate). Hessians are positive semidefinite.
template <class Real>
class NewtonIterations final
    : public StageOn<const Options, StepReport, Clock, MeshState, const ElementState, ContactState, SystemState> {
public:
  NewtonIterations(Backend &backend, EvaluateElements<Real> &elements, AssembleMatrix<Real> &assembly,
                   LinearSolve<Real> &solve, const std::vector<double> &masses);  // masses: [cloth vertices], kg
  std::string_view name() const override { return "newton iterations"; }
  std::string reason() const override { return "newton_iterations above 1"; }
  void run_on(const Rooms &state) override;

private:
  using vec3 = typename Types<Real>::vec3;
  /// Squared norms.
  struct Norms {
    double residual = 0, size = 0;
  };
  static Norms norms_of(const std::vector<double> &totals) { return {totals[0], totals[1]}; }
  /// What friction follows from: normal forces and speeds of the first solve, the same normal forces and the speeds at
  /// the iterate, or both at the iterate.
  enum class Friction { as_it_is, of_first_solve, of_first_pushes, of_iterate };
  /// Elements, terms and right-hand side, which is the negative residual, at the iterate. ahead: assembles as well.
  Norms evaluate(const Rooms &state, Friction friction = Friction::as_it_is, bool ahead = false);
  void assemble(const Rooms &state);  ///< the matrix at the iterate
  /// Sums of at most four streams: the places of their chunks in sums_, of which several wait to be read at once.
  struct Sums {
    int lists = 0, count[4] = {}, first[4] = {};
    std::vector<double> of(const std::vector<double> &chunks) const;
  };
  /// Sums for the norms of `evaluate`; with_slope: and of slope_, in the third place. ahead: assembles aside.
  Sums find_norms(const Rooms &state, Friction friction, bool with_slope, std::optional<Fork> *ahead = nullptr);
  /// Incremental potential at the iterate, J; size: of its parts together.
  struct Potential {
    double value = 0, size = 0;
  };
  /// outer: the forces that are constant in it, those of `outer_` at some iterate.
  Sums measure(const Rooms &state, const Stream<vec3> &outer);
  static Potential potential(const std::vector<double> &parts);
  void move(const Rooms &state, double alpha);
  /// Whether a step of fixed length needs further solves: the second change has much of the energy of the first, and
  /// several times that of the cloth. Finds kinetic_.
  bool contracts_slowly(const Rooms &state, double first_energy);
  /// Moves along the solution to a lower potential or residual; returns false if it finds none. norms: those of the
  /// previous iterate, then those of the new one if `evaluated`. Without a new one `evaluated` says whether elements
  /// and terms are those of the previous one.
  bool search_line(const Rooms &state, Norms &norms, bool &evaluated);
  /// The same after the last solve.
  bool search_last(const Rooms &state, Norms &norms, bool &evaluated);
  /// Whether the potential falls enough at alpha; sets fell_ if it does.
  bool falls(const Potential &before, const Potential &now, double alpha, double slope);
  /// Sums each of at most four streams, all at the same time, behind what is in sums_. Empty streams give 0.
  Sums sum(const Rooms &state, const std::vector<const Stream<double> *> &streams);

  /// What contacts push with.
  void find_pushes(const Rooms &state, Friction friction);
  /// Friction by these normal forces and the speeds at the iterate. again: by those that it had before.
  void iterate_friction(const Rooms &state, bool again);

  // The impulses of contacts that the solved equations have given the cloth, with rigid bodies, which receive them.
  /// Of the solve that `solution` is of, from velocity_next or, if it is done, to it.
  void find_solved_impulses(const Rooms &state, bool done, Stream<dvec3> &impulses);
  void find_remainders(const Rooms &state);

  EvaluateElements<Real> &elements_;
  AssembleMatrix<Real> &assembly_;
  LinearSolve<Real> &solve_;
  double fastest_ = 0;  // J: all cloth at the highest speed; solves do not mend a larger residual
  double kinetic_ = 0;  // J, of the cloth
  bool fell_ = false;  // the last search lowered the potential beyond rounding
  bool by_potential_ = false;  // the search after a last solve asked for it
  typename EvaluateElements<Real>::Outer outer_;
  Stream<vec3> outer_before_;  // its forces where the search begins
  double alpha_ = 0;  // the part of the solution that the last search took
  Stream<dvec3> start_, given_, solved_, moved_;
  Stream<double> vertex_[2], triangle_[2], hinge_, term_, slope_, part_[2], sums_, push_, load_, pull_, share_,
      pressing_;
};

extern template class NewtonIterations<double>;
extern template class NewtonIterations<float>;

}  // namespace cama
