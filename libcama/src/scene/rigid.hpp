// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "cama/scene.hpp"

namespace cama {

/// Of an obstacle with Obstacle::rigid. Throws SceneError or MeshError, which name the obstacle and the field, if it
/// cannot be a rigid body.
MassProperties mass_properties(const Obstacle &obstacle);

}  // namespace cama
