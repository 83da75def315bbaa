// SPDX-License-Identifier: Apache-2.0
// Arrays shared with other libraries on the device: what is lent stays as it is, and vectors from the device act as
// those from the host. On every backend whose memory has addresses.
#include "../backends.hpp"
#include "../catch.hpp"

#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "../meshes.hpp"
#include "cama/error.hpp"
#include "cama/simulation.hpp"
#include "cama/stream.hpp"
#include "device/launch.hpp"

using namespace cama;

namespace {

Scene sheet_over_ball()
{
  Scene scene;
  Cloth sheet;
  sheet.name = "sheet";
  sheet.mesh = meshes::grid(6, 6, 0.3, 0.3, -0.15, -0.15, 0.105);
  sheet.material = Material::isotropic(500, 0.3, 1e-5, 0.15);
  scene.cloths.push_back(sheet);
  Obstacle ball;
  ball.name = "ball";
  ball.mesh = meshes::sphere(12, 8, 0.1);
  scene.obstacles.push_back(ball);
  return scene;
}

OptionOverrides options_on(const std::string &backend)
{
  OptionOverrides o;
  o.set("backend", backend);
  o.set("time_step", 1 / 240.0);
  o.set("forces", true);
  return o;
}

std::vector<std::string> backends_with_addresses()
{
  std::vector<std::string> names;
  for (const std::string &name : backends_here())
    if (name != "opencl") names.push_back(name);
  return names;
}

bool same(const std::vector<dvec3> &a, const std::vector<dvec3> &b)
{
  if (a.size() != b.size()) return false;
  for (std::size_t i = 0; i < a.size(); ++i)
    if (a[i].x != b[i].x || a[i].y != b[i].y || a[i].z != b[i].z) return false;
  return true;
}

/// Memory of another user of the device.
struct Other {
  explicit Other(const std::string &name) : backend(make_backend(name, 0, 1)) {}
  template <class T> DeviceVectors vectors(Stream<T> &stream, const std::vector<T> &values, int size)
  {
    stream = Stream<T>(*backend, values);
    backend->synchronize();
    return {stream.buffer(), size, sizeof(T) == sizeof(float)};
  }
  std::unique_ptr<Backend> backend;
};

std::vector<float> floats(const std::vector<dvec3> &values)
{
  std::vector<float> result;
  for (const dvec3 &v : values)
    for (double x : {v.x, v.y, v.z}) result.push_back(static_cast<float>(x));
  return result;
}

}  // namespace

TEST_CASE("what is lent stays as it is, and outlives the simulation", "[device arrays]")
{
  for (const std::string &name : backends_with_addresses()) {
    INFO(name);
    std::optional<Simulation> simulation(std::in_place, sheet_over_ball(), options_on(name));
    Simulation undisturbed(sheet_over_ball(), options_on(name));
    std::vector<DeviceArray> arrays;
    std::vector<std::vector<dvec3>> moments;
    for (int k = 0; k < 12; ++k) {
      arrays.push_back(simulation->device_positions());
      moments.push_back(simulation->positions());
      arrays.push_back(simulation->device_velocities());
      moments.push_back(simulation->velocities());
      arrays.push_back(simulation->device_forces());
      moments.push_back(simulation->forces());
      CHECK(simulation->device_positions().data() == arrays[arrays.size() - 3].data());
      if (k % 3 == 2) arrays.erase(arrays.begin()), moments.erase(moments.begin());
      simulation->step();
      undisturbed.step();
    }
    CHECK(simulation->state_hash() == undisturbed.state_hash());
    const DeviceArray own = arrays.front().copy();
    CHECK(own.data() != arrays.front().data());
    for (int round = 0; round < 2; ++round) {
      for (std::size_t i = 0; i < arrays.size(); ++i) REQUIRE(same(arrays[i].download(), moments[i]));
      REQUIRE(same(own.download(), moments.front()));
      simulation.reset();
    }
  }
}

TEST_CASE("vectors on the device act as those of the host", "[device arrays]")
{
  for (const std::string &name : backends_with_addresses()) {
    INFO(name);
    Simulation host(sheet_over_ball(), options_on(name)), device(sheet_over_ball(), options_on(name));
    Other other(name);
    const int n = host.cloth_vertex_count();
    std::vector<dvec3> x, v(static_cast<std::size_t>(n), dvec3{0.25, 0, -0.5}), f{{0.125, 0, 0.25}, {0, -0.25, 1}};
    const std::vector<dvec3> all = host.positions();
    for (int i = 0; i < n; ++i) x.push_back({all[i].x, all[i].y, all[i].z + 0.125});
    Stream<dvec3> doubles, more;
    Stream<float> singles;
    host.set_state(x, v);
    device.set_state(other.vectors(doubles, x, n), other.vectors(singles, floats(v), n));  // exact in floats
    CHECK(host.state_hash() == device.state_hash());
    host.set_force({3, 7}, f);
    device.set_force({3, 7}, other.vectors(singles, floats(f), 2));
    host.set_force({7, 4}, f);
    device.set_force({7, 4}, other.vectors(more, f, 2));
    for (int k = 0; k < 3; ++k) host.step(), device.step();
    CHECK(host.state_hash() == device.state_hash());
    CHECK(same(device.download("positions", other.vectors(doubles, x, n), n), x));
  }
}

TEST_CASE("vectors on the device that do not fit are named, and nothing changes", "[device arrays]")
{
  for (const std::string &name : backends_with_addresses()) {
    INFO(name);
    Simulation simulation(sheet_over_ball(), options_on(name));
    simulation.step();
    const std::uint64_t before = simulation.state_hash();
    Other other(name);
    const int n = simulation.cloth_vertex_count();
    std::vector<dvec3> x(static_cast<std::size_t>(n), dvec3{0, 0, 1}), holed = x;
    holed[9].y = std::numeric_limits<double>::quiet_NaN();
    holed[5].z = std::numeric_limits<double>::infinity();
    Stream<dvec3> good, bad;
    const DeviceVectors fine = other.vectors(good, x, n), spoilt = other.vectors(bad, holed, n);
    CHECK_THROWS_WITH(simulation.set_state(fine, spoilt), "set_state: velocities[5] is not finite");
    CHECK_THROWS_WITH(simulation.set_force({1}, fine), "set_force: forces: has 49 rows; 1 are needed");
    CHECK_THROWS_AS(simulation.set_force({1, 1}, {good.buffer(), 2, false}), SceneError);
    CHECK(contains(thrown<SceneError>([&] { simulation.set_force({1}, {nullptr, 1, false}); }), "is not in memory of"));
    CHECK_THROWS_AS(simulation.set_state(fine, fine), CollisionError);  // all vertices at one place
    if (name == "cuda") {
      const std::string text = thrown<SceneError>([&] { simulation.set_force({1}, {x.data(), 1, false}); });
      CHECK(contains(text, "is not in memory of"));
    }
    CHECK(simulation.state_hash() == before);
  }
}

TEST_CASE("memory without addresses is not lent", "[device arrays]")
{
  if (!backend_here("opencl")) return;
  Simulation simulation(sheet_over_ball(), options_on("opencl"));
  simulation.step();
  CHECK_THROWS_AS(simulation.device_positions(), BackendError);
  CHECK_THROWS_AS(simulation.device_forces(), BackendError);
  simulation.step();
}

TEST_CASE("vectors are widened, scaled and searched", "[device arrays]")
{
  for (const std::string &name : backends_here()) {
    INFO(name);
    const std::unique_ptr<Backend> b = make_backend(name, 0, 1);
    std::vector<float> single;
    for (int i = 0; i < 3000; ++i) single.push_back(0.1f * static_cast<float>(i));
    const Stream<float> from(*b, single);
    Stream<dvec3> to(*b, 1000);
    CAMA_LAUNCH(*b, widen_vectors, 1000, from, to);
    CAMA_LAUNCH(*b, scale_vectors, 1000, 2.0, to);
    const std::vector<dvec3> doubled = to.download();
    for (std::size_t i = 0; i < 1000; ++i) REQUIRE(doubled[i].y == 2.0 * static_cast<double>(single[3 * i + 1]));
    Stream<int> bad(*b, 1);
    bad.fill_zero();
    CAMA_LAUNCH(*b, find_nonfinite_vector, 1000, to, bad);
    CHECK(bad.at(0) == 0);
  }
}
