// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "model/features.hpp"
#include "model/state.hpp"
#include "model/topology.hpp"

namespace cama {

/// Fills the state from a scene; allocates only the streams that this scene needs.
template <class Real> void set_up(State &state, const Scene &scene, const Topology &topology);

extern template void set_up<double>(State &, const Scene &, const Topology &);
extern template void set_up<float>(State &, const Scene &, const Topology &);

}  // namespace cama
