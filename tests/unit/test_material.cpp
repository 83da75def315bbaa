// SPDX-License-Identifier: Apache-2.0
#include "../catch.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <vector>

#include "cama/error.hpp"
#include "cama/generators.hpp"
#include "cama/material.hpp"

using namespace cama;

namespace {

/// Force per width of a strip pulled along u by a small strain, free to narrow: Young's modulus times thickness.
double uniaxial_u(const Material &m)
{
  const auto &k = m.stretching[0];
  return k[0] - k[1] * k[1] / k[2];
}
double uniaxial_v(const Material &m)
{
  const auto &k = m.stretching[0];
  return k[2] - k[1] * k[1] / k[0];
}

const char *arcsim_text = R"({
  // a comment, as ARCSim's files have them
  "density": 0.3,
  "stretching": [[100, 20, 200, 30], [101, -21, 201, -31], [102, 22, 202, 32], [103, 23, 203, 33], [104, 24, 204, 34], [105, 25, 205, 35]],
  "bending": [[1e-5, 2e-5, 3e-5, 4e-5, 5e-5], [1e-5, 1e-5, 1e-5, 1e-5, 1e-5], [6e-5, 7e-5, 8e-5, 9e-5, 1e-4]]
})";

}  // namespace

TEST_CASE("isotropic material is a sheet in plane stress", "[material]")
{
  const Material m = Material::isotropic(1000, 0.25, 2e-5, 0.15);
  const auto &k = m.stretching[0];
  CHECK(k[0] == Approx(1000 / 0.9375));         // E / (1 - nu^2)
  CHECK(k[1] == Approx(250 / 0.9375));          // nu E / (1 - nu^2)
  CHECK(k[2] == Approx(k[0]));
  CHECK(k[3] == Approx(2 * 400));               // 2 G, G = E / (2 (1 + nu)) = 400
  CHECK(uniaxial_u(m) == Approx(1000));
  CHECK(m.bending[1][3] == Approx(5 * 2e-5));   // hinge stiffness of a plate of 2e-5 N m
  CHECK(m.density == 0.15);
  CHECK_FALSE(m.has_table());
  CHECK(m.has_bending());
  CHECK_NOTHROW(m.validate("sheet"));
  CHECK_FALSE(Material::isotropic(1000, 0.25, 0, 0.15).has_bending());
}

TEST_CASE(
    "the hinges of a sheet held on a cylinder hold five fourths of the plate's energy, so that a free strip holds it",
    "[material]")
{
  const double B = 2e-5, radius = 0.1, length = 0.4;
  const Mesh tube = make_tube(radius, radius, length, 4000).mesh;
  const double k = Material::isotropic(1000, 0, B, 0.1).bending[0][0];
  std::map<std::pair<int, int>, std::vector<int>> faces;
  for (std::size_t f = 0; f < tube.face.size(); ++f)
    for (int i = 0; i < 3; ++i)
      faces[std::minmax(tube.face[f][i], tube.face[f][(i + 1) % 3])].push_back(static_cast<int>(f));
  const auto normal = [&](int f) {   // twice the area long
    const auto &t = tube.face[f];
    return kernels::dcross(kernels::dsub(tube.position[t[1]], tube.position[t[0]]),
                           kernels::dsub(tube.position[t[2]], tube.position[t[0]]));
  };
  double energy = 0;
  for (const auto &[edge, pair] : faces) {
    if (pair.size() != 2) continue;
    const dvec3 n = normal(pair[0]), m = normal(pair[1]);
    const double area = 0.5 * (kernels::dnorm(n) + kernels::dnorm(m)),
                 l = kernels::dnorm(kernels::dsub(tube.position[edge.first], tube.position[edge.second]));
    const double angle = std::atan2(kernels::dnorm(kernels::dcross(n, m)), kernels::ddot(n, m));
    energy += k * l * l * angle * angle / (8 * area);   // as defined for Material::bending
  }
  const double pi = 3.14159265358979323846;
  CHECK(energy == Approx(1.25 * 0.5 * B / (radius * radius) * 2 * pi * radius * length).epsilon(0.01));
}

TEST_CASE("isotropic membrane energy does not depend on the direction", "[material]")
{
  const auto k = Material::isotropic(1000, 0.3, 0, 0.1).stretching[0];
  const auto energy = [&](double e11, double e22, double e12) {
    return 0.5 * k[0] * e11 * e11 + k[1] * e11 * e22 + 0.5 * k[2] * e22 * e22 + k[3] * e12 * e12;
  };
  const double a = 0.02, b = -0.01;   // principal strains
  for (double angle : {0.1, 0.5, 0.785, 1.3}) {
    const double c = std::cos(angle), s = std::sin(angle);
    CHECK(energy(a * c * c + b * s * s, a * s * s + b * c * c, (a - b) * c * s) == Approx(energy(a, b, 0)));
  }
}

TEST_CASE("orthotropic material keeps both moduli and the shear", "[material]")
{
  const Material m = Material::orthotropic(8000, 2000, 0.2, 50, 3e-5, 1e-5, 0.2);
  CHECK(uniaxial_u(m) == Approx(8000));
  CHECK(uniaxial_v(m) == Approx(2000));
  CHECK(m.stretching[0][3] == Approx(100));
  CHECK(m.bending[0][0] == Approx(5e-5));    // a fold along the warp bends the weft
  CHECK(m.bending[2][0] == Approx(15e-5));
  CHECK_THROWS_AS(Material::orthotropic(1, 1, 1.0, 1, 0, 0, 1), MaterialError);
}

TEST_CASE("fabrics ship inside the library with their sources", "[material]")
{
  const auto names = Material::fabric_names();
  CHECK(names.size() >= 8);
  for (const std::string &name : names) {
    CAPTURE(name);
    const Material m = Material::fabric(name);
    CHECK(m.name == name);
    CHECK(m.source.size() > 100);
    CHECK_NOTHROW(m.validate(name));
    CHECK(m.density > 0.03);
    CHECK(m.density < 0.7);
    // bending length (B / (density g))^(1/3): apparel measures 1 to 4 cm by the cantilever method
    const double bending_length = std::cbrt(m.bending[2][0] / 4 / (m.density * 9.81));
    CHECK(bending_length > 0.01);
    CHECK(bending_length < 0.04);
  }
  CHECK(Material::fabric("silk").density == Approx(12 * 4.34e-3).epsilon(0.01));      // 12 momme
  CHECK(Material::fabric("denim").density == Approx(12 * 0.0339).epsilon(0.03));      // 12 oz/yd^2
  const auto stiffness = [](const char *n) {
    const Material m = Material::fabric(n);
    return m.bending[2][0] / m.density;
  };
  // Published drape coefficients: denim 70-90 %, cotton 60-76 %, silk 20-40 %.
  CHECK(stiffness("denim") > stiffness("cotton"));
  CHECK(stiffness("cotton") > stiffness("silk"));
  const std::string text = thrown<MaterialError>([] { Material::fabric("kevlar"); });
  CHECK(contains(text, "kevlar"));
  CHECK(contains(text, "cotton"));
}

TEST_CASE("ARCSim's format is read with its factor of two", "[material]")
{
  const Material m = Material::parse(arcsim_text, "mine");
  CHECK(m.name == "mine");
  CHECK(m.density == 0.3);
  CHECK(m.stretching[0] == std::array<double, 4>{200, 40, 400, 60});
  CHECK(m.stretching[1][3] == -62);   // measured tables have negative entries
  CHECK(m.bending[2][4] == 1e-4);
  CHECK(m.has_table());
}

TEST_CASE("real ARCSim files load", "[material][data]")
{
  const auto folder = test_data("arcsim/materials");
  if (!folder) return;
  int count = 0;
  for (const auto &entry : std::filesystem::directory_iterator(*folder)) {
    if (entry.path().extension() != ".json") continue;
    CAPTURE(entry.path().string());
    CHECK_NOTHROW(Material::load(entry.path()));
    ++count;
  }
  CHECK(count >= 10);
}

TEST_CASE("bad materials are named", "[material]")
{
  const auto broken = [](auto change) {
    Material m = Material::isotropic(1000, 0.3, 1e-5, 0.2);
    change(m);
    const std::string text = thrown<MaterialError>([&] { m.validate("curtain"); });
    CHECK(contains(text, "curtain"));
    return text;
  };
  CHECK(contains(broken([](Material &m) { m.density = -0.1; }), "density is -0.1"));
  CHECK(contains(broken([](Material &m) { m.density = 0; }), "density"));
  CHECK(contains(broken([](Material &m) { m.density = std::nan(""); }), "density"));
  CHECK(contains(broken([](Material &m) { m.damping = -1; }), "damping"));
  CHECK(contains(broken([](Material &m) { m.mass_damping = -1; }), "mass_damping"));
  CHECK(contains(broken([](Material &m) { m.friction = -0.5; }), "friction"));
  CHECK(contains(broken([](Material &m) { m.thickness = -1; }), "thickness"));
  CHECK(contains(broken([](Material &m) {
                   m.friction = 0.4;
                   m.static_friction = 0.39;
                 }),
                 "static_friction is 0.39"));
  CHECK(contains(broken([](Material &m) { m.static_friction = std::nan(""); }), "static_friction"));
  CHECK(contains(broken([](Material &m) { m.contact_stiffness = 0; }), "contact_stiffness"));
  CHECK(contains(broken([](Material &m) { m.contact_stiffness = std::numeric_limits<double>::infinity(); }),
                 "contact_stiffness"));
  CHECK(contains(broken([](Material &m) { m.stretching[3][1] = std::numeric_limits<double>::infinity(); }),
                 "stretching"));
  CHECK(contains(broken([](Material &m) { m.bending[1][2] = -1e-6; }), "bending"));
  CHECK(contains(broken([](Material &m) {
                   for (auto &row : m.stretching) row[1] = 5000;
                 }),
                 "k12"));

  CHECK(contains(thrown<MaterialError>([] {
                   Material::parse("{\"density\": 0.1, \"isotropic\": {\"youngs_modulus\": 1, \"stiff\": 2}}", "x");
                 }),
                 "unknown key \"stiff\""));
  CHECK(contains(thrown<MaterialError>(
                     [] { Material::parse("{\"stretching\": [[1,1,1,1]], \"bending\": [], \"density\": 1}", "x"); }),
                 "expected 6 rows"));
  CHECK(contains(thrown<MaterialError>([] { Material::parse("{", "x"); }), "not JSON"));
  CHECK(contains(thrown<FileError>([] { Material::load("/no/such/fabric.json"); }), "/no/such/fabric.json"));
}
