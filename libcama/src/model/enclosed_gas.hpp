// SPDX-License-Identifier: Apache-2.0
// Gas that cloth encloses, a part of the linear system.
#pragma once
#include "cama/stream.hpp"
#include "device/kernels.hpp"
#include "model/life.hpp"

namespace cama {

/// Gas in closed cloths; without any, all streams are empty.
struct EnclosedGas {
  Stream<kernels::gas> gas;
  Stream<kernels::gas_part> triangle_part, vertex_part;  // that teams sum over
  Stream<double> volume, product;  // m^3 of the triangle parts; sums of the vertex parts
  Stream<kernels::gas_state> state;  // where the step is linearised
  Stream<int> gas_of;  // [cloth vertices] -1: none

  template <class F> void visit(F &&f)
  {
    f("gas", Life::scene, gas);
    f("gas.triangle_part", Life::scene, triangle_part);
    f("gas.vertex_part", Life::scene, vertex_part);
    f("gas.volume", Life::step, volume);
    f("gas.product", Life::step, product);
    f("gas.state", Life::step, state);
    f("gas.gas_of", Life::scene, gas_of);
  }
};

}  // namespace cama
