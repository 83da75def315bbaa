// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "run/pipeline.hpp"
#include "stages/bending.hpp"

namespace cama {

/// Volume, pressure and stiffness of the gases at these positions. triangles: nodes of all triangles of cloth.
void find_gas(Backend &backend, EnclosedGas &gas, const Stream<kernels::element_nodes> &triangles,
              const Stream<dvec3> &position, double time_step);

/// Forces and matrix factors of triangles and hinges, wind and gravity, gathered to vertices.
template <class Real>
class EvaluateElements final
    : public StageOn<const Options, const Clock, const MeshState, const ElementState, const ContactState, SystemState> {
public:
  explicit EvaluateElements(const Scene &scene);
  std::string_view name() const override { return "element forces"; }
  void run_on(const Rooms &state) override;
  // Its two parts:
  /// Forces at the start of a step that is linearised at its prediction, which contacts ask for.
  void begin(const Rooms &state);
  /// Forces and factors where the step is linearised.
  void finish(const Rooms &state);

  using vec3 = typename Types<Real>::vec3;
  /// Forces that no potential has here: of velocities, of pressure, or of gas, N.
  struct Outer {
    explicit Outer(Backend &b) : triangle(b), hinge(b), force(b) {}
    Stream<vec3> triangle, hinge, force;  // [3 triangles], [4 hinges], [cloth vertices]
  };
  /// Forces and factors at these positions and velocities; the forces have those of `outer`, which are found if there
  /// are any.
  void evaluate(const Rooms &state, const Stream<dvec3> &position, const Stream<dvec3> &velocity, Outer &outer);
  bool windy() const { return windy_; }
  bool mass_damped() const { return mass_damped_; }
  /// Whether there are such forces.
  bool pushed(const Rooms &state) const
  {
    return windy_ || damped_ || mass_damped_ || pressed(state) || inflated(state);
  }
  /// What wind at these positions and velocities, or none, and mass damping add to the matrix.
  void find_drag(const Rooms &state, const Stream<dvec3> &position, const Stream<dvec3> &velocity, bool wind);

private:
  static bool pressed(const Rooms &state) { return state.elements.pressure.size() > 0; }
  static bool inflated(const Rooms &state) { return state.system.gas.gas.size() > 0; }
  /// Adds the wind to `force` [3 triangles], limited or not as in kernels/elements/external.h.
  void add_wind(const Rooms &state, const Stream<dvec3> &position, const Stream<dvec3> &velocity, bool limited,
                Stream<vec3> &force);
  /// Adds the pressure to `force` [3 triangles].
  static void add_pressure(const Rooms &state, const Stream<dvec3> &position, Stream<vec3> &force);
  /// Finds volume, pressure and stiffness of the gases at these positions and adds the pressure to `force` [cloth
  /// vertices].
  static void add_gas(const Rooms &state, const Stream<dvec3> &position, Stream<vec3> &force);
  /// Adds the mass damping at these velocities to `force` [cloth vertices], or, if they are those that are solved for,
  /// what the matrix does not have of it.
  void add_mass_damping(const Rooms &state, const Stream<dvec3> &velocity, bool solved, Stream<vec3> &force);
  /// Forces and factors at these positions, with wind, drag, pressure and gas of the linearised step.
  void evaluate_linearised(const Rooms &state, const Stream<dvec3> &position);
  void evaluate_elements(const Rooms &state, const Stream<dvec3> &position, const Damping<Real> *damping);
  /// Forces of vertices from those of elements, gravity and those that are driven. outer: whose forces of elements are
  /// gathered as well, or null.
  void gather(const Rooms &state, Outer *outer);

  bool windy_, damped_, mass_damped_;
  double air_density_ = 0, drag_ = 0;
};

extern template class EvaluateElements<double>;
extern template class EvaluateElements<float>;

}  // namespace cama
