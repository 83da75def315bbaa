// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "run/pipeline.hpp"

namespace cama {

/// Forces and matrix factors of triangles and hinges, wind and gravity, gathered to vertices.
template <class Real>
class EvaluateElements final
    : public StageOn<const Options, const Clock, const MeshState, const ElementState, const ContactState, SystemState> {
public:
  explicit EvaluateElements(const Scene &scene);
  std::string_view name() const override { return "element forces"; }
  void run_on(const Rooms &state) override;

  using vec3 = typename Types<Real>::vec3;
  /// Forces and factors at these positions, with the wind and damping of the linearised step or without.
  void evaluate(const Rooms &state, const Stream<dvec3> &position, bool linearised);
  bool windy() const { return windy_; }
  bool damped() const { return damped_; }
  /// Adds the wind to `force` [3 triangles], limited or not as in kernels/elements/external.h.
  void add_wind(const Rooms &state, const Stream<dvec3> &position, const Stream<dvec3> &velocity, bool limited,
                Stream<vec3> &force);
  /// What the wind at these positions and velocities adds to the matrix.
  void find_drag(const Rooms &state, const Stream<dvec3> &position, const Stream<dvec3> &velocity);
  /// Adds the damping of the elements at these velocities, with the factors of the last evaluation.
  void add_damping(const Rooms &state, const Stream<dvec3> &velocity, Stream<vec3> &triangle_force,
                   Stream<vec3> &hinge_force);

private:
  bool windy_, damped_;
  double air_density_ = 0, drag_ = 0;
};

extern template class EvaluateElements<double>;
extern template class EvaluateElements<float>;

}  // namespace cama
