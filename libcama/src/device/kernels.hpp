// SPDX-License-Identifier: Apache-2.0
// Every kernel as a C++ function: in cama::kernels those that are always double, in cama::kernels::f64 and ::f32 those
// of the two precisions.
#pragma once
#include "cama/types.hpp"
#include "kernels/dialect/caching.h"
#include "kernels/dialect/lanes.h"

namespace cama::kernels {
#include "device/kernel_functions.inc"
}  // namespace cama::kernels

namespace cama {

/// The value types of one precision.
template <class Real> struct Types;
#define CAMA_TYPES(Real, space)                                        \
  template <> struct Types<Real> {                                     \
    using vec3 = kernels::space::vec3;                                 \
    using vec4 = kernels::space::vec4;                                 \
    using mat3 = kernels::space::mat3;                                 \
    using stretching_stiffness = kernels::space::stretching_stiffness; \
    using strain_limit = kernels::space::strain_limit;                 \
    using bending_stiffness = kernels::space::bending_stiffness;       \
    using triangle_rest = kernels::space::triangle_rest;               \
    using triangle_factor = kernels::space::triangle_factor;           \
    using hinge_rest = kernels::space::hinge_rest;                     \
    using hinge_factor = kernels::space::hinge_factor;                 \
    using hinge_coupling = kernels::space::hinge_coupling;             \
    using moment_step = kernels::space::moment_step;                   \
    using plastic_material = kernels::space::plastic_material;         \
    using plastic_triangle = kernels::space::plastic_triangle;         \
    using plastic_hinge = kernels::space::plastic_hinge;               \
    using term = kernels::space::term;                                 \
  };
CAMA_TYPES(double, f64)
CAMA_TYPES(float, f32)
#undef CAMA_TYPES

}  // namespace cama
