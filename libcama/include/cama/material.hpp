// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <filesystem>
#include <string>
#include <vector>

namespace cama {

/// A fabric after Wang, O'Brien and Ramamoorthi, "Data-driven elastic models for cloth" (2011), in SI units.
/// The membrane energy per area is k11 E11^2/2 + k12 E11 E22 + k22 E22^2/2 + k33 E12^2 with Green strain E.
struct Material {
  std::string name = "isotropic";
  std::string source;                                    ///< where the values come from
  double density = 0.2;                                  ///< kg/m^2
  /// [6][k11 k12 k22 k33] N/m: row 0 unstrained, rows 1 to 5 at stretch 1/6 in directions 0, 22.5, 45, 67.5, 90 degrees
  /// from warp
  std::array<std::array<double, 4>, 6> stretching{};
  /// [fold line at 0, 45, 90 degrees from warp][curvature 0, 5, 10, 15, 20 1/m] N m: the hinge stiffness k of E = k l^2
  /// angle^2 / (8 A), with l the shared edge and A the area of both faces; `isotropic` and `orthotropic` take a plate's
  /// stiffness and set five times that
  std::array<std::array<double, 5>, 3> bending{};
  double damping = 0;  ///< stiffness damping c, s: D = -c K
  /// Mass damping a, 1/s: D = -a M on the velocity relative to the air, which is at rest without a wind. Free fall ends
  /// at the speed g / a; a swing loses half its amplitude in 1.39 / a.
  double mass_damping = 0;
  /// Strain of warp, weft and shear from which stress grows `limit_stiffening` times as fast; 0: none. Weave locks so.
  double strain_limit = 0;
  double limit_stiffening = 50;  ///< 1 or more
  /// Elastic curvature at which bending becomes plastic, 1/m: the cloth keeps what it is bent beyond it. 0: never.
  double yield_curvature = 0;
  double hardening = 0;  ///< share of the bending stiffness that is left beyond the yield curvature, 0 or more, below 1
  double friction = -1;  ///< Coulomb coefficient of cloth against cloth while it slides; -1: the scene's
  /// While it sticks, not below `friction`; -1: equal to `friction`, or the scene's if `friction` is the scene's.
  double static_friction = -1;
  double thickness = 0;  ///< contact thickness, m; 0: the scene's
  double contact_stiffness = -1;  ///< penalty, N/m^3; -1: the scene's

  bool has_table() const;  ///< the rows of `stretching` differ, so that it is sampled
  bool has_bending() const;  ///< some bending stiffness is above zero
  /// Throws MaterialError, which names the field: not finite, negative density or damping, ...
  void validate(const std::string &object) const;

  /// From Young's modulus times thickness [N/m], Poisson ratio, bending stiffness [N m] (of a plate, per unit width).
  static Material isotropic(double youngs_modulus, double poisson_ratio, double bending, double density);
  /// From warp and weft moduli times thickness [N/m], geometric mean of the two Poisson ratios, shear modulus times
  /// thickness [N/m], bending stiffness along warp and weft [N m] (of a plate, per unit width; bending along the warp
  /// curves the warp yarns).
  static Material orthotropic(double youngs_warp, double youngs_weft, double poisson_ratio, double shear,
                              double bending_warp, double bending_weft, double density);
  /// One of the fabrics that ship with cama ("cotton", "denim", "silk", ...). Throws MaterialError, which lists the
  /// names.
  static Material fabric(const std::string &name);
  static std::vector<std::string> fabric_names();
  /// A JSON file: cama's own format, or ARCSim's (density, stretching 6x4, bending 3x5; its stiffnesses are half of
  /// those here).
  static Material load(const std::filesystem::path &file);
  static Material parse(const std::string &json, const std::string &name);
};

}  // namespace cama
