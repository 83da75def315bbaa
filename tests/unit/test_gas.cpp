// SPDX-License-Identifier: Apache-2.0
// Enclosed gas: pressure by volume, volumes of solids in closed form, the derivative of the volume, and its stiffness
// in products with the matrix.
#include "../catch.hpp"

#include <cmath>

#include "../backends.hpp"
#include "../engine.hpp"
#include "../meshes.hpp"
#include "stages/linear_solve.hpp"

using namespace cama;

namespace {

/// A box with its corners at the origin and at `size`, with faces that point outwards.
Mesh box(const dvec3 &size)
{
  Mesh m;
  for (int k = 0; k < 8; ++k) m.position.push_back({k & 1 ? size.x : 0, k & 2 ? size.y : 0, k & 4 ? size.z : 0});
  m.face = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
            {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
  return m;
}

Scene two_boxes()
{
  Scene s;
  s.time_step = 1.0 / 100;
  s.contact.enabled = false;
  s.cloths.push_back(meshes::cloth(box({0.1, 0.2, 0.3}), Material::isotropic(100, 0.3, 0, 0.1), "first"));
  s.cloths.push_back(meshes::cloth(box({0.2, 0.2, 0.2}), Material::isotropic(100, 0.3, 0, 0.1), "second"));
  s.cloths[0].gas = Gas{1000, 0, 1e5};
  s.cloths[1].gas = Gas{0, 0.004, 5e4};
  return s;
}

}  // namespace

TEST_CASE("gas has the pressure of its volume, and -dp/dV = p / V", "[gas]")
{
  kernels::gas g{};
  g.amount = 600;
  g.ambient = 1e5;
  g.least_volume = 1e-5;
  const kernels::gas_state s = kernels::gas_in_volume(g, 0.005, 0.1);
  CHECK(s.pressure == Approx(2e4));
  CHECK(s.stiffness == Approx(0.01 * 1.2e5 / 0.005));
  const double by = 1e-8;
  CHECK(s.stiffness / 0.01 == Approx((kernels::gas_in_volume(g, 0.005 - by, 0.1).pressure -
                                      kernels::gas_in_volume(g, 0.005 + by, 0.1).pressure) /
                                     (2 * by)));
  // Below the least volume the pressure is on the tangent: twice as high without volume.
  const kernels::gas_state none = kernels::gas_in_volume(g, 0, 0.1);
  CHECK(none.pressure == Approx(2 * 600 / 1e-5 - 1e5));
  CHECK(none.stiffness == Approx(0.01 * 600 / 1e-10));
  CHECK(none.volume == 0);
  CHECK(kernels::gas_in_volume(g, -1e-5, 0.1).pressure == Approx(3 * 600 / 1e-5 - 1e5));
}

TEST_CASE("a simulation measures the volume of boxes and the pressure in them", "[gas]")
{
  for (const std::string &backend : backends_here()) {
    OptionOverrides options;
    options.set("backend", backend);
    Simulation simulation(two_boxes(), options);
    std::vector<GasState> gas = simulation.gas();
    REQUIRE(gas.size() == 2);
    CHECK(gas[0].volume == Approx(0.006));
    CHECK(gas[0].pressure == Approx(1000));
    CHECK(gas[0].amount == Approx(1.01e5 * 0.006));
    CHECK(gas[1].cloth == 1);
    CHECK(gas[1].volume == Approx(0.008));
    CHECK(gas[1].pressure == Approx(5e4 / 2 - 5e4));
    simulation.set_gas(1, 800, 2e4);
    gas = simulation.gas();
    CHECK(gas[1].pressure == Approx(8e4));
    CHECK(gas[0].pressure == Approx(1000));
  }
}

TEST_CASE("the gas's product with the matrix is k a (a . x), with the derivative of the volume", "[gas]")
{
  for (const std::string &backend : backends_here()) {
    Options o = serial();
    o.backend = backend;
    o.precision = Precision::full;
    o.solver = LinearSolver::conjugate_gradient;
    StagedEngine engine(two_boxes(), o);
    engine.run_before("linear solve");
    System<double> &s = *engine.state.system.f64;
    const auto state = engine.state.system.gas.state.download();
    const auto gradient = s.gas_gradient.download();
    // A box that grows along x from its face at x = 0.1 has dV/dx = 0.2 x 0.3 m^2 over the four corners there.
    CHECK(gradient[1].x + gradient[3].x + gradient[5].x + gradient[7].x == Approx(0.06));
    std::vector<kernels::f64::vec3> x(16), q;
    for (std::size_t i = 0; i < 16; ++i) x[i] = {0.1 * double(i), 1 - 0.2 * double(i), double(i % 3)};
    double rate[2] = {0, 0};
    for (std::size_t i = 0; i < 16; ++i)
      rate[i / 8] += gradient[i].x * x[i].x + gradient[i].y * x[i].y + gradient[i].z * x[i].z;
    Stream<kernels::f64::vec3> on_device(*engine.state.backend, x), product(*engine.state.backend, 16);
    product.fill_zero();
    multiply_gas<double>(*engine.state.backend, engine.state.system, on_device, 2, Stream<int>(), product);
    q = product.download();
    for (std::size_t i = 0; i < 16; ++i) {
      CHECK(q[i].x == Approx(2 * state[i / 8].stiffness * rate[i / 8] * gradient[i].x));
      CHECK(q[i].z == Approx(2 * state[i / 8].stiffness * rate[i / 8] * gradient[i].z));
    }
  }
}
