// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "cama/scene.hpp"
#include "scene/reading/json_reader.hpp"

namespace cama {

/// Reads {"sphere": {..}}, {"capsule": {..}}, {"box": {..}} or {"plane": {..}} at the origin, or at its "points".
Obstacle read_exact(const Field &field);
void place_exact(const RigidTransform &transform, Obstacle &obstacle);
/// Throws SceneError; for a box also MeshError.
void validate_exact(const std::string &object, const Obstacle &obstacle);
const char *shape_name(ObstacleShape shape);

}  // namespace cama
