// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "cama/checkpoint.hpp"
#include "model/topology.hpp"
#include "run/pipeline.hpp"

namespace cama {

/// FNV-1a of faces, ranges of objects and masses.
std::uint64_t scene_key(const Topology &topology);

Checkpoint take_checkpoint(State &state, Pipeline &step, const Topology &topology);

/// Throws SceneError if the checkpoint is of another scene or damaged.
void check_checkpoint(const Checkpoint &checkpoint, State &state, const Topology &topology);

/// checkpoint: must have been checked. Throws SceneError if pins that hold in it have been released in this simulation.
void restore_checkpoint(const Checkpoint &checkpoint, State &state, Pipeline &step);

}  // namespace cama
