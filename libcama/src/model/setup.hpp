// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "model/state.hpp"
#include "model/topology.hpp"

namespace cama {

/// Air that moves the cloth.
bool has_wind(const Scene &scene);
/// Anything that meets rubs: an obstacle's coefficient holds for all that touches it, cloths' for cloth on cloth.
bool has_friction(const Scene &scene);

/// Fills the state from a scene: allocates the streams this scene needs and no other.
template <class Real> void set_up(State &state, const Scene &scene, const Topology &topology);

extern template void set_up<double>(State &, const Scene &, const Topology &);
extern template void set_up<float>(State &, const Scene &, const Topology &);

}  // namespace cama
