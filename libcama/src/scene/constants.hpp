// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace cama {

inline constexpr double pi = 3.14159265358979323846;
inline constexpr double degree = pi / 180;

// What a scene may ask for; more is a slip of the keyboard, and would only be noticed when memory is gone.
inline constexpr double most_triangles = 2e7;          // of a generated mesh
inline constexpr double most_sampled_positions = 2e8;  // of an animation, 24 bytes each

}  // namespace cama
