// SPDX-License-Identifier: Apache-2.0
// Room of the state: elements in the working precision, and the linear system.
#pragma once
#include <array>
#include <memory>
#include <vector>

#include "cama/stream.hpp"
#include "device/kernels.hpp"
#include "model/enclosed_gas.hpp"
#include "model/incidence.hpp"
#include "model/life.hpp"

namespace cama {

/// A matrix of 3x3 blocks in block compressed sparse row form: rows of cloth vertices, columns of all vertices.
template <class Real> struct BlockMatrix {
  Stream<int> row, column;  // [rows + 1], [blocks]
  Stream<typename Types<Real>::mat3> block;  // [blocks], kg
};

/// Streams in the working precision: elements, the linear system, its solution.
template <class Real> struct System {
  using T = Types<Real>;
  Stream<Real> mass;  // [cloth vertices], kg
  Stream<Real> mass_damping;  // [cloth vertices] kg/s, with mass damping: times velocity a force; else empty
  Stream<Real> material_scale;  // [materials] h (h + damping), s^2
  Stream<typename T::stretching_stiffness> stretching_table;
  Stream<typename T::strain_limit> strain_limit;  // [materials], where one has a limit
  Stream<int> stretching_start;  // [materials] start in the table; below 0: constant stiffness
  Stream<typename T::bending_stiffness> bending_table;  // [materials]
  Stream<typename T::triangle_rest> triangle_rest;
  Stream<typename T::triangle_factor> triangle_factor;
  Stream<typename T::vec3> triangle_force;  // [3 triangles], N
  Stream<typename T::hinge_rest> hinge_rest;
  Stream<typename T::hinge_factor> hinge_factor;
  Stream<typename T::vec3> hinge_force;  // [4 hinges], N
  Stream<typename T::hinge_coupling> hinge_coupling;  // with bending=plate, as all of these; else empty
  Stream<typename T::moment_step> moment_step;  // [moment_iterations + 1][cloths]
  int moment_iterations = 0;
  Stream<Real> angle_scale, scaled_angle, moment, moment_before;  // [hinges], sqrt(J)
  Stream<Real> scaled_rate, rate_moment, rate_moment_before;  // [hinges], sqrt(J), with damping: of the rates
  // [hinges] scratch memory, where several steps are found at once: moment, moment_before and those of the rates
  std::array<Stream<Real>, 4> moment_next;
  // [triangles], [hinges], [cloths] with a yield curvature; else empty
  Stream<typename T::plastic_triangle> plastic_triangle;
  Stream<typename T::plastic_hinge> plastic_hinge;
  Stream<typename T::plastic_material> plastic_material;
  Stream<typename T::vec3> gas_gradient;  // [cloth vertices] m^2, with gas: derivative of the volume; else empty
  Stream<typename T::term> term;  // contacts, then stitches
  // [terms] N s on side A, with friction and several solves: of the friction of a contact without its damping
  Stream<typename T::vec3> hold;
  Stream<typename T::vec3> force;  // [cloth vertices], N
  Stream<typename T::mat3> drag;  // [cloth vertices] kg: what wind and mass damping add to the matrix; else empty
  Stream<typename T::vec3> start_force;  // [cloth vertices] N, with BDF2, in a step with contacts: at its start
  BlockMatrix<Real> matrix;
  Stream<typename T::vec3> right_side, solution;  // [cloth vertices], [vertices]

  template <class F> void visit(F &&f)
  {
    f("mass", Life::scene, mass);
    f("mass_damping", Life::scene, mass_damping);
    f("material_scale", Life::step, material_scale);
    f("stretching_table", Life::scene, stretching_table);
    f("strain_limit", Life::scene, strain_limit);
    f("stretching_start", Life::scene, stretching_start);
    f("bending_table", Life::scene, bending_table);
    f("triangle_rest", Life::scene, triangle_rest);
    f("triangle_factor", Life::step, triangle_factor);
    f("triangle_force", Life::step, triangle_force);
    f("hinge_rest", Life::scene, hinge_rest);
    f("hinge_factor", Life::step, hinge_factor);
    f("hinge_force", Life::step, hinge_force);
    f("hinge_coupling", Life::scene, hinge_coupling);
    f("moment_step", Life::scene, moment_step);
    f("angle_scale", Life::step, angle_scale);
    f("scaled_angle", Life::step, scaled_angle);
    f("moment", Life::step, moment);
    f("moment_before", Life::step, moment_before);
    f("scaled_rate", Life::step, scaled_rate);
    f("rate_moment", Life::step, rate_moment);
    f("rate_moment_before", Life::step, rate_moment_before);
    f("plastic_triangle", Life::scene, plastic_triangle);
    f("plastic_hinge", Life::scene, plastic_hinge);
    f("plastic_material", Life::scene, plastic_material);
    f("gas_gradient", Life::step, gas_gradient);
    f("term", Life::step, term);
    f("hold", Life::step, hold);
    f("force", Life::step, force);
    f("drag", Life::step, drag);
    f("start_force", Life::step, start_force);
    f("row", Life::step, matrix.row);
    f("column", Life::step, matrix.column);
    f("block", Life::step, matrix.block);
    f("right_side", Life::step, right_side);
    f("solution", Life::step, solution);
  }
};

/// The linear system in the precision of the run, and its terms of rank one: contacts, then stitches.
struct SystemState {
  int terms = 0;
  Stream<kernels::element_nodes> term_nodes;
  Stream<int> term_split;  // [terms] with star: nodes on side A
  Incidence term_incidence;
  std::unique_ptr<System<double>> f64;
  std::unique_ptr<System<float>> f32;
  double scaled_step = 0;  // h of material_scale
  EnclosedGas gas;

  template <class Real> System<Real> &of()
  {
    if constexpr (sizeof(Real) == 8)
      return *f64;
    else
      return *f32;
  }
  /// Sets material_scale to h (h + damping), if it is that of another h.
  void scale_materials(double h, const std::vector<double> &damping);
  std::vector<double> masses() const;  ///< [cloth vertices], kg

  template <class F> void visit(F &&f)
  {
    f("terms", Life::step, terms);
    f("term_nodes", Life::step, term_nodes);
    f("term_split", Life::step, term_split);
    f("term_incidence.row", Life::step, term_incidence.row);
    f("term_incidence.entry", Life::step, term_incidence.entry);
    gas.visit(f);
    if (f64) f64->visit(f);
    if (f32) f32->visit(f);
  }
};

}  // namespace cama
