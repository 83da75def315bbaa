// SPDX-License-Identifier: Apache-2.0
#include "cama/material.hpp"

#include <algorithm>
#include <cmath>

#include "cama/error.hpp"
#include "device/embedded_text.hpp"
#include "scene/constants.hpp"
#include "scene/reading/json_reader.hpp"
#include "scene/reading/material_json.hpp"
#include "scene/reading/text_file.hpp"

namespace cama {
namespace {

// ARCSim doubles the tabulated stretching stiffness before use; its tabulated bending stiffness is that of the hinge,
// as here.
constexpr double arcsim_stretching_scale = 2.0;

std::array<std::array<double, 4>, 6> same_rows(const std::array<double, 4> &row)
{
  std::array<std::array<double, 4>, 6> rows;
  rows.fill(row);
  return rows;
}

void set_bending(Material &m, double warp, double weft)
{
  // The row is the direction of the fold line: a fold along the warp bends the weft yarns.
  m.bending[0].fill(hinge_per_plate * weft);
  m.bending[1].fill(hinge_per_plate * 0.5 * (warp + weft));
  m.bending[2].fill(hinge_per_plate * warp);
}

Material from_isotropic(const Field &f, double density)
{
  f.only({"youngs_modulus", "poisson_ratio", "bending", "density"});
  return Material::isotropic(f.at("youngs_modulus").finite(), f.finite("poisson_ratio", 0.3), f.finite("bending", 0),
                             f.finite("density", density));
}

Material from_orthotropic(const Field &f, double density)
{
  f.only({"youngs_warp", "youngs_weft", "poisson_ratio", "shear", "bending_warp", "bending_weft", "density"});
  return Material::orthotropic(f.at("youngs_warp").finite(), f.at("youngs_weft").finite(), f.finite("poisson_ratio", 0),
                               f.at("shear").finite(), f.finite("bending_warp", 0), f.finite("bending_weft", 0),
                               f.finite("density", density));
}

template <std::size_t Rows, std::size_t Columns>
std::array<std::array<double, Columns>, Rows> table(const Field &f, double scale)
{
  const auto items = f.items();
  if (items.size() != Rows)
    f.fail("expected " + std::to_string(Rows) + " rows of " + std::to_string(Columns) + " numbers, got " +
           std::to_string(items.size()) + " rows");
  std::array<std::array<double, Columns>, Rows> rows;
  for (std::size_t r = 0; r < Rows; ++r) {
    const auto v = items[r].numbers(Columns);
    for (std::size_t c = 0; c < Columns; ++c) rows[r][c] = scale * v[c];
  }
  return rows;
}

Material from_arcsim(const Field &f)
{
  f.only({"density", "stretching", "bending", "damping", "yield_curv", "weakening", "strain_min", "strain_max"});
  Material m;
  m.source = "ARCSim-format file";
  m.density = f.at("density").finite();
  m.stretching = table<6, 4>(f.at("stretching"), arcsim_stretching_scale);
  m.bending = table<3, 5>(f.at("bending"), 1.0);
  m.damping = f.finite("damping", 0);
  return m;
}

Material from_cama(const Field &f)
{
  f.only({"format",          "name",         "description",      "source",          "units",     "evidence",
          "density",         "isotropic",    "orthotropic",      "stretching",      "bending",   "damping",
          "mass_damping",    "strain_limit", "limit_stiffening", "yield_curvature", "hardening", "friction",
          "static_friction", "thickness",    "contact_stiffness"});
  const double density = f.finite("density", 0.2);
  const int forms = f.has("isotropic") + f.has("orthotropic") + f.has("stretching");
  if (forms != 1) f.fail("give exactly one of \"isotropic\", \"orthotropic\", \"stretching\" (with \"bending\")");
  Material m;
  if (f.has("isotropic"))
    m = from_isotropic(f.at("isotropic"), density);
  else if (f.has("orthotropic"))
    m = from_orthotropic(f.at("orthotropic"), density);
  else {
    m.stretching = table<6, 4>(f.at("stretching"), 1.0);
    if (f.has("bending")) m.bending = table<3, 5>(f.at("bending"), 1.0);
    m.density = density;
    m.name = "table";
  }
  m.name = f.text("name", m.name);
  m.source = f.text("source", m.source);
  m.damping = f.finite("damping", 0);
  m.mass_damping = f.finite("mass_damping", 0);
  m.strain_limit = f.finite("strain_limit", 0);
  m.limit_stiffening = f.finite("limit_stiffening", m.limit_stiffening);
  m.yield_curvature = f.finite("yield_curvature", 0);
  m.hardening = f.finite("hardening", 0);
  m.friction = f.finite("friction", m.friction);
  m.static_friction = f.finite("static_friction", m.static_friction);
  m.thickness = f.finite("thickness", 0);
  m.contact_stiffness = f.finite("contact_stiffness", m.contact_stiffness);
  return m;
}

void require(bool good, const std::string &object, const char *field, double value, const char *advice)
{
  if (!good)
    throw MaterialError("material of " + object + ": " + field + " is " + std::to_string(value) + "; " + advice);
}

}  // namespace

bool Material::has_table() const
{
  return std::any_of(stretching.begin() + 1, stretching.end(), [&](const auto &row) { return row != stretching[0]; });
}

bool Material::has_bending() const
{
  for (const auto &row : bending)
    for (double b : row)
      if (b > 0) return true;
  return false;
}

void Material::validate(const std::string &object) const
{
  require(std::isfinite(density) && density > 0, object, "density", density,
          "give kilograms per square metre, greater than 0");
  require(std::isfinite(damping) && damping >= 0, object, "damping", damping, "give seconds, 0 or more");
  require(std::isfinite(mass_damping) && mass_damping >= 0, object, "mass_damping", mass_damping,
          "give 1/s, 0 or more");
  require(std::isfinite(strain_limit) && strain_limit >= 0, object, "strain_limit", strain_limit,
          "give a strain such as 0.05, or 0 for none");
  require(std::isfinite(limit_stiffening) && limit_stiffening >= 1, object, "limit_stiffening", limit_stiffening,
          "give a factor of 1 or more");
  require(std::isfinite(yield_curvature) && yield_curvature >= 0, object, "yield_curvature", yield_curvature,
          "give 1/m, such as 100, or 0 for cloth that never creases");
  require(hardening >= 0 && hardening < 1, object, "hardening", hardening, "give a share from 0 to below 1");
  require(friction == -1 || (std::isfinite(friction) && friction >= 0), object, "friction", friction,
          "give a Coulomb coefficient, 0 or more, or leave it out for the scene's");
  require(static_friction == -1 || (std::isfinite(static_friction) && static_friction >= std::max(friction, 0.0)),
          object, "static_friction", static_friction,
          "give a Coulomb coefficient not below friction, or leave it out for the same");
  require(contact_stiffness == -1 || (std::isfinite(contact_stiffness) && contact_stiffness > 0), object,
          "contact_stiffness", contact_stiffness, "give N/m^3, greater than 0, or leave it out for the scene's");
  require(std::isfinite(thickness) && thickness >= 0, object, "thickness", thickness,
          "give metres, 0 or more (0: the scene's)");
  for (const auto &row : stretching) {
    for (double k : row) require(std::isfinite(k), object, "stretching", k, "every entry must be finite, N/m");
    require(row[0] >= 0, object, "stretching k11", row[0], "give N/m, 0 or more");
    require(row[2] >= 0, object, "stretching k22", row[2], "give N/m, 0 or more");
  }
  if (!has_table()) {   // measured tables may hold negative k12 and k33, which the evaluation clamps
    const auto &k = stretching[0];
    require(k[3] >= 0, object, "stretching k33", k[3], "give N/m, 0 or more");
    require(k[1] * k[1] <= k[0] * k[2] * (1 + 1e-12), object, "stretching k12", k[1],
            "k12^2 must not exceed k11 k22 (Poisson ratio below 1)");
  }
  for (const auto &row : bending)
    for (double b : row) require(std::isfinite(b) && b >= 0, object, "bending", b, "give N m, 0 or more");
}

Material Material::isotropic(double youngs_modulus, double poisson_ratio, double bending, double density)
{
  const double shear = youngs_modulus / (2 * (1 + poisson_ratio));
  Material m = orthotropic(youngs_modulus, youngs_modulus, poisson_ratio, shear, bending, bending, density);
  m.name = "isotropic";
  return m;
}

Material Material::orthotropic(double youngs_warp, double youngs_weft, double poisson_ratio, double shear,
                               double bending_warp, double bending_weft, double density)
{
  if (!(std::abs(poisson_ratio) < 1))
    throw MaterialError("poisson_ratio is " + std::to_string(poisson_ratio) +
                        "; a sheet needs a value between -1 and 1");
  if (!(youngs_warp >= 0) || !(youngs_weft >= 0)) throw MaterialError("Young's modulus must be 0 or more, N/m");
  const double scale = 1 / (1 - poisson_ratio * poisson_ratio);   // plane stress; poisson_ratio^2 = nu_12 nu_21
  Material m;
  m.name = "orthotropic";
  m.source = "given by the scene";
  m.density = density;
  // E12 is half the engineering shear strain: G (2 E12)^2 / 2 = k33 E12^2 with k33 = 2 G.
  m.stretching = same_rows({scale * youngs_warp, scale * poisson_ratio * std::sqrt(youngs_warp * youngs_weft),
                            scale * youngs_weft, 2 * shear});
  set_bending(m, bending_warp, bending_weft);
  return m;
}

Material Material::fabric(const std::string &name)
{
  for (const EmbeddedText *f = embedded_fabrics; f->name; ++f)
    if (name == f->name) return parse(f->text, name);
  std::string names;
  for (const std::string &n : fabric_names()) names += (names.empty() ? "" : ", ") + n;
  throw MaterialError("no fabric \"" + name + "\"; there are: " + names);
}

std::vector<std::string> Material::fabric_names()
{
  std::vector<std::string> names;
  for (const EmbeddedText *f = embedded_fabrics; f->name; ++f) names.emplace_back(f->name);
  std::sort(names.begin(), names.end());
  return names;
}

Material Material::load(const std::filesystem::path &file) { return parse(read_text(file), file.stem().string()); }

Material Material::parse(const std::string &json, const std::string &name)
{
  const Json value = parse_json(json, [&](const std::string &what) {
    throw MaterialError("material " + name + ": " + what);
  });   // comments are allowed: ARCSim's files have some
  return parse_material(Field(value, "material " + name, raise_material_error), name);
}

Material parse_material(const Field &f, const std::string &name)
{
  if (!f.json().is_object()) f.fail("expected an object with a material");
  const bool arcsim = f.has("stretching") && !f.has("format");
  Material m = arcsim ? from_arcsim(f) : from_cama(f);
  if (arcsim || !f.has("name")) m.name = name;
  m.validate(name);
  return m;
}

Json material_json(const Material &m)
{
  Json json = {
      {"format", "cama"},           {"name", m.name},       {"source", m.source},   {"density", m.density},
      {"stretching", m.stretching}, {"bending", m.bending}, {"damping", m.damping}, {"thickness", m.thickness}};
  if (m.mass_damping > 0) json["mass_damping"] = m.mass_damping;
  if (m.strain_limit > 0) {
    json["strain_limit"] = m.strain_limit;
    json["limit_stiffening"] = m.limit_stiffening;
  }
  if (m.yield_curvature > 0) {
    json["yield_curvature"] = m.yield_curvature;
    json["hardening"] = m.hardening;
  }
  if (m.friction >= 0) json["friction"] = m.friction;
  if (m.static_friction >= 0) json["static_friction"] = m.static_friction;
  if (m.contact_stiffness >= 0) json["contact_stiffness"] = m.contact_stiffness;
  return json;
}

}  // namespace cama
