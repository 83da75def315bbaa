// SPDX-License-Identifier: Apache-2.0
// The linear solve against Eigen: products, preconditioners, elimination of prescribed vertices, broken systems.
#include "../backends.hpp"

#include <cmath>
#include <cstring>
#include <limits>
#include <random>

#include <Eigen/Dense>
#include <Eigen/Sparse>
#include <Eigen/SparseCholesky>

#include "../engine.hpp"
#include "../meshes.hpp"
#include "cama/error.hpp"
#include "device/launch.hpp"
#include "stages/linear_solve.hpp"

using namespace cama;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using Eigen::VectorXd;

namespace {

template <class V> Vector3d eigen(const V &v)
{
  return {static_cast<double>(v.x), static_cast<double>(v.y), static_cast<double>(v.z)};
}
template <class M> Matrix3d eigen_matrix(const M &m)
{
  Matrix3d r;
  for (int a = 0; a < 3; ++a) r.row(a) = eigen(m.row[a]).transpose();
  return r;
}

/// The system that the engine would solve next, over all vertices: A (with terms), b, and prescribed values.
struct System64 {
  Eigen::SparseMatrix<double> matrix;
  VectorXd right, prescribed;
  std::vector<bool> free;
};

System64 download(StagedEngine &engine)
{
  State &s = engine.state;
  System<double> &y = s.system.template of<double>();
  const auto row = y.matrix.row.download(), column = y.matrix.column.download(), fixed = s.mesh.fixed.download();
  const auto block = y.matrix.block.download();
  const auto velocity = s.mesh.velocity.download(), target = s.mesh.velocity_next.download();
  const auto force = y.force.download();
  const auto mass = y.mass.download();
  const int n = s.mesh.vertices;
  System64 r{Eigen::SparseMatrix<double>(3 * n, 3 * n), VectorXd::Zero(3 * n), VectorXd::Zero(3 * n), {}};
  std::vector<Eigen::Triplet<double>> entries;
  const auto add = [&](int i, int j, const Matrix3d &m) {
    for (int a = 0; a < 3; ++a)
      for (int b = 0; b < 3; ++b) entries.emplace_back(3 * i + a, 3 * j + b, m(a, b));
  };
  for (int i = 0; i < s.mesh.cloth_vertices; ++i) {
    const auto p = static_cast<std::size_t>(i);
    for (int k = row[p]; k < row[p + 1]; ++k)
      add(i, column[static_cast<std::size_t>(k)], eigen_matrix(block[static_cast<std::size_t>(k)]));
    r.right.segment<3>(3 * i) = s.time.step * eigen(force[p]) + mass[p] * eigen(velocity[p]);
  }
  if (s.system.terms && s.options.paper.assembly == Assembly::gather)
    for (const auto &t : y.term.download())
      for (int a = 0; a < 4; ++a)
        for (int b = 0; b < 4; ++b)
          if (t.node[a] >= 0 && t.node[b] >= 0)
            add(t.node[a], t.node[b],
                t.weight[a] * t.weight[b] *
                    (t.along * eigen(t.normal) * eigen(t.normal).transpose() + t.around * Matrix3d::Identity()));
  if (s.system.terms)
    for (const auto &t : y.term.download())
      for (int a = 0; a < 4; ++a)
        if (t.node[a] >= 0) r.right.segment<3>(3 * t.node[a]) += t.weight[a] * t.push * eigen(t.normal);
  if (s.system.terms) {   // friction that holds without a velocity
    const auto term = y.term.download();
    const auto hold = y.hold.download();
    for (std::size_t i = 0; i < hold.size(); ++i)
      for (int a = 0; a < 4; ++a)
        if (term[i].node[a] >= 0) r.right.segment<3>(3 * term[i].node[a]) += term[i].weight[a] * eigen(hold[i]);
  }
  for (int i = 0; i < n; ++i) {
    r.free.push_back(!fixed[static_cast<std::size_t>(i)]);
    r.prescribed.segment<3>(3 * i) = eigen(target[static_cast<std::size_t>(i)]);
  }
  r.matrix.setFromTriplets(entries.begin(), entries.end());
  return r;
}

/// Eigen's solution, over all vertices.
VectorXd solve(const System64 &s)
{
  std::vector<int> place(s.free.size(), -1);
  int count = 0;
  for (std::size_t i = 0; i < s.free.size(); ++i)
    if (s.free[i]) place[i] = count++;
  VectorXd known = s.prescribed, right(3 * count);
  for (std::size_t i = 0; i < s.free.size(); ++i)
    if (s.free[i]) known.segment<3>(3 * static_cast<int>(i)).setZero();
  const VectorXd moved = s.matrix * known;
  std::vector<Eigen::Triplet<double>> entries;
  for (int k = 0; k < s.matrix.outerSize(); ++k)
    for (Eigen::SparseMatrix<double>::InnerIterator e(s.matrix, k); e; ++e) {
      const int i = place[static_cast<std::size_t>(e.row() / 3)], j = place[static_cast<std::size_t>(e.col() / 3)];
      if (i >= 0 && j >= 0)
        entries.emplace_back(3 * i + static_cast<int>(e.row() % 3), 3 * j + static_cast<int>(e.col() % 3), e.value());
    }
  for (std::size_t i = 0; i < s.free.size(); ++i)
    if (s.free[i])
      right.segment<3>(3 * place[i]) =
          s.right.segment<3>(3 * static_cast<int>(i)) - moved.segment<3>(3 * static_cast<int>(i));
  Eigen::SparseMatrix<double> matrix(3 * count, 3 * count);
  matrix.setFromTriplets(entries.begin(), entries.end());
  Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factor(matrix);
  REQUIRE(factor.info() == Eigen::Success);
  const VectorXd x = factor.solve(right);
  VectorXd all = s.prescribed;
  for (std::size_t i = 0; i < s.free.size(); ++i)
    if (s.free[i]) all.segment<3>(3 * static_cast<int>(i)) = x.segment<3>(3 * place[i]);
  return all;
}

double distance(const std::vector<dvec3> &a, const VectorXd &b, int n)
{
  double most = 0;
  for (int i = 0; i < n; ++i)
    most = std::max(most, (eigen(a[static_cast<std::size_t>(i)]) - b.segment<3>(3 * i)).norm());
  return most / b.cwiseAbs().maxCoeff();
}

Options options(Preconditioner preconditioner, LinearSolver solver = LinearSolver::conjugate_gradient,
                Assembly assembly = Assembly::gather)
{
  Options o = serial();
  o.precision = Precision::full;
  o.preconditioner = preconditioner;
  o.solver = solver;
  o.paper.assembly = assembly;
  o.tolerance = 1e-11;
  o.integrator = Integrator::backward_euler;
  o.newton_iterations = 1;
  return o;
}

const Preconditioner preconditioners[] = {Preconditioner::none, Preconditioner::jacobi, Preconditioner::block_jacobi,
                                          Preconditioner::schwarz};

/// Stretched sheets on a ball with a pin that moves: contacts, friction, prescribed vertices of cloth and obstacle.
Scene busy()
{
  Scene s = meshes::pile(8);
  Pin pin;
  pin.vertices = {0, 5};
  pin.motion.velocity = {0, -0.5, 0.2};
  s.pins.push_back(pin);
  s.stitches.push_back({0, 80, 1, 80, 79, 0.25, 500});
  return s;
}

/// Stiff and uneven, so that preconditioning helps.
Scene uneven()
{
  Scene s = meshes::hanging(12);
  s.cloths[0].material = Material::isotropic(2000, 0.3, 1e-4, 0.1);
  s.cloths.push_back(
      meshes::cloth(meshes::grid(10, 10, 0.1, 0.4, 1), Material::isotropic(20, 0.3, 1e-6, 1.5), "heavy"));
  s.cloths[1].velocity = {0, 0, 2};
  return s;
}

}  // namespace

TEST_CASE("bcsr_multiply equals Eigen's product", "[solver]")
{
  const auto backend = make_backend("auto", 0, 2);
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  const int n = 60;
  std::vector<int> row{0}, column, fixed;
  std::vector<kernels::f64::mat3> block;
  std::vector<dvec3> dummy;
  std::vector<kernels::f64::vec3> x;
  Eigen::MatrixXd dense = Eigen::MatrixXd::Zero(3 * n, 3 * n);
  VectorXd v(3 * n);
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      if (i != j && random() % 6) continue;
      if (i == 7) continue;   // an empty row
      column.push_back(j);
      kernels::f64::mat3 m;
      for (auto &r : m.row) r = {normal(random), normal(random), normal(random)};
      block.push_back(m);
      if (i != 9) dense.block<3, 3>(3 * i, 3 * j) = eigen_matrix(m);
    }
    row.push_back(static_cast<int>(column.size()));
    fixed.push_back(i == 9);   // a fixed row gives zero
    x.push_back({normal(random), normal(random), normal(random)});
    v.segment<3>(3 * i) = eigen(x.back());
  }
  Stream<int> rows(*backend, row), columns(*backend, column), fixed_stream(*backend, fixed);
  Stream<kernels::f64::mat3> blocks(*backend, block);
  Stream<kernels::f64::vec3> in(*backend, x), out(*backend, n);
  const VectorXd expected = dense * v;
  for (const int parts : {1, 3}) {
    CAMA_LAUNCH_REAL(double, *backend, bcsr_multiply, parts *n, parts, rows, columns, blocks, fixed_stream,
                     nothing<double>(), nothing<kernels::f64::mat3>(), 0, nothing<int>(), nothing<int>(),
                     nothing<kernels::f64::term>(), nothing<kernels::f64::vec3>(), in, out);
    const auto y = out.download();
    for (int i = 0; i < n; ++i)
      REQUIRE((eigen(y[static_cast<std::size_t>(i)]) - expected.segment<3>(3 * i)).norm() < 1e-13 * expected.norm());
  }
}

TEST_CASE("bcsr_multiply adds terms, however many a row has", "[solver]")
{
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  const int n = 12, terms = 90;
  std::vector<int> row(n + 1), column, fixed(n, 0), term_row{0}, entries;
  std::vector<kernels::f64::mat3> block;
  std::vector<kernels::f64::term> list;
  std::vector<kernels::f64::vec3> x;
  std::vector<std::vector<int>> at(n);
  Eigen::MatrixXd dense = Eigen::MatrixXd::Zero(3 * n, 3 * n);
  VectorXd v(3 * n);
  for (int i = 0; i < n; ++i) {
    x.push_back({normal(random), normal(random), normal(random)});
    v.segment<3>(3 * i) = eigen(x.back());
  }
  for (int t = 0; t < terms; ++t) {
    // Vertex 0 is in all of them, vertex 1 in none.
    kernels::f64::term term{{0, 2 + t % 5, 7 + t % 3, t % 4 ? 10 + t % 2 : -1}, {}, {}, 0, 0, 0};
    const Eigen::Vector3d direction = Eigen::Vector3d(normal(random), normal(random), normal(random)).normalized();
    for (double &w : term.weight) w = normal(random);
    if (term.node[3] < 0) term.weight[3] = 0;
    term.normal = {direction.x(), direction.y(), direction.z()};
    term.along = std::abs(normal(random));
    term.around = std::abs(normal(random));
    const Eigen::Matrix3d whole =
        term.along * direction * direction.transpose() + term.around * Eigen::Matrix3d::Identity();
    for (int a = 0; a < 4; ++a) {
      if (term.node[a] < 0) continue;
      at[static_cast<std::size_t>(term.node[a])].push_back(4 * t + a);
      for (int b = 0; b < 4; ++b)
        if (term.node[b] >= 0)
          dense.block<3, 3>(3 * term.node[a], 3 * term.node[b]) += term.weight[a] * term.weight[b] * whole;
    }
    list.push_back(term);
  }
  for (const std::vector<int> &own : at) {
    entries.insert(entries.end(), own.begin(), own.end());
    term_row.push_back(static_cast<int>(entries.size()));
  }
  column.push_back(0);
  block.push_back({});
  const VectorXd expected = dense * v;
  for (const std::string &name : backends_here()) {
    INFO(name);
    const auto backend = make_backend(name, 0, 2);
    Stream<int> rows(*backend, row), columns(*backend, column), fixed_stream(*backend, fixed),
        term_rows(*backend, term_row), incidence(*backend, entries);
    Stream<kernels::f64::mat3> blocks(*backend, block);
    Stream<kernels::f64::term> term_stream(*backend, list);
    Stream<kernels::f64::vec3> in(*backend, x), out(*backend, n), product(*backend, terms);
    CAMA_LAUNCH_REAL(double, *backend, term_products, terms, term_stream, in, product);
    for (const int parts : {1, 3}) {
      CAMA_LAUNCH_REAL(double, *backend, bcsr_multiply, parts *n, parts, rows, columns, blocks, fixed_stream,
                       nothing<double>(), nothing<kernels::f64::mat3>(), terms, term_rows, incidence, term_stream,
                       product, in, out);
      const auto y = out.download();
      for (int i = 0; i < n; ++i)
        REQUIRE((eigen(y[static_cast<std::size_t>(i)]) - expected.segment<3>(3 * i)).norm() < 1e-13 * expected.norm());
    }
  }
}

TEST_CASE("bcsr_multiply by differences: masses and springs, and what all share costs no rounding", "[solver]")
{
  // A chain of springs of 1e6 between masses of 1e-3: rows of the matrix add up to the masses.
  const auto backend = make_backend("auto", 0, 2);
  const int n = 40;
  const float spring = 1e6f, mass = 1e-3f;
  std::vector<int> row{0}, column;
  std::vector<kernels::f32::mat3> block;
  std::vector<kernels::f32::vec3> uniform(n, {6.1f, -0.7f, 1.3f}), apart;
  for (int i = 0; i < n; ++i) {
    for (int j = std::max(0, i - 1); j <= std::min(n - 1, i + 1); ++j) {
      const float value = i != j ? -spring : (i > 0) * spring + (i < n - 1) * spring + mass;
      column.push_back(j);
      block.push_back({{{value, 0, 0}, {0, value, 0}, {0, 0, value}}});
    }
    row.push_back(static_cast<int>(column.size()));
    apart.push_back({static_cast<float>(i * i), 1, 2});
  }
  Stream<int> rows(*backend, row), columns(*backend, column), fixed(*backend, std::vector<int>(n, 0));
  Stream<kernels::f32::mat3> blocks(*backend, block);
  Stream<float> masses(*backend, std::vector<float>(n, mass));
  Stream<kernels::f32::vec3> in(*backend, uniform), out(*backend, n);
  const auto multiply = [&](int parts) {
    CAMA_LAUNCH_REAL(float, *backend, bcsr_multiply, parts *n, parts, rows, columns, blocks, fixed, masses,
                     nothing<kernels::f32::mat3>(), 0, nothing<int>(), nothing<int>(), nothing<kernels::f32::term>(),
                     nothing<kernels::f32::vec3>(), in, out);
  };
  for (const int parts : {1, 3}) {
    in.assign(uniform);
    multiply(parts);
    for (const auto &y : out.download()) REQUIRE((y.x == mass * 6.1f && y.y == mass * -0.7f && y.z == mass * 1.3f));
    in.assign(apart);
    multiply(parts);
    const auto y = out.download();
    // (i - 1)^2 - 2 i^2 + (i + 1)^2 = 2.
    for (int i = 1; i < n - 1; ++i)
      REQUIRE(y[static_cast<std::size_t>(i)].x == Approx(mass * i * i - 2.0 * spring).epsilon(1e-6));
  }
}

namespace {

/// Largest error of the inverse relative to the true one, and how many inverses were not positive definite.
struct Inverses {
  double worst = 0;
  int indefinite = 0;
};

/// Random symmetric blocks with eigenvalues (1, middle, 1 / condition), times random scales; middle is 1 or 1 /
/// condition: the latter is a contact on a light vertex.
template <class Real, class Block, class Invert> Inverses invert_random(double condition, double middle, Invert invert)
{
  using Exact = Eigen::Matrix<long double, 3, 3>;
  std::mt19937 random(2);
  std::normal_distribution<double> normal;
  Inverses result;
  for (int i = 0; i < 3000; ++i) {
    Matrix3d g;
    for (int k = 0; k < 9; ++k) g(k / 3, k % 3) = normal(random);
    const Matrix3d q = Eigen::HouseholderQR<Matrix3d>(g).householderQ();
    const Matrix3d a =
        std::pow(10.0, 2 * normal(random)) * q * Vector3d(1, middle, 1 / condition).asDiagonal() * q.transpose();
    Block m;
    for (int r = 0; r < 3; ++r)
      m.row[r] = {static_cast<Real>(a(r, 0)), static_cast<Real>(a(r, 1)), static_cast<Real>(a(r, 2))};
    m.row[1].x = m.row[0].y;
    m.row[2].x = m.row[0].z;
    m.row[2].y = m.row[1].z;
    const Matrix3d inverse = eigen_matrix(invert(m));
    const Exact exact = eigen_matrix(m).template cast<long double>().llt().solve(Exact::Identity());
    result.worst =
        std::max(result.worst, static_cast<double>((inverse.cast<long double>() - exact).norm() / exact.norm()));
    const double least =
        Eigen::SelfAdjointEigenSolver<Matrix3d>(0.5 * (inverse + inverse.transpose())).eigenvalues()[0];
    result.indefinite += !(least > 0);
  }
  return result;
}

}  // namespace

TEST_CASE("mat3_inverse_spd equals Eigen's inverse up to condition 1e9", "[solver]")
{
  for (double condition : {1.0, 1e2, 1e4, 1e6, 1e9})
    for (double middle : {1.0, 1 / condition}) {
      const Inverses r = invert_random<double, kernels::f64::mat3>(
          condition, middle, [](auto m) { return kernels::f64::mat3_inverse_spd(m); });
      INFO("condition " << condition << ", middle " << middle << ": error " << r.worst << ", indefinite "
                        << r.indefinite);
      CHECK(r.worst < 3e-15 * condition + 1e-15);   // rounding times condition: backward stable
      CHECK(r.indefinite == 0);
    }
}

TEST_CASE("mat3_inverse_spd in single precision stays positive definite up to condition 1e5", "[solver]")
{
  for (double condition : {1.0, 1e2, 1e4, 1e5})
    for (double middle : {1.0, 1 / condition}) {
      const Inverses r = invert_random<float, kernels::f32::mat3>(
          condition, middle, [](auto m) { return kernels::f32::mat3_inverse_spd(m); });
      INFO("condition " << condition << ", middle " << middle << ": error " << r.worst << ", indefinite "
                        << r.indefinite);
      CHECK(r.worst < 1.5e-6 * condition + 1e-6);
      CHECK(r.indefinite == 0);
    }
}

TEST_CASE("mat3_inverse_spd of badly scaled diagonals is exact to rounding", "[solver]")
{
  kernels::f64::mat3 m = kernels::f64::mat3_zero();
  m.row[0].x = 1e-9;
  m.row[1].y = 1;
  m.row[2].z = 1e9;
  const Matrix3d inverse = eigen_matrix(kernels::f64::mat3_inverse_spd(m));
  CHECK(inverse(0, 0) == Approx(1e9).epsilon(1e-15));
  CHECK(inverse(1, 1) == Approx(1).epsilon(1e-15));
  CHECK(inverse(2, 2) == Approx(1e-9).epsilon(1e-15));
}

TEST_CASE("conjugate gradient with each preconditioner and the direct solve equal Eigen on a step with contacts",
          "[solver]")
{
  for (int warm_up : {0, 3}) {
    for (Assembly assembly : {Assembly::gather, Assembly::algorithm1, Assembly::sorted})
      for (int way = 0; way < 6; ++way) {
        INFO("assembly " << static_cast<int>(assembly) << ", way " << way << ", after " << warm_up << " steps");
        Options o = options(preconditioners[std::min(way, 3)],
                            way == 5 ? LinearSolver::direct : LinearSolver::conjugate_gradient, assembly);
        if (way == 4) o.precision = Precision::mixed;
        StagedEngine engine(busy(), o);
        for (int i = 0; i < warm_up; ++i) engine.step();
        engine.run_before("linear solve");
        REQUIRE(engine.state.contact.contacts > 10);
        const VectorXd expected = solve(download(engine));
        engine.find("linear solve")->run(engine.state);
        CHECK(distance(engine.state.mesh.velocity_next.download(), expected, engine.state.mesh.vertices) < 1e-8);
      }
  }
}

TEST_CASE("a moving obstacle pulls equally with every kind of assembly", "[solver]")
{
  std::vector<std::vector<dvec3>> velocity;
  for (Assembly assembly : {Assembly::gather, Assembly::algorithm1, Assembly::sorted}) {
    StagedEngine engine(busy(), options(Preconditioner::block_jacobi, LinearSolver::direct, assembly));
    engine.run_before("linear solve");
    REQUIRE(engine.state.contact.contacts > 10);
    engine.find("linear solve")->run(engine.state);
    velocity.push_back(engine.state.mesh.velocity_next.download());
  }
  for (std::size_t k = 1; k < velocity.size(); ++k) {
    double most = 0;
    for (std::size_t i = 0; i < velocity[0].size(); ++i)
      most = std::max(most, (eigen(velocity[k][i]) - eigen(velocity[0][i])).norm());
    INFO("assembly " << k << " differs from gather by " << most << " m/s");
    CHECK(most < 1e-8);
  }
}

TEST_CASE("all solvers take a simulation to the same place", "[solver]")
{
  std::vector<std::vector<dvec3>> position;
  for (int way = 0; way < 6; ++way) {
    Options o =
        options(preconditioners[std::min(way, 3)], way == 5 ? LinearSolver::direct : LinearSolver::conjugate_gradient);
    if (way == 4) o.precision = Precision::mixed;
    Simulation simulation(uneven(), o);
    for (int i = 0; i < 5; ++i) simulation.step();
    position.push_back(simulation.positions());
  }
  for (int way = 1; way < 6; ++way)
    for (std::size_t i = 0; i < position[0].size(); ++i)
      REQUIRE((eigen(position[static_cast<std::size_t>(way)][i]) - eigen(position[0][i])).norm() < 1e-8);
}

TEST_CASE("vertices that a pin lets go are solved for from then on", "[solver]")
{
  Scene scene = meshes::hanging(8);
  scene.pins[0].release = 2.5 * scene.time_step;
  std::vector<std::vector<dvec3>> position;
  for (int way = 0; way < 5; ++way) {
    Options o =
        options(preconditioners[std::min(way, 3)], way == 4 ? LinearSolver::direct : LinearSolver::conjugate_gradient);
    Simulation simulation(scene, o);
    for (int i = 0; i < 6; ++i) simulation.step();
    position.push_back(simulation.positions());
  }
  for (int way = 0; way < 4; ++way)
    for (std::size_t i = 0; i < position[4].size(); ++i)
      REQUIRE((eigen(position[static_cast<std::size_t>(way)][i]) - eigen(position[4][i])).norm() < 1e-8);
}

TEST_CASE("the solve in single precision stays near the one in double", "[solver]")
{
  std::vector<std::vector<dvec3>> position;
  for (const char *precision : {"double", "single"}) {
    Options o = serial();
    o.precision = precision_of(precision);
    o.tolerance = 1e-5;
    Simulation simulation(meshes::hanging(8), o);
    for (int i = 0; i < 10; ++i) simulation.step();
    position.push_back(simulation.positions());
  }
  double most = 0;
  for (std::size_t i = 0; i < position[0].size(); ++i)
    most = std::max(most, (eigen(position[0][i]) - eigen(position[1][i])).norm());
  INFO("largest distance " << most << " m");
  CHECK(most < 1e-4);
  CHECK(most > 0);
}

TEST_CASE("Jacobi needs fewer iterations than no preconditioner, block Jacobi no more than Jacobi, Schwarz fewer still",
          "[solver]")
{
  int iterations[4];
  for (int k = 0; k < 4; ++k) {
    Options o = options(preconditioners[k]);
    o.tolerance = 1e-6;
    Simulation simulation(uneven(), o);
    int sum = 0;
    for (int i = 0; i < 5; ++i) {
      simulation.step();
      sum += simulation.report().iterations;
    }
    iterations[k] = sum;
  }
  INFO("none " << iterations[0] << ", jacobi " << iterations[1] << ", block jacobi " << iterations[2] << ", schwarz "
               << iterations[3]);
  CHECK(iterations[1] < iterations[0]);
  CHECK(iterations[2] <= iterations[1]);
  CHECK(10 * iterations[3] < 7 * iterations[2]);
}

TEST_CASE("a solve that reaches its limit keeps its result and reports its residual", "[solver]")
{
  for (Preconditioner preconditioner : preconditioners) {
    INFO("preconditioner " << static_cast<int>(preconditioner));
    Options o = options(preconditioner);
    o.max_iterations = 2;
    Simulation simulation(uneven(), o);
    const auto before = simulation.velocities();
    simulation.step();
    CHECK(simulation.report().iterations == 2);
    CHECK(simulation.report().residual > 1e-6);
    double most = 0;
    const auto after = simulation.velocities();
    for (std::size_t i = 0; i < before.size(); ++i) most = std::max(most, (eigen(after[i]) - eigen(before[i])).norm());
    CHECK(most > 1e-3);
  }
}

TEST_CASE("prescribed degrees of freedom are eliminated exactly", "[solver]")
{
  Scene scene = meshes::hanging(6);
  scene.pins[0].motion.velocity = {0.3, -0.2, 0.1};
  for (LinearSolver solver : {LinearSolver::conjugate_gradient, LinearSolver::direct})
    for (const char *precision : {"double", "single"}) {
      Options o = serial();
      o.solver = solver;
      o.precision = precision_of(precision);
      StagedEngine engine(scene, o);
      for (int i = 1; i <= 5; ++i) {
        engine.step();
        const RigidTransform now = scene.pins[0].motion.at(i * scene.time_step);
        for (int v : scene.pins[0].vertices) {
          const dvec3 expected = now.apply(scene.cloths[0].mesh.position[static_cast<std::size_t>(v)]),
                      got = engine.state.mesh.position.at(v);
          CHECK(got.x == expected.x);   // to the bit: independent of solver and precision
          CHECK(got.y == expected.y);
          CHECK(got.z == expected.z);
        }
      }
    }
}

TEST_CASE("a system that is not positive definite raises SolverError and says the step", "[solver]")
{
  for (const char *precision : {"double", "single"})
    for (Preconditioner preconditioner : preconditioners) {
      INFO(precision << ", preconditioner " << static_cast<int>(preconditioner));
      Options o = options(preconditioner);
      o.precision = precision_of(precision);
      o.tolerance = 1e-4;
      StagedEngine engine(meshes::hanging(6), o);
      engine.run_before("linear solve");
      const auto poke = [&](auto &stream) {
        auto block = stream.download();
        for (auto &b : block) b.row[2].z = -std::abs(b.row[2].z) * 100;
        stream.assign(block);
      };
      if (engine.state.system.f32)
        poke(engine.state.system.f32->matrix.block);
      else
        poke(engine.state.system.f64->matrix.block);
      const std::string text = thrown<SolverError>([&] { engine.find("linear solve")->run(engine.state); });
      CHECK(contains(text, "step 1"));
    }
}

TEST_CASE("a system that is not finite raises SolverError", "[solver]")
{
  for (LinearSolver solver : {LinearSolver::conjugate_gradient, LinearSolver::direct})
    for (bool in_matrix : {true, false}) {
      INFO((solver == LinearSolver::direct ? "direct, " : "conjugate gradient, ") << (in_matrix ? "matrix" : "force"));
      StagedEngine engine(meshes::hanging(6), options(Preconditioner::block_jacobi, solver));
      engine.run_before("linear solve");
      const double nan = std::numeric_limits<double>::quiet_NaN();
      System<double> &s = engine.state.system.template of<double>();
      if (in_matrix) {
        auto block = s.matrix.block.download();
        block[block.size() / 2].row[1].y = nan;
        s.matrix.block.assign(block);
      } else {
        auto force = s.force.download();
        force[force.size() / 2].y = nan;
        s.force.assign(force);
      }
      const auto rest = [&] {
        engine.find("linear solve")->run(engine.state);
        engine.find("advance positions")->run(engine.state);
        engine.find("finish step")->run(engine.state);
      };
      CHECK_THROWS_AS(rest(), SolverError);
    }
}

TEST_CASE("the solve starts from, and stops at, what it reports", "[solver]")
{
  Options o = options(Preconditioner::jacobi);
  o.tolerance = 1e-3;
  Simulation simulation(uneven(), o);
  simulation.step();
  CHECK(simulation.report().residual <= 1e-3);
  CHECK(simulation.report().iterations > 0);
  o.max_iterations = 4;
  o.tolerance = 1e-12;
  Simulation cut(uneven(), o);
  cut.step();
  CHECK(cut.report().iterations == 4);
}
