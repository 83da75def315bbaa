// SPDX-License-Identifier: Apache-2.0
// Algorithm 1 (gathered and atomic filling), collect-sort-reduce, and the elastic pattern with terms as an operator,
// all against a dense matrix that this file computes from the elements with Eigen.
#include "../catch.hpp"

#include <algorithm>
#include <memory>
#include <random>

#include <Eigen/Dense>

#include "../meshes.hpp"
#include "device/launch.hpp"
#include "model/topology.hpp"
#include "stages/linear_solve.hpp"
#include "stages/matrix_assembly.hpp"

using namespace cama;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

namespace {

/// Elements with random factors.
template <class Real> struct Elements {
  using T = Types<Real>;
  int rows = 0, outside = 0;                  // rows: vertices of the matrix; outside: further ones (obstacles)
  std::vector<Real> mass;
  std::vector<kernels::element_nodes> triangle_nodes, hinge_nodes;
  std::vector<typename T::triangle_factor> triangle;
  std::vector<typename T::hinge_factor> hinge;
  std::vector<kernels::contact> contact;      // one for each contact term
  std::vector<typename T::term> term;         // contacts, then stitches
};

template <class Real> class Maker {
public:
  using T = Types<Real>;
  explicit Maker(unsigned seed) : random_(seed) {}

  Elements<Real> from_mesh(const Mesh &mesh, int isolated, int outside)
  {
    Scene scene;
    scene.cloths.push_back(meshes::cloth(mesh));
    const Topology topology = build_topology(scene);
    Elements<Real> e;
    e.rows = topology.cloth_vertices + isolated;
    e.outside = outside;
    for (int i = 0; i < e.rows; ++i) e.mass.push_back(static_cast<Real>(1e-3 + 1e-3 * std::abs(number())));
    for (const RestTriangle &t : topology.triangle) {
      e.triangle_nodes.push_back({{t.node[0], t.node[1], t.node[2], -1}});
      e.triangle.push_back(triangle());
    }
    for (const RestHinge &h : topology.hinge) {
      e.hinge_nodes.push_back({{h.node[0], h.node[1], h.node[2], h.node[3]}});
      e.hinge.push_back(hinge());
    }
    return e;
  }
  /// Contacts between random vertices, some of them outside the matrix; `friction`: with a part around I.
  void add_contacts(Elements<Real> &e, int count, bool friction)
  {
    for (int i = 0; i < count; ++i) {
      const std::array<int, 4> node = distinct(e.rows + e.outside);
      const double s = fraction(), t = fraction(), u = fraction() * (1 - t);
      kernels::contact c{};
      c.kind = i % 2;
      const double vertex_face[4] = {1, -(1 - t - u), -t, -u}, edge_edge[4] = {1 - s, s, -(1 - t), -t};
      typename T::term term{};
      for (int k = 0; k < 4; ++k) {
        term.node[k] = c.node[k] = node[static_cast<std::size_t>(k)];
        term.weight[k] = static_cast<Real>(c.weight[k] = c.kind ? edge_edge[k] : vertex_face[k]);
      }
      term.normal = unit();
      term.along = std::abs(number());
      term.around = friction ? std::abs(number()) : Real(0);
      term.push = number();
      e.contact.push_back(c);
      e.term.push_back(term);
    }
  }
  void add_stitches(Elements<Real> &e, int count)
  {
    for (int i = 0; i < count; ++i) {
      const std::array<int, 4> node = distinct(e.rows);
      const double ratio = i % 3 == 0 ? 0 : fraction();
      typename T::term term{};
      for (int k = 0; k < 3; ++k) term.node[k] = node[static_cast<std::size_t>(k)];
      if (i % 3 == 0) term.node[2] = term.node[1];   // a vertex stitched to a vertex
      term.node[3] = -1;
      term.weight[0] = 1;
      term.weight[1] = -static_cast<Real>(1 - ratio);
      term.weight[2] = -static_cast<Real>(ratio);
      term.normal = unit();
      term.around = std::abs(number());
      e.term.push_back(term);
    }
  }
  typename T::vec3 vector() { return {number(), number(), number()}; }
  Real number() { return static_cast<Real>(normal_(random_)); }

private:
  double fraction() { return std::uniform_real_distribution<double>(0, 1)(random_); }
  typename T::vec3 unit()
  {
    typename T::vec3 v = vector();
    const Real length = std::sqrt(v.x * v.x + v.y * v.y + v.z * v.z);
    return {v.x / length, v.y / length, v.z / length};
  }
  std::array<int, 4> distinct(int below)
  {
    std::array<int, 4> node{};
    for (int k = 0; k < 4;) {
      node[static_cast<std::size_t>(k)] = static_cast<int>(random_() % static_cast<unsigned>(below));
      if (std::find(node.begin(), node.begin() + k, node[static_cast<std::size_t>(k)]) == node.begin() + k) ++k;
    }
    return node;
  }
  typename T::triangle_factor triangle()
  {
    typename T::triangle_factor f;
    f.u = vector();
    f.w = vector();
    for (Real &d : f.d) d = number();
    for (Real &k : f.k) k = std::abs(number());
    f.e0 = std::abs(number());
    f.e1 = std::abs(number());
    return f;
  }
  typename T::hinge_factor hinge()
  {
    typename T::hinge_factor f;
    Real last[3] = {0, 0, 0};
    for (int k = 0; k < 3; ++k) {   // gradients of quantities that translation does not change add up to zero
      f.gradient[k] = vector();
      last[0] -= f.gradient[k].x;
      last[1] -= f.gradient[k].y;
      last[2] -= f.gradient[k].z;
    }
    f.gradient[3] = {last[0], last[1], last[2]};
    f.coefficient = std::abs(number());
    return f;
  }

  std::mt19937 random_;
  std::normal_distribution<double> normal_;
};

template <class V> Vector3d eigen(const V &v)
{
  return {static_cast<double>(v.x), static_cast<double>(v.y), static_cast<double>(v.z)};
}

/// Adds an element's matrix: rows of the cloth, columns of all vertices (moving obstacles act on the cloth).
void scatter(MatrixXd &matrix, const int *node, int nodes, int rows, const MatrixXd &local)
{
  for (int a = 0; a < nodes; ++a)
    for (int b = 0; b < nodes; ++b)
      if (node[a] >= 0 && node[a] < rows && node[b] >= 0)
        matrix.block<3, 3>(3 * node[a], 3 * node[b]) += local.block<3, 3>(3 * a, 3 * b);
}

/// Hessian of k0 E11^2/2 + k1 E11 E22 + k2 E22^2/2 + k3 E12^2 from the gradients of the strains.
template <class F> MatrixXd triangle_matrix(const F &f)
{
  VectorXd e11(9), e22(9), e12(9), warp(3), weft(3);
  warp << -(f.d[0] + f.d[2]), f.d[0], f.d[2];
  weft << -(f.d[1] + f.d[3]), f.d[1], f.d[3];
  for (int a = 0; a < 3; ++a) {
    e11.segment<3>(3 * a) = warp[a] * eigen(f.u);
    e22.segment<3>(3 * a) = weft[a] * eigen(f.w);
    e12.segment<3>(3 * a) = 0.5 * (weft[a] * eigen(f.u) + warp[a] * eigen(f.w));
  }
  MatrixXd m = f.k[0] * e11 * e11.transpose() + f.k[1] * (e11 * e22.transpose() + e22 * e11.transpose()) +
               f.k[2] * e22 * e22.transpose() + 2 * f.k[3] * e12 * e12.transpose();
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 3; ++b)
      m.block<3, 3>(3 * a, 3 * b) += (f.e0 * warp[a] * warp[b] + f.e1 * weft[a] * weft[b]) * Matrix3d::Identity();
  return m;
}

template <class F> MatrixXd hinge_matrix(const F &f)
{
  VectorXd g(12);
  for (int a = 0; a < 4; ++a) g.segment<3>(3 * a) = eigen(f.gradient[a]);
  return f.coefficient * g * g.transpose();
}

/// Rank one: (W' x)' M (W' x) with W of the weights. Star: a spring w_a w_b M from every node a of one side to every b
/// of the other.
template <class F> MatrixXd term_matrix(const F &t, ContactForm form)
{
  const Matrix3d m = t.along * eigen(t.normal) * eigen(t.normal).transpose() + t.around * Matrix3d::Identity();
  MatrixXd sum = MatrixXd::Zero(12, 12), w = MatrixXd::Zero(12, 3);
  for (int a = 0; a < 4; ++a) w.block<3, 3>(3 * a, 0) = t.weight[a] * Matrix3d::Identity();
  if (form == ContactForm::rank_one) return w * m * w.transpose();
  for (int a = 0; a < 4; ++a)
    for (int b = 0; b < 4; ++b)
      if (t.weight[a] > 0 && t.weight[b] < 0) {
        MatrixXd difference = MatrixXd::Zero(12, 3);
        difference.block<3, 3>(3 * a, 0) = Matrix3d::Identity();
        difference.block<3, 3>(3 * b, 0) = -Matrix3d::Identity();
        sum += -static_cast<double>(t.weight[a]) * t.weight[b] * difference * m * difference.transpose();
      }
  return sum;
}

template <class Real> MatrixXd dense(const Elements<Real> &e, ContactForm form, bool with_terms = true)
{
  MatrixXd m = MatrixXd::Zero(3 * e.rows, 3 * (e.rows + e.outside));
  for (int i = 0; i < e.rows; ++i)
    m.block<3, 3>(3 * i, 3 * i) = e.mass[static_cast<std::size_t>(i)] * Matrix3d::Identity();
  for (std::size_t i = 0; i < e.triangle.size(); ++i)
    scatter(m, e.triangle_nodes[i].node, 3, e.rows, triangle_matrix(e.triangle[i]));
  for (std::size_t i = 0; i < e.hinge.size(); ++i)
    scatter(m, e.hinge_nodes[i].node, 4, e.rows, hinge_matrix(e.hinge[i]));
  if (with_terms)
    for (const auto &t : e.term) scatter(m, t.node, 4, e.rows, term_matrix(t, form));
  return m;
}

/// A state that holds the elements, ready for AssembleMatrix.
template <class Real> std::unique_ptr<State> fill(Backend &b, const Elements<Real> &e)
{
  auto state = std::make_unique<State>(b);
  State &s = *state;
  System<Real> *y;
  if constexpr (sizeof(Real) == 8)
    y = (s.system.f64 = std::make_unique<System<double>>()).get();
  else
    y = (s.system.f32 = std::make_unique<System<float>>()).get();
  const auto size = [](const auto &v) { return static_cast<int>(v.size()); };
  s.mesh.cloth_vertices = e.rows;
  s.mesh.vertices = e.rows + e.outside;
  s.mesh.triangles = size(e.triangle);
  s.mesh.hinges = size(e.hinge);
  s.contact.contacts = size(e.contact);
  s.system.terms = size(e.term);
  s.elements.stitches = s.system.terms - s.contact.contacts;
  s.mesh.fixed = Stream<int>(b, std::vector<int>(static_cast<std::size_t>(s.mesh.vertices), 0));
  y->mass = Stream<Real>(b, e.mass);
  y->triangle_factor = {b, e.triangle};
  y->hinge_factor = {b, e.hinge};
  y->term = {b, e.term};
  y->matrix = {Stream<int>(b), Stream<int>(b), Stream<typename Types<Real>::mat3>(b)};
  s.contact.contact = {b, e.contact};
  std::vector<kernels::element_nodes> term_nodes;
  for (const auto &t : e.term) term_nodes.push_back({{t.node[0], t.node[1], t.node[2], t.node[3]}});
  s.elements.triangle_nodes = {b, e.triangle_nodes};
  s.elements.hinge_nodes = {b, e.hinge_nodes};
  s.system.term_nodes = {b, term_nodes};
  s.system.term_split = Stream<int>(b);
  Stream<int> count(b, e.rows);
  const auto incidence = [&](Incidence &lists, const Stream<kernels::element_nodes> &nodes) {
    lists.reset(b, e.rows);
    lists.build(b, nodes, nodes.size(), count);
  };
  incidence(s.elements.triangle_incidence, s.elements.triangle_nodes);
  incidence(s.elements.hinge_incidence, s.elements.hinge_nodes);
  incidence(s.system.term_incidence, s.system.term_nodes);
  return state;
}

/// The assembled matrix, dense; checks the structure: sorted columns without duplicates, in range, a diagonal in each
/// row.
template <class Real> MatrixXd download(State &state)
{
  BlockMatrix<Real> &m = state.system.template of<Real>().matrix;
  const std::vector<int> row = m.row.download(), column = m.column.download();
  const auto block = m.block.download();
  const int rows = state.mesh.cloth_vertices;
  MatrixXd dense = MatrixXd::Zero(3 * rows, 3 * state.mesh.vertices);
  REQUIRE(static_cast<int>(row.size()) == rows + 1);
  REQUIRE(row[0] == 0);
  REQUIRE(row[static_cast<std::size_t>(rows)] == static_cast<int>(column.size()));
  REQUIRE(block.size() == column.size());
  for (int i = 0; i < rows; ++i) {
    INFO("row " << i);
    bool strictly_rising = true, diagonal = false;
    for (int k = row[static_cast<std::size_t>(i)]; k < row[static_cast<std::size_t>(i) + 1]; ++k) {
      const std::size_t p = static_cast<std::size_t>(k);
      strictly_rising &= k == row[static_cast<std::size_t>(i)] || column[p] > column[p - 1];
      diagonal |= column[p] == i;
      REQUIRE(column[p] >= 0);
      REQUIRE(column[p] < state.mesh.vertices);
      for (int a = 0; a < 3; ++a) dense.block<1, 3>(3 * i + a, 3 * column[p]) = eigen(block[p].row[a]).transpose();
    }
    REQUIRE(strictly_rising);
    REQUIRE(diagonal);
  }
  return dense;
}

double difference(const MatrixXd &a, const MatrixXd &b)
{
  return (a - b).cwiseAbs().maxCoeff() / std::max(1e-300, b.cwiseAbs().maxCoeff());
}

struct Way {
  const char *name;
  Assembly assembly;
  bool atomic;
};
const Way ways[] = {{"algorithm 1, gathered", Assembly::algorithm1, false},
                    {"algorithm 1, atomic", Assembly::algorithm1, true},
                    {"collect, sort, reduce", Assembly::sorted, false}};

template <class Real> void check(const Elements<Real> &e, double tolerance, int threads = 1)
{
  const auto backend = make_backend("auto", 0, threads);
  for (ContactForm form : {ContactForm::rank_one, ContactForm::star}) {
    const MatrixXd expected = dense(e, form);
    for (const Way &way : ways) {
      INFO(way.name << (form == ContactForm::star ? ", star" : ", rank one"));
      const auto state = fill(*backend, e);
      state->options.paper.assembly = way.assembly;
      state->options.paper.atomic_filling = way.atomic;
      state->options.paper.contact_form = form;
      AssembleMatrix<Real> stage(*backend);
      stage.run(*state);
      const MatrixXd got = download<Real>(*state);
      REQUIRE(difference(got, expected) < tolerance);
      const MatrixXd square = got.leftCols(3 * e.rows);
      REQUIRE(difference(square, square.transpose()) < tolerance);
      stage.run(*state);   // on the same streams, now of the right size
      REQUIRE(difference(download<Real>(*state), expected) < tolerance);
    }
  }
  // The default path: elastic pattern, terms as an operator.
  const auto state = fill(*backend, e);
  AssembleMatrix<Real> stage(*backend);
  LinearSolve<Real> solve(*backend);
  Maker<Real> maker(99);
  for (int repeat = 0; repeat < 2; ++repeat) {   // the second run reuses the pattern
    stage.run(*state);
    REQUIRE(difference(download<Real>(*state), dense(e, ContactForm::rank_one, false)) < tolerance);
    std::vector<typename Types<Real>::vec3> x(static_cast<std::size_t>(state->mesh.vertices));
    VectorXd dense_x(3 * state->mesh.vertices), product(3 * e.rows);
    for (int i = 0; i < state->mesh.vertices; ++i)
      dense_x.segment<3>(3 * i) = eigen(x[static_cast<std::size_t>(i)] = maker.vector());
    Stream<typename Types<Real>::vec3> in(*backend, x), out(*backend, e.rows);
    solve.multiply(*state, in, out);
    const auto y = out.download();
    for (int i = 0; i < e.rows; ++i) product.segment<3>(3 * i) = eigen(y[static_cast<std::size_t>(i)]);
    REQUIRE(difference(product, dense(e, ContactForm::rank_one) * dense_x) < tolerance);
  }
}

constexpr double exact = 1e-12, single = 3e-5;

}  // namespace

TEST_CASE("assembly of a sheet with contacts, friction and stitches equals the dense matrix", "[assembly]")
{
  Maker<double> maker(1);
  Elements<double> e = maker.from_mesh(meshes::grid(5, 4, 1, 1), 0, 6);
  maker.add_contacts(e, 60, true);
  maker.add_stitches(e, 12);
  for (int threads : {1, 4}) check(e, exact, threads);
}

TEST_CASE("assembly in single precision", "[assembly]")
{
  Maker<float> maker(2);
  Elements<float> e = maker.from_mesh(meshes::grid(4, 4, 1, 1), 1, 4);
  maker.add_contacts(e, 40, true);
  maker.add_stitches(e, 6);
  check(e, single);
}

TEST_CASE("assembly of elements alone, of terms alone, of nothing", "[assembly]")
{
  Maker<double> maker(3);
  check(maker.from_mesh(meshes::grid(3, 3, 1, 1), 0, 0), exact);
  Elements<double> terms;
  terms.rows = 9;
  terms.outside = 3;
  terms.mass.assign(9, 0.5);
  check(terms, exact);
  maker.add_contacts(terms, 15, false);
  check(terms, exact);
  Elements<double> stitched;
  stitched.rows = 5;
  stitched.mass.assign(5, 0.1);
  maker.add_stitches(stitched, 9);
  check(stitched, exact);
}

TEST_CASE("assembly of a non-manifold book, and of vertices that no element touches", "[assembly]")
{
  Maker<double> maker(4);
  for (int pages : {3, 5, 9}) {
    Elements<double> e = maker.from_mesh(meshes::book(pages, 1), 4, 2);
    REQUIRE(static_cast<int>(e.hinge.size()) == pages - 1);
    maker.add_contacts(e, pages, true);
    check(e, exact);
  }
}

TEST_CASE("assembly with long rows and a single row", "[assembly]")
{
  Maker<double> maker(5);
  Elements<double> e = maker.from_mesh(meshes::sphere(40, 3, 1), 0, 4);   // the poles have 40 neighbours
  maker.add_contacts(e, 400, true);                                       // every row gets many duplicates
  check(e, exact);
  Elements<double> one;
  one.rows = 1;
  one.outside = 8;
  one.mass = {2.0};
  maker.add_contacts(one, 20, true);   // most nodes are outside the matrix
  check(one, exact);
}

TEST_CASE("every way of assembly survives a growing and shrinking list of terms", "[assembly]")
{
  const auto backend = make_backend("auto", 0, 1);
  for (const Way &way : ways) {
    INFO(way.name);
    AssembleMatrix<double> stage(*backend);
    for (int contacts : {1, 50, 0, 200, 3}) {
      Maker<double> maker(6);
      Elements<double> e = maker.from_mesh(meshes::grid(3, 3, 1, 1), 0, 5);
      maker.add_contacts(e, contacts, true);
      const auto state = fill(*backend, e);
      state->options.paper.assembly = way.assembly;
      state->options.paper.atomic_filling = way.atomic;
      stage.run(*state);
      REQUIRE(difference(download<double>(*state), dense(e, ContactForm::rank_one)) < exact);
    }
  }
}

TEST_CASE("Algorithm 1 has the bits of the static pattern where there are no terms", "[assembly]")
{
  const auto backend = make_backend("auto", 0, 2);
  Maker<double> maker(8);
  const Elements<double> e = maker.from_mesh(meshes::grid(7, 6, 1, 1), 0, 3);
  std::vector<double> bits[2];
  for (Assembly assembly : {Assembly::gather, Assembly::algorithm1}) {
    const auto state = fill(*backend, e);
    state->options.paper.assembly = assembly;
    AssembleMatrix<double> stage(*backend);
    stage.run(*state);
    for (const auto &block : state->system.template of<double>().matrix.block.download())
      for (const auto &row : block.row)
        bits[assembly == Assembly::gather].insert(bits[assembly == Assembly::gather].end(), {row.x, row.y, row.z});
  }
  REQUIRE(bits[0].size() > 0);
  REQUIRE(bits[0] == bits[1]);
}

TEST_CASE("more elements than sources have numbers are refused", "[assembly]")
{
  const auto backend = make_backend("auto", 0, 1);
  Maker<double> maker(9);
  const auto state = fill(*backend, maker.from_mesh(meshes::grid(3, 3, 1, 1), 0, 0));
  state->options.paper.assembly = Assembly::algorithm1;
  state->system.terms = 1 << 27;
  AssembleMatrix<double> stage(*backend);
  CHECK_THROWS_AS(stage.run(*state), MemoryError);
}

TEST_CASE("the star form's entries join opposite sides only", "[assembly]")
{
  Maker<double> maker(7);
  Elements<double> e;
  e.rows = 8;
  e.mass.assign(8, 1.0);
  maker.add_contacts(e, 1, false);   // vertex-face
  const auto backend = make_backend("auto", 0, 1);
  for (Assembly assembly : {Assembly::algorithm1, Assembly::sorted}) {
    const auto blocks = [&](ContactForm form) {
      const auto state = fill(*backend, e);
      state->options.paper.assembly = assembly;
      state->options.paper.contact_form = form;
      AssembleMatrix<double>(*backend).run(*state);
      return state->system.template of<double>().matrix.column.size();
    };
    CHECK(blocks(ContactForm::rank_one) == 8 + 12);
    CHECK(blocks(ContactForm::star) == 8 + 6);
  }
}
