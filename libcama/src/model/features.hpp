// SPDX-License-Identifier: Apache-2.0
// What a scene makes use of, by which streams and stages are chosen.
#pragma once
#include "cama/scene.hpp"

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

}  // namespace cama
