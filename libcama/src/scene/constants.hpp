// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace cama {

inline constexpr double pi = 3.14159265358979323846;
inline constexpr double degree = pi / 180;

}  // namespace cama
