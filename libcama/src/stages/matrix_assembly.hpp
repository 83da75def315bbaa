// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "run/pipeline.hpp"

namespace cama {

/// Forces and matrix factors of triangles and hinges, wind, gravity; gathered to vertices.
template <class Real> class EvaluateElements final : public Stage {
public:
  explicit EvaluateElements(const Scene &scene);
  std::string_view name() const override { return "element forces"; }
  void run(State &state) override;

  using vec3 = typename Types<Real>::vec3;
  /// Forces and factors at these positions.
  void evaluate(State &state, const Stream<dvec3> &position, bool with_wind);
  bool windy() const { return windy_; }
  void add_wind(State &state, const Stream<dvec3> &position, const Stream<dvec3> &velocity,
                Stream<vec3> &force);   ///< [3 triangles]

private:
  bool windy_;
  double air_density_ = 0, drag_ = 0;
};

/// Contacts and stitches become terms of the system, with friction.
template <class Real> class EvaluateTerms final : public Stage {
public:
  explicit EvaluateTerms(Backend &backend) : free_velocity_(backend), load_(backend), count_(backend) {}
  std::string_view name() const override { return "contact terms"; }
  std::string reason() const override { return "contact or stitches"; }
  void run(State &state) override;

private:
  Stream<dvec3> free_velocity_;         // with friction
  Stream<double> load_;
  Stream<int> count_;
};

/// The matrix of Equation 1 in BCSR: by gathering into the static elastic pattern (terms stay an operator of rank one
/// each), by the paper's Algorithm 1, or by collecting, sorting and reducing all entries.
template <class Real> class AssembleMatrix final : public Stage {
public:
  explicit AssembleMatrix(Backend &backend);
  std::string_view name() const override { return "matrix assembly"; }
  void run(State &state) override;

private:
  void find_pattern(State &state, bool with_terms);   ///< and the sources of every block
  void scatter(State &state);
  void sorted(State &state);

  bool pattern_ready_ = false;
  const Stream<int> all_couple_;        // none: all nodes of a triangle, or hinge, couple
  Stream<int> count_, space_, cursor_;
  Stream<key64> index_;
  Stream<int> source_start_, source_;   // of every block what adds to it
  Stream<key64> key_;
  Stream<int> entry_, head_, place_;
};

extern template class EvaluateElements<double>;
extern template class EvaluateElements<float>;
extern template class EvaluateTerms<double>;
extern template class EvaluateTerms<float>;
extern template class AssembleMatrix<double>;
extern template class AssembleMatrix<float>;

}  // namespace cama
