// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "model/state.hpp"
#include "model/topology.hpp"

namespace cama {

/// Whether air moves the cloth.
bool has_wind(const Scene &scene);
/// Whether any cloth has stiffness damping.
bool has_damping(const Scene &scene);
/// Whether any cloth has mass damping.
bool has_mass_damping(const Scene &scene);
/// Whether any cloth encloses gas.
bool has_gas(const Scene &scene);
/// Whether bending of any cloth becomes plastic.
bool has_yield(const Scene &scene);
bool has_strain_limit(const Scene &scene);
/// Whether any contact has friction: an obstacle's coefficient holds for everything that touches it, the cloths' for
/// cloth against cloth.
bool has_friction(const Scene &scene);

/// Fills the state from a scene; allocates only the streams that this scene needs.
template <class Real> void set_up(State &state, const Scene &scene, const Topology &topology);

extern template void set_up<double>(State &, const Scene &, const Topology &);
extern template void set_up<float>(State &, const Scene &, const Topology &);

}  // namespace cama
