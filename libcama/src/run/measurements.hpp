// SPDX-License-Identifier: Apache-2.0
// Measurements of a state, made on request.
#pragma once
#include "cama/simulation.hpp"
#include "model/state.hpp"

namespace cama {

Energy measure_energy(State &state);
/// Largest principal stretch minus one over all triangles.
/// Of the gases at the positions.
std::vector<GasState> measure_gas(State &state);
double measure_strain(State &state);
/// Smallest distance over the candidate pairs, m; infinity if there are none.
double measure_gap(State &state);

}  // namespace cama
