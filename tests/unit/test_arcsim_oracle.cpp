// SPDX-License-Identifier: Apache-2.0
// Forces, masses and matrix products of two deformed meshes in a measured fabric, as printed by ARCSim 0.2.1, against
// the kernels with ARCSim's conventions: bending sampled at the signed curvature, wind on the area at rest.
#include "../catch.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <string>

#include <nlohmann/json.hpp>

#include "cama/scene.hpp"
#include "device/kernels.hpp"
#include "model/topology.hpp"

using namespace cama;

namespace {

using Rows = std::vector<dvec3>;

struct Oracle {
  Scene scene;
  Rows x, v, p, force, stiffness_p, b_dt, a_dt_p, external;
  std::vector<double> mass;
  nlohmann::json edges;
  double energy = 0;
};

constexpr double time_step = 0.005, damping = 0.01;  // of b_dt and A_dt_p
constexpr int arcsim_convention = 1;

Oracle read_oracle(const std::filesystem::path &file, const std::filesystem::path &material)
{
  Oracle o;
  const nlohmann::json json = nlohmann::json::parse(std::ifstream(file));
  const auto row = [](const nlohmann::json &r) { return dvec3{r[0], r[1], r[2]}; };
  for (const auto &n : json["nodes"]) {
    const double j = static_cast<double>(o.x.size());
    o.x.push_back(row(n["x"]));
    o.v.push_back(row(n["v"]));
    o.p.push_back({std::sin(1 + j), std::sin(2 + 5 * j), std::sin(3 + 11 * j)});
    o.mass.push_back(n["m"]);
    o.force.push_back(row(n["F"]));
    o.stiffness_p.push_back(row(n["Kp"]));
    o.b_dt.push_back(row(n["b_dt"]));
    o.a_dt_p.push_back(row(n["A_dt_p"]));
    o.external.push_back(row(n["fext"]));
  }
  Mesh mesh;
  mesh.position = o.x;
  for (const auto &f : json["faces"]) {
    const int m = static_cast<int>(mesh.material_position.size());
    mesh.face.push_back({f["n"][0], f["n"][1], f["n"][2]});
    mesh.material_face.push_back({m, m + 1, m + 2});
    for (const auto &u : f["u"]) mesh.material_position.push_back({u[0], u[1]});
  }
  o.scene.gravity = {0, 0, -9.8};
  o.scene.cloths.push_back({"cloth", mesh, Material::load(material), {0, 0, 0}, ""});
  o.edges = json["edges"];
  o.energy = json["energy"];
  return o;
}

/// Largest difference of two lists of vectors over the largest component of the second.
double difference(const Rows &a, const Rows &b)
{
  double off = 0, scale = 0;
  for (std::size_t i = 0; i < b.size(); ++i) {
    off = std::max({off, std::abs(a[i].x - b[i].x), std::abs(a[i].y - b[i].y), std::abs(a[i].z - b[i].z)});
    scale = std::max({scale, std::abs(b[i].x), std::abs(b[i].y), std::abs(b[i].z)});
  }
  return off / scale;
}

/// Median over vertices of |a - b| / |b|: small vertices count as much as large ones.
double median_difference(const Rows &a, const Rows &b)
{
  std::vector<double> off;
  for (std::size_t i = 0; i < b.size(); ++i) {
    const dvec3 d = kernels::dsub(a[i], b[i]);
    off.push_back(kernels::dnorm(d) / kernels::dnorm(b[i]));
  }
  std::nth_element(off.begin(), off.begin() + static_cast<long>(off.size() / 2), off.end());
  return off[off.size() / 2];
}

/// Elements of the mesh of the reference data in one precision.
template <class Real> struct Elements {
  using T = Types<Real>;
  using V = typename T::vec3;
  Topology topology;
  Rows x;
  std::vector<typename T::stretching_stiffness> table;
  typename T::bending_stiffness bending;
  std::vector<typename T::triangle_rest> triangle;
  std::vector<typename T::hinge_rest> hinge;
  std::vector<typename T::triangle_factor> triangle_factor;
  std::vector<typename T::hinge_factor> hinge_factor;
  std::vector<V> triangle_force, hinge_force;

  explicit Elements(const Oracle &o) : topology(build_topology(o.scene)), x(o.x)
  {
    const Material &m = o.scene.cloths[0].material;
    for (const auto &k : stretching_table(m)) table.push_back({{Real(k[0]), Real(k[1]), Real(k[2]), Real(k[3])}});
    for (int k = 0; k < 15; ++k) bending.k[k] = Real(m.bending[k / 5][k % 5]);
    for (const RestTriangle &r : topology.triangle) {
      typename T::triangle_rest e{};
      std::copy(r.node.begin(), r.node.end(), e.node);
      for (int k = 0; k < 4; ++k) e.d[k] = Real(r.d[k]);
      e.area = Real(r.area);
      triangle.push_back(e);
    }
    for (const RestHinge &r : topology.hinge) {
      typename T::hinge_rest e{};
      std::copy(r.node.begin(), r.node.end(), e.node);
      e.rest_angle = Real(r.rest_angle);
      e.length = Real(r.length);
      e.area = Real(r.area);
      for (int k = 0; k < 2; ++k) e.direction[k] = Real(r.direction[k]);
      hinge.push_back(e);
    }
    triangle_factor.resize(triangle.size());
    hinge_factor.resize(hinge.size());
    triangle_force.resize(3 * triangle.size());
    hinge_force.resize(4 * hinge.size());
  }
  void evaluate(double scale)
  {
    const int start = 0;
    const Real matrix_scale = static_cast<Real>(scale);
    evaluate_triangles(int(triangle.size()), triangle.data(), table.data(), &start, &matrix_scale,
                       std::sqrt(matrix_scale), x.data(), triangle_factor.data(), triangle_force.data());
    evaluate_hinges(int(hinge.size()), hinge.data(), &bending, &matrix_scale, arcsim_convention, x.data(),
                    hinge_factor.data(), hinge_force.data());
  }
  void evaluate_wind(const Rows &v, const dvec3 &wind, double density, double drag, int convention)
  {
    const std::vector<double> areal_density(1, 1.0);
    const int limited = 0;
    std::fill(triangle_force.begin(), triangle_force.end(), V{0, 0, 0});
    std::fill(hinge_force.begin(), hinge_force.end(), V{0, 0, 0});
    add_wind(int(triangle.size()), triangle.data(), x.data(), v.data(), &wind, areal_density.data(), Real(density),
             Real(drag), convention, limited, Real(1e-6), triangle_force.data());
  }
  /// Through gather_forces.
  Rows forces(const dvec3 &gravity) const
  {
    const int n = int(x.size());
    std::vector<kernels::element_nodes> triangles, hinges;
    for (const auto &t : triangle) triangles.push_back({{t.node[0], t.node[1], t.node[2], -1}});
    for (const auto &h : hinge) hinges.push_back({{h.node[0], h.node[1], h.node[2], h.node[3]}});
    const auto incidence = [n](const std::vector<kernels::element_nodes> &nodes, std::vector<int> &row) {
      std::vector<std::vector<int>> lists(static_cast<std::size_t>(n));
      for (std::size_t e = 0; e < nodes.size(); ++e)
        for (int a = 0; a < 4; ++a)
          if (nodes[e].node[a] >= 0) lists[nodes[e].node[a]].push_back(int(4 * e) + a);
      std::vector<int> entry;
      row.assign(1, 0);
      for (const auto &l : lists) {
        entry.insert(entry.end(), l.begin(), l.end());
        row.push_back(int(entry.size()));
      }
      return entry;
    };
    std::vector<int> triangle_row, hinge_row;
    const std::vector<int> triangle_entry = incidence(triangles, triangle_row),
                           hinge_entry = incidence(hinges, hinge_row);
    std::vector<Real> mass;
    for (double m : topology.mass) mass.push_back(Real(m));
    std::vector<V> force(x.size());
    gather_forces(n, triangle_row.data(), triangle_entry.data(), triangle_force.data(), hinge_row.data(),
                  hinge_entry.data(), hinge_force.data(), int(hinge.size()), mass.data(), &gravity, force.data(), 0,
                  nullptr, nullptr, nullptr);
    return widen(force);
  }
  static Rows widen(const std::vector<V> &a)
  {
    Rows r;
    for (const V &f : a) r.push_back({f.x, f.y, f.z});
    return r;
  }
  /// Scaled stiffness times p, from the blocks of all elements.
  Rows product(const Rows &p) const
  {
    std::vector<V> y(x.size(), V{0, 0, 0});
    const auto multiply = [&](const int *node, int corners, auto &&block) {
      for (int a = 0; a < corners; ++a)
        for (int b = 0; b < corners; ++b) {
          const dvec3 &q = p[node[b]];
          y[node[a]] = add(y[node[a]], mat3_multiply(block(a, b), V{Real(q.x), Real(q.y), Real(q.z)}));
        }
    };
    for (std::size_t e = 0; e < triangle.size(); ++e)
      multiply(triangle[e].node, 3, [&](int a, int b) { return triangle_block(triangle_factor[e], a, b); });
    for (std::size_t e = 0; e < hinge.size(); ++e)
      multiply(hinge[e].node, 4, [&](int a, int b) { return hinge_block(hinge_factor[e], a, b); });
    return widen(y);
  }
};

const char *const meshes[] = {"square", "tshirt"};

template <class Run> void with_oracles(Run run)
{
  for (const char *name : meshes) {
    const auto file = test_data(std::string("arcsim/oracle/forces_") + name + "_gray-interlock.json");
    const auto material = test_data("arcsim/materials/gray-interlock.json");
    if (!file || !material) return;
    DYNAMIC_SECTION(name) { run(read_oracle(*file, *material)); }
  }
}

}  // namespace

TEST_CASE("masses, angles and bending stiffness equal ARCSim's", "[oracle][data]")
{
  with_oracles([](const Oracle &o) {
    Elements<double> e(o);
    double off = 0, largest = 0;
    for (std::size_t i = 0; i < o.mass.size(); ++i) {
      off = std::max(off, std::abs(e.topology.mass[i] - o.mass[i]));
      largest = std::max(largest, o.mass[i]);
    }
    CHECK(off <= 1e-12 * largest);

    std::map<std::pair<int, int>, const RestHinge *> hinges;
    for (const RestHinge &h : e.topology.hinge) hinges[std::minmax(h.node[0], h.node[1])] = &h;
    REQUIRE(hinges.size() == o.edges.size());
    double angle = 0, length = 0, stiffness = 0, scale = 0;
    for (double k : e.bending.k) scale = std::max(scale, k);
    for (const auto &edge : o.edges) {
      const int a = edge["n"][0], b = edge["n"][1];
      const auto found = hinges.find(std::minmax(a, b));
      REQUIRE(found != hinges.end());
      const std::size_t h = static_cast<std::size_t>(found->second - e.topology.hinge.data());
      const double theta = load_hinge(e.hinge[h], e.x.data()).angle;
      angle = std::max(angle, std::abs(theta + edge["theta"].get<double>()));  // ARCSim's sign is the opposite
      length = std::max(length, std::abs(e.hinge[h].length / edge["l"].get<double>() - 1));
      const double expected = std::min(edge["k"][0].get<double>(), edge["k"][1].get<double>());
      stiffness = std::max(
          stiffness, std::abs(hinge_stiffness(&e.bending, e.hinge[h], theta, arcsim_convention) - expected) / scale);
    }
    CAPTURE(angle, length, stiffness);
    CHECK(angle < 1e-12);
    CHECK(length < 1e-12);
    CHECK(stiffness < 1e-6);
  });
}

TEMPLATE_TEST_CASE("forces and matrix products equal ARCSim's", "[oracle][data]", double, float)
{
  const double bound = sizeof(TestType) == 8 ? 1e-6 : 1e-4;
  with_oracles([bound](const Oracle &o) {
    Elements<TestType> e(o);
    e.evaluate(1);
    const Rows force = e.forces({0, 0, 0}), stiffness_p = e.product(o.p);
    e.evaluate(time_step * (time_step + damping));
    const Rows a_dt_p = e.product(o.p);
    Rows b_dt = e.product(o.v);  // b = dt (F + (dt + damping) J v) with J = -K
    for (std::size_t i = 0; i < b_dt.size(); ++i)
      b_dt[i] = kernels::dsub(kernels::dscale(time_step, force[i]), b_dt[i]);
    CAPTURE(difference(force, o.force), difference(stiffness_p, o.stiffness_p), difference(b_dt, o.b_dt),
            difference(a_dt_p, o.a_dt_p));
    CAPTURE(median_difference(force, o.force), median_difference(stiffness_p, o.stiffness_p));
    CHECK(difference(force, o.force) < bound);
    CHECK(difference(stiffness_p, o.stiffness_p) < bound);
    CHECK(difference(b_dt, o.b_dt) < bound);
    CHECK(difference(a_dt_p, o.a_dt_p) < bound);
    CHECK(median_difference(force, o.force) < bound);
    CHECK(median_difference(stiffness_p, o.stiffness_p) < bound);
  });
}

TEMPLATE_TEST_CASE("gravity and wind equal ARCSim's external force", "[oracle][data]", double, float)
{
  const double bound = sizeof(TestType) == 8 ? 1e-6 : 1e-4;
  with_oracles([bound](const Oracle &o) {
    Elements<TestType> e(o);
    e.evaluate_wind(o.v, {10, 0, 2}, 1, 0.3, arcsim_convention);
    const Rows external = e.forces({0, 0, -9.8});
    CAPTURE(difference(external, o.external));
    CHECK(difference(external, o.external) < bound);
  });
}

TEST_CASE("the energy equals ARCSim's but for the shear term, which ARCSim prints halved", "[oracle][data]")
{
  with_oracles([](const Oracle &o) {
    Elements<double> e(o);
    double energy = 0;
    const int start = 0;
    for (const auto &r : e.triangle) {
      const auto edge = [&](int a) { return kernels::f64::to_vec3(kernels::dsub(o.x[r.node[a]], o.x[r.node[0]])); };
      const auto g = triangle_strain(r, edge(1), edge(2));
      const auto k = material_stretching(e.table.data(), &start, r, g);
      energy += r.area * (stretching_energy(g, k) - 0.5 * k.k[3] * g.e01 * g.e01);
    }
    std::vector<double> bending(e.hinge.size());
    measure_hinges(int(e.hinge.size()), e.hinge.data(), &e.bending, arcsim_convention, o.x.data(), bending.data());
    for (double b : bending) energy += b;
    CHECK(energy == Approx(o.energy).epsilon(1e-6));
  });
}
