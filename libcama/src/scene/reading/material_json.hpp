// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>

#include "cama/material.hpp"
#include "scene/reading/json_reader.hpp"

namespace cama {

/// cama's own format, or ARCSim's where there is a stretching table without "format".
Material parse_material(const Field &field, const std::string &name);
/// The whole table; parse_material gives it back bit for bit.
Json material_json(const Material &material);

}  // namespace cama
