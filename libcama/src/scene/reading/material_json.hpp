// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>

#include "cama/material.hpp"
#include "scene/reading/json_reader.hpp"

namespace cama {

/// Reads cama's own format, or ARCSim's if there is a stretching table but no "format".
Material parse_material(const Field &field, const std::string &name);
/// All values; parse_material restores them bit for bit.
Json material_json(const Material &material);

}  // namespace cama
