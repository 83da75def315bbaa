// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <optional>
#include <string>

#include "cama/mesh.hpp"

namespace cama {

/// A symmetric matrix: xx, yy, zz, xy, yz, zx.
using SymmetricMatrix = std::array<double, 6>;

/// What makes an obstacle a rigid body: cloth and gravity move it. One of mass and density is given.
struct Rigid {
  double mass = 0;  ///< kg; 0: by density
  double density = 0;  ///< of the solid that the closed mesh bounds, kg/m^3; 0: by mass
  std::optional<dvec3> center;  ///< of mass, m; none: that of the solid
  /// About the centre of mass, along the axes of the scene, kg m^2; none: that of the solid.
  std::optional<SymmetricMatrix> inertia;
  dvec3 velocity{0, 0, 0};  ///< of the centre of mass at the start, m/s
  dvec3 angular_velocity{0, 0, 0};  ///< at the start, rad/s
};

struct MassProperties {
  double mass = 0;  ///< kg
  dvec3 center{0, 0, 0};  ///< of mass, m
  SymmetricMatrix inertia{};  ///< about the centre, kg m^2
};

/// Of a solid of constant density, kg/m^3, that a closed mesh bounds. Throws MeshError, which names `object`, if the
/// mesh is not closed or has no volume.
MassProperties solid_properties(const std::string &object, const Mesh &mesh, double density);

/// Where a rigid obstacle is, and how it moves.
struct RigidPose {
  dvec3 center{0, 0, 0};  ///< of mass, m
  std::array<double, 4> rotation{1, 0, 0, 0};  ///< since the start: unit quaternion (w, x, y, z)
  dvec3 velocity{0, 0, 0};  ///< of the centre, m/s
  dvec3 angular_velocity{0, 0, 0};  ///< rad/s
  dvec3 angular_momentum{0, 0, 0};  ///< about the centre, kg m^2/s
  dvec3 contact_force{0, 0, 0};  ///< of other bodies and obstacles on it, without cloth, mean over the last step, N
};

}  // namespace cama
