// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace cama {

inline constexpr double pi = 3.14159265358979323846;
inline constexpr double degree = pi / 180;

// A sheet of curvature c on a grid of cells h x h has one hinge a cell: l = h, A = h^2, angle = c h, so that k l^2
// angle^2 / (8 A) = k c^2 h^2 / 8 must be the plate's B c^2 h^2 / 2. So k = 4 B holds for a sheet that is held on a
// cylinder along the grid. A free strip on the alternating grid of cama's generators relaxes to four fifths of that
// energy, as its vertices fold up and down a little: with k = 5 B it agrees with the elastica
// (tests/unit/test_dynamics.cpp). Other meshes differ by tens of percent with bending=hinge; bending=plate divides by
// this number (docs/guide/materials.md).
inline constexpr double hinge_per_plate = 5.0;

// What a scene may ask for; more is a slip of the keyboard, and would only be noticed when memory is gone.
inline constexpr double most_triangles = 2e7;          // of a generated mesh
inline constexpr double most_sampled_positions = 2e8;  // of an animation, 24 bytes each

}  // namespace cama
