// SPDX-License-Identifier: Apache-2.0
// The parts of set_up(), instantiated for float and double.
#pragma once
#include <vector>

#include "model/state.hpp"
#include "model/topology.hpp"

namespace cama {

/// Materials of the cloths; sets the implicit step of the clock and the scaled step of the system to the time step.
template <class Real> void set_up_materials(State &state, System<Real> &system, const Scene &scene);
/// Triangles, and hinges if there are any.
template <class Real> void set_up_elements(State &state, System<Real> &system, const Scene &scene, const Topology &t);
/// Hinges whose moments are those of a plate, with what makes bending plastic.
template <class Real> void set_up_plate(State &state, System<Real> &system, const Scene &scene, const Topology &t);
/// Gas that cloths enclose.
template <class Real> void set_up_gas(State &state, System<Real> &system, const Scene &scene, const Topology &t);
/// Faces and edges, what contact needs of vertices, and lists of pairs. inverse_mass: [vertices], 1/kg.
void set_up_contact(State &state, const Scene &scene, const Topology &t, const std::vector<double> &inverse_mass);

}  // namespace cama
