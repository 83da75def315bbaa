// SPDX-License-Identifier: Apache-2.0
// The Schwarz preconditioner: blocks of neighbours and their inverses, which are the same on every backend.
#include "../backends.hpp"

#include <numeric>
#include <random>
#include <set>

#include <Eigen/Dense>

#include "../engine.hpp"
#include "../meshes.hpp"
#include "device/launch.hpp"
#include "solver/aggregates.hpp"

using namespace cama;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

/// A sheet with pins, before its first solve.
StagedEngine before_solve(int cells, const std::string &backend)
{
  Scene scene = meshes::pile(cells);
  Pin pin;
  pin.vertices = {0, 5, 17};
  scene.pins.push_back(pin);
  Options o = serial();
  o.backend = backend;
  StagedEngine engine(scene, o);
  engine.run_before("linear solve");
  return engine;
}

Stream<kernels::f64::mat3> diagonal_of(StagedEngine &engine)
{
  System<double> &s = engine.state.system.template of<double>();
  Stream<kernels::f64::mat3> diagonal(*engine.backend, engine.state.mesh.cloth_vertices);
  CAMA_LAUNCH_REAL(double, *engine.backend, extract_diagonal, engine.state.mesh.cloth_vertices, s.matrix.row,
                   s.matrix.column, s.matrix.block, diagonal);
  return diagonal;
}

/// One block of `rows` vertices with a dense matrix, and what the kernels compute from it.
struct Block {
  Block(Backend &b, const MatrixXd &a) : rows(static_cast<int>(a.rows()) / 3), backend(b)
  {
    std::vector<int> start{0, rows}, column, order(static_cast<std::size_t>(rows));
    std::vector<float> value;
    std::iota(order.begin(), order.end(), 0);
    const int width = (rows + 1) / 2 * 2;
    for (int k = 0; k < width; ++k)
      for (int l = 0; l < SLICE_ROWS; ++l) column.push_back(k < rows && l < rows ? k : 0);
    for (int k = 0; k < width; ++k)
      for (int c = 0; c < 9; ++c)
        for (int l = 0; l < SLICE_ROWS; ++l)
          value.push_back(k < rows && l < rows ? static_cast<float>(a(3 * l + c / 3, 3 * k + c % 3)) : 0.0f);
    block_start.assign(start);
    const Stream<int> slices(b, std::vector<int>{0, width}), columns(b, column), places(b, order),
        none(b, std::vector<int>{0});
    const Stream<float> values(b, value), no_terms(b, std::vector<float>{0.0f});
    const Stream<kernels::element_nodes> no_nodes(b, 1);
    const Stream<double> no_values(b, std::vector<double>{0.0});
    CAMA_LAUNCH_TEAMS(float, b, factor_blocks, BLOCK_TEAM, 1, 0, 1, 1, block_start, slices, places, columns, values, 0,
                      places, none, none, no_nodes, no_terms, none, none, no_values, no_values, none, none, no_values,
                      no_values, factor, weight);
  }
  /// The same matrix as that of the nodes of a coarse level.
  void be_coarse(const MatrixXd &a)
  {
    std::vector<int> row, column;
    std::vector<double> value;
    for (int i = 0; i <= rows; ++i) row.push_back(rows * i);
    for (int i = 0; i < rows; ++i)
      for (int j = 0; j < rows; ++j) {
        column.push_back(j);
        for (int c = 0; c < 9; ++c) value.push_back(a(3 * i + c / 3, 3 * j + c % 3));
      }
    const Stream<int> rows_of(backend, row), columns(backend, column);
    const Stream<double> values(backend, value);
    CAMA_LAUNCH_TEAMS(float, backend, factor_blocks, BLOCK_TEAM, 1, 0, 0, 1, block_start, nothing<int>(),
                      nothing<int>(), nothing<int>(), nothing<float>(), 0, nothing<int>(), nothing<int>(),
                      nothing<int>(), nothing<kernels::element_nodes>(), nothing<float>(), rows_of, columns, values,
                      nothing<double>(), nothing<int>(), nothing<int>(), nothing<double>(), nothing<double>(), factor,
                      weight);
  }
  VectorXd apply(const VectorXd &r)
  {
    // Vertices are numbered backwards; the last entry is the block's node.
    std::vector<int> order;
    for (int i = rows - 1; i >= 0; --i) order.push_back(i);
    std::vector<float> in(static_cast<std::size_t>(3 * rows));
    for (int i = 0; i < 3 * rows; ++i)
      in[static_cast<std::size_t>(3 * order[i / 3] + i % 3)] = static_cast<float>(r[i]);
    const Stream<float> vertices(backend, in);
    Stream<kernels::f32::vec4> right(backend, rows + 1), z(backend, rows);
    Stream<double> scalar(backend, std::vector<double>(CG_COUNT, 1.0));
    const Stream<int> groups(backend, std::vector<int>{0, 1}), places(backend, order);
    CAMA_LAUNCH_TEAMS(float, backend, gather_block_residuals, CG_TEAM, 1, 2, rows, 1, groups, block_start, places, 1, 0,
                      nothing<double>(), nothing<double>(), vertices, nothing<float>(), right, scalar);
    REQUIRE(scalar.at(CG_DONE) == 0);
    CAMA_LAUNCH_TEAMS(float, backend, apply_blocks, APPLY_TEAM, 1, block_start, 0, scalar, factor, weight, right, z);
    const auto out = z.download(), all = right.download();
    coarse = {all.back().x, all.back().y, all.back().z};
    VectorXd result(r.size());
    for (int i = 0; i < rows; ++i) {
      const auto &v = out[static_cast<std::size_t>(i)];
      result.segment<3>(3 * i) = Eigen::Vector3d(v.x, v.y, v.z);
    }
    return result;
  }

  int rows;
  Backend &backend;
  Stream<int> block_start{backend}, factor{backend, FACTOR_WORDS};
  Stream<float> weight{backend, BLOCK_SIZE};
  std::vector<float> coarse;
};

/// Symmetric positive definite with eigenvalues from 1 / condition to 1, badly scaled.
MatrixXd random_matrix(int n, double condition, std::mt19937 &random)
{
  std::normal_distribution<double> normal;
  MatrixXd g(n, n);
  for (double &v : g.reshaped()) v = normal(random);
  const MatrixXd q = Eigen::HouseholderQR<MatrixXd>(g).householderQ();
  VectorXd eigenvalues(n), scale(n);
  for (int i = 0; i < n; ++i) {
    eigenvalues[i] = std::pow(condition, -i / double(n - 1));
    scale[i] = std::pow(10.0, 2 * std::sin(i));
  }
  return scale.asDiagonal() * (q * eigenvalues.asDiagonal() * q.transpose()) * scale.asDiagonal();
}

}  // namespace

TEST_CASE("aggregates: every free vertex is in one block of at most 16 connected vertices", "[schwarz]")
{
  for (const std::string &backend : backends_here()) {
    INFO(backend);
    StagedEngine engine = before_solve(12, backend);
    State &s = engine.state;
    Aggregates aggregates(*engine.backend);
    aggregates.build<double>(s, diagonal_of(engine));
    const auto order = aggregates.rows.order.download(), place = aggregates.rows.place.download(),
               fixed = s.mesh.fixed.download();
    const auto row = s.system.template of<double>().matrix.row.download(),
               column = s.system.template of<double>().matrix.column.download();
    const auto start = aggregates.level(0).start.download(), parent = aggregates.level(0).parent.download();
    const int free = static_cast<int>(std::count(fixed.begin(), fixed.begin() + s.mesh.cloth_vertices, 0));
    REQUIRE(aggregates.rows.size == free);
    REQUIRE(std::set<int>(order.begin(), order.end()).size() == static_cast<std::size_t>(free));
    for (int v = 0; v < s.mesh.cloth_vertices; ++v) {
      const int p = place[static_cast<std::size_t>(v)];
      REQUIRE((p < 0) == (fixed[static_cast<std::size_t>(v)] != 0));
      if (p >= 0) REQUIRE(order[static_cast<std::size_t>(p)] == v);
    }
    REQUIRE(start.front() == 0);
    REQUIRE(start.back() == free);
    const int blocks = aggregates.level(0).blocks;
    CHECK(free > 10 * blocks);   // well filled
    std::vector<std::set<int>> terms(static_cast<std::size_t>(s.mesh.cloth_vertices));
    for (const auto &t : s.system.template of<double>().term.download())
      for (int a : t.node)
        for (int b : t.node)
          if (a >= 0 && b >= 0 && a < s.mesh.cloth_vertices) terms[static_cast<std::size_t>(a)].insert(b);
    for (int t = 0; t < blocks; ++t) {
      const int first = start[static_cast<std::size_t>(t)], last = start[static_cast<std::size_t>(t) + 1];
      REQUIRE(last > first);
      REQUIRE(last - first <= BLOCK_ROWS);
      std::set<int> members(order.begin() + first, order.begin() + last), reached{*members.begin()};
      for (std::size_t before = 0; before != reached.size();) {
        before = reached.size();
        for (int v : std::set<int>(reached)) {
          for (int k = row[static_cast<std::size_t>(v)]; k < row[static_cast<std::size_t>(v) + 1]; ++k)
            if (members.count(column[static_cast<std::size_t>(k)])) reached.insert(column[static_cast<std::size_t>(k)]);
          for (int u : terms[static_cast<std::size_t>(v)])
            if (members.count(u)) reached.insert(u);
        }
      }
      CHECK(reached == members);
      for (int i = first; i < last; ++i) CHECK(parent[static_cast<std::size_t>(i)] == t);
    }
    for (int l = 1; l < aggregates.levels(); ++l) {
      const auto above = aggregates.level(l).start.download();
      CHECK(aggregates.level(l).nodes == aggregates.level(l - 1).blocks);
      CHECK(above.back() == aggregates.level(l).nodes);
      for (std::size_t t = 1; t < above.size(); ++t) CHECK(above[t] - above[t - 1] <= BLOCK_ROWS);
    }
  }
}

TEST_CASE("aggregates are the same on every backend", "[schwarz]")
{
  std::vector<int> first;
  for (const std::string &backend : backends_here()) {
    INFO(backend);
    StagedEngine engine = before_solve(12, backend);
    Aggregates aggregates(*engine.backend);
    aggregates.build<double>(engine.state, diagonal_of(engine));
    const auto order = aggregates.rows.order.download();
    if (first.empty()) first = order;
    CHECK(order == first);
  }
}

TEST_CASE("a block's factors in 16 bits give its inverse to their accuracy, symmetric and positive", "[schwarz]")
{
  for (const std::string &name : backends_here()) {
    INFO(name);
    const auto backend = make_backend(name);
    std::mt19937 random(3);
    std::normal_distribution<double> normal;
    for (int rows : {1, 2, 5, 11, 16})
      for (double condition : {1.0, 1e2, 1e4}) {
        INFO(rows << " rows, condition " << condition);
        const MatrixXd a = random_matrix(3 * rows, condition, random);
        Block block(*backend, a);
        VectorXd r(3 * rows), other(3 * rows);
        for (double &v : r) v = normal(random);
        for (double &v : other) v = normal(random);
        const VectorXd expected = a.llt().solve(r), z = block.apply(r);
        const double error = std::sqrt((z - expected).dot(a * (z - expected)) / expected.dot(r));
        INFO("error in the energy norm " << error);
        CHECK(error < 5e-3);
        CHECK(z.dot(r) > 0);
        const double forth = other.dot(block.apply(r)), back = r.dot(block.apply(other));
        CHECK(std::abs(forth - back) < 1e-4 * std::sqrt(z.dot(r) * other.dot(block.apply(other))));
        block.apply(r);
        for (int c = 0; c < 3; ++c) {
          double sum = 0;
          for (int i = c; i < r.size(); i += 3) sum += r[i];
          CHECK(std::abs(block.coarse[static_cast<std::size_t>(c)] - sum) < 1e-5 * rows);
        }
      }
  }
}

TEST_CASE("corrections of coarse levels are added by half", "[schwarz]")
{
  for (const std::string &name : backends_here()) {
    INFO(name);
    const auto backend = make_backend(name);
    std::mt19937 random(5);
    std::normal_distribution<double> normal;
    for (int rows : {1, 6, 16}) {
      INFO(rows << " nodes");
      const MatrixXd a = random_matrix(3 * rows, 1e2, random);
      Block block(*backend, a);
      block.be_coarse(a);
      VectorXd r(3 * rows);
      for (double &v : r) v = normal(random);
      const VectorXd expected = 0.5 * a.llt().solve(r), z = block.apply(r);
      CHECK(std::sqrt((z - expected).dot(a * (z - expected)) / expected.dot(r)) < 5e-3);
    }
  }
}

TEST_CASE("a block's factors stay positive where single precision has lost the matrix", "[schwarz]")
{
  const auto backend = make_backend("cpu", 0, 1);
  std::mt19937 random(4);
  std::normal_distribution<double> normal;
  for (double condition : {1e7, 1e10}) {
    Block block(*backend, random_matrix(48, condition, random));
    for (int k = 0; k < 200; ++k) {
      VectorXd r(48);
      for (double &v : r) v = normal(random);
      REQUIRE(block.apply(r).dot(r) > 0);
    }
  }
}

TEST_CASE("repeated work is work done as many times", "[backend]")
{
  for (const std::string &name : backends_here()) {
    INFO(name);
    const auto backend = make_backend(name);
    const Stream<int> next(*backend, std::vector<int>{1, 2, 3, 4, 0});
    Stream<int> here(*backend, std::vector<int>{10, 11, 12, 13, 14}), there(*backend, 5);
    for (int times : {0, 1, 7}) {   // each turns the ring by two
      backend->repeat(times, [&] {
        CAMA_LAUNCH(*backend, take_items, 5, next, here, there);
        CAMA_LAUNCH(*backend, take_items, 5, next, there, here);
      });
    }
    CHECK(here.download() == std::vector<int>{11, 12, 13, 14, 10});
  }
}
