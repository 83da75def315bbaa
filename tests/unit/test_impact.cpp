// SPDX-License-Identifier: Apache-2.0
// Inelastic projection of impacts against dense solutions: projected Gauss-Seidel run to convergence for impulses that
// only push; rigid motions of Eigen for rigid zones; and the mechanics of one impact.
#include "../catch.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>
#include <random>

#include <Eigen/Dense>

#include "cama/geometry.hpp"
#include "device/launch.hpp"
#include "stages/penetration_handling.hpp"
#include "stages/rigid_zones.hpp"

using namespace cama;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using kernels::impact;

namespace {

Vector3d eigen(const dvec3 &v) { return {v.x, v.y, v.z}; }

struct Problem {
  int cloth = 0;                       // cloth vertices; those behind them do not move
  std::vector<dvec3> position;
  std::vector<double> inverse_mass;
  std::vector<impact> impacts;

  VectorXd stacked() const
  {
    VectorXd x(3 * position.size());
    for (std::size_t i = 0; i < position.size(); ++i) x.segment<3>(3 * static_cast<int>(i)) = eigen(position[i]);
    return x;
  }
  MatrixXd jacobian() const
  {
    MatrixXd j = MatrixXd::Zero(static_cast<int>(impacts.size()), 3 * static_cast<int>(position.size()));
    for (std::size_t i = 0; i < impacts.size(); ++i)
      for (int k = 0; k < 4; ++k)
        j.block<1, 3>(static_cast<int>(i), 3 * impacts[i].node[k]) +=
            impacts[i].weight[k] * eigen(impacts[i].normal).transpose();
    return j;
  }
  VectorXd mobility() const
  {
    VectorXd m(3 * position.size());
    for (std::size_t i = 0; i < position.size(); ++i)
      m.segment<3>(3 * static_cast<int>(i)).setConstant(inverse_mass[i]);
    return m;
  }
};

constexpr double strict = 1e-3, usual = 1e-2;  // relative changes of impulses that end the projection

/// Displacements that the stage computes, all vertices.
VectorXd project(const Problem &p, double target, bool zones, int threads = 1, double tolerance = strict)
{
  const auto backend = make_backend("auto", 0, threads);
  State state(*backend);
  state.mesh.cloth_vertices = p.cloth;
  state.mesh.vertices = static_cast<int>(p.position.size());
  state.options.paper.impact_zones = zones;
  state.mesh.inverse_mass = {*backend, p.inverse_mass};
  std::vector<impact> impacts = p.impacts;
  for (impact &m : impacts) m.target = target;
  state.contact.impact = {*backend, impacts};
  Stream<dvec3> positions(*backend, p.position);
  const std::vector<dvec3> far(p.position.size(), dvec3{1e6, 0, 0});
  ImpactProjection stage(*backend, tolerance);
  stage.start(state, Stream<dvec3>(*backend, far), positions);   // motions so long that no push is limited
  stage.run(state, positions);
  VectorXd moved = -p.stacked();
  const std::vector<dvec3> after = positions.download();
  for (std::size_t i = 0; i < after.size(); ++i) moved.segment<3>(3 * static_cast<int>(i)) += eigen(after[i]);
  return moved;
}

/// min |dx|_M^2 / 2 with J (x + dx) >= target, by projected Gauss-Seidel on the dual until nothing changes.
VectorXd quadratic_program(const Problem &p, double target)
{
  const MatrixXd j = p.jacobian(), w = p.mobility().asDiagonal() * j.transpose(), s = j * w;
  const VectorXd c = VectorXd::Constant(j.rows(), target) - j * p.stacked();
  VectorXd lambda = VectorXd::Zero(j.rows());
  double change = 1;
  for (int sweep = 0; sweep < 200000 && change > 1e-15; ++sweep) {
    change = 0;
    for (int i = 0; i < j.rows(); ++i) {
      if (s(i, i) == 0) continue;
      const double next = std::max(0.0, lambda[i] + (c[i] - s.row(i).dot(lambda)) / s(i, i));
      change = std::max(change, std::abs(next - lambda[i]) / (1e-300 + lambda.cwiseAbs().maxCoeff()));
      lambda[i] = next;
    }
  }
  // KKT: no impulse pulls, no constraint is violated, and those that push are tight.
  const VectorXd slack = s * lambda - c;
  for (int i = 0; i < j.rows(); ++i) {
    if (s(i, i) == 0) continue;
    REQUIRE(slack[i] > -1e-9);
    REQUIRE(std::abs(slack[i] * lambda[i]) < 1e-9);
  }
  return w * lambda;
}

/// Cost of a displacement, sum m |dx|^2.
double cost(const Problem &p, const VectorXd &dx)
{
  double sum = 0;
  for (std::size_t i = 0; i < p.position.size(); ++i)
    if (p.inverse_mass[i] > 0) sum += dx.segment<3>(3 * static_cast<int>(i)).squaredNorm() / p.inverse_mass[i];
  return std::sqrt(sum);
}

class Maker {
public:
  explicit Maker(unsigned seed) : random_(seed) {}
  double normal() { return normal_(random_); }
  double fraction() { return std::uniform_real_distribution<double>(0, 1)(random_); }
  dvec3 vector() { return {normal(), normal(), normal()}; }

  /// Vertices of uneven mass, the last two of which do not move; a fifth of the cloth is pinned.
  Problem vertices(int cloth)
  {
    Problem p;
    p.cloth = cloth;
    for (int i = 0; i < cloth + 2; ++i) {
      p.position.push_back(vector());
      p.inverse_mass.push_back(i >= cloth || i % 5 == 4 ? 0.0 : std::exp(normal()));
    }
    return p;
  }
  /// apart: no vertex is in two impacts.
  void add(Problem &p, int count, bool apart)
  {
    const int n = static_cast<int>(p.position.size());
    for (int i = 0; i < count; ++i) {
      impact m{};
      for (int k = 0; k < 4;) {
        m.node[k] = apart ? 4 * i + k : static_cast<int>(random_() % static_cast<unsigned>(n));
        if (std::find(m.node, m.node + k, m.node[k]) == m.node + k) ++k;
      }
      const double s = fraction(), t = fraction() * (1 - s);
      m.kind = i % 2;
      if (m.kind == 0) {
        m.weight[0] = 1;
        m.weight[1] = s + t - 1;
        m.weight[2] = -s;
        m.weight[3] = -t;
      } else {
        const double u = fraction();
        m.weight[0] = 1 - s;
        m.weight[1] = s;
        m.weight[2] = u - 1;
        m.weight[3] = -u;
      }
      m.normal = kernels::dnormalize(vector());
      p.impacts.push_back(m);
    }
  }

private:
  std::mt19937 random_;
  std::normal_distribution<double> normal_;
};

/// The vertex-face (0) or edge-edge (1) impact on the way x -> y, if there is one: weights and normal at its time.
std::vector<impact> find(const std::vector<dvec3> &x, const std::vector<dvec3> &y, int kind, double minimum)
{
  std::vector<impact> found;
  const std::array<dvec3, 4> start{x[0], x[1], x[2], x[3]}, end{y[0], y[1], y[2], y[3]};
  const Ccd ccd = kind == 0 ? vertex_face_ccd(start, end, minimum) : edge_edge_ccd(start, end, minimum);
  if (!ccd.hit) return found;
  impact m{};
  std::array<dvec3, 4> at;
  for (std::size_t k = 0; k < 4; ++k) at[k] = kernels::dlerp(x[k], y[k], ccd.time);
  const kernels::proximity p = kind == 0 ? kernels::vertex_face_proximity(at[0], at[1], at[2], at[3])
                                         : kernels::edge_edge_proximity(at[0], at[1], at[2], at[3]);
  for (int k = 0; k < 4; ++k) {
    m.node[k] = k;
    m.weight[k] = p.weight[k];
  }
  m.kind = kind;
  m.normal = p.normal;
  found.push_back(m);
  return found;
}

impact between(int a, int b, dvec3 normal)
{
  impact m{};
  m.node[0] = a;
  m.node[1] = b;
  m.node[2] = 2;
  m.node[3] = 3;
  m.weight[0] = 1;
  m.weight[1] = -1;
  m.normal = normal;
  return m;
}

}  // namespace

TEST_CASE("impulses that only push equal the quadratic program on small random systems", "[impact]")
{
  double worst = 0;
  for (unsigned seed = 0; seed < 60; ++seed) {
    Maker maker(seed);
    Problem p = maker.vertices(10 + static_cast<int>(seed % 20));
    maker.add(p, 2 + static_cast<int>(seed % 9), false);
    for (const bool zones : {false, true}) {   // zones: no approach over a motion, here that from a common point
      const VectorXd expected = quadratic_program(p, zones ? 0 : 0.05), got = project(p, 0.05, zones);
      const double error = cost(p, got - expected) / std::max(1e-12, cost(p, expected));
      INFO("seed " << seed << (zones ? ", zones" : ""));
      CHECK(error < 0.01);  // ten times the tolerance
      worst = std::max(worst, error);
      if (!zones)
        CHECK(cost(p, project(p, 0.05, zones, 1, usual) - expected) < 0.1 * std::max(1e-12, cost(p, expected)));
    }
  }
  INFO("largest relative error " << worst);
  CHECK(worst > 0);
}

TEST_CASE("one impact more than a team takes, which does not push, changes no bit of the others", "[impact]")
{
  Maker maker(70);
  Problem p = maker.vertices(1500);
  maker.add(p, PUSH_IMPACTS, false);
  for (impact &m : p.impacts)  // in front of the two vertices that do not move, four that nothing else touches
    for (int &v : m.node) v += v >= p.cloth ? 4 : 0;
  for (int k = 0; k < 4; ++k) {
    p.position.insert(p.position.begin() + p.cloth + k, dvec3{k == 0 ? 100.0 : 0.0, 0, 0});
    p.inverse_mass.insert(p.inverse_mass.begin() + p.cloth + k, 1.0);
  }
  p.cloth += 4;
  impact apart{};
  for (int k = 0; k < 4; ++k) apart.node[k] = p.cloth - 4 + k;
  apart.weight[0] = 1;
  apart.weight[1] = -1;
  apart.normal = {1, 0, 0};
  const VectorXd few = project(p, 0.01, false);
  REQUIRE(few.norm() > 0.1);
  p.impacts.push_back(apart);
  CHECK((few.array() == project(p, 0.01, false).array()).all());
  // What many impacts end at is no farther from the least motion than few.
  Problem q = maker.vertices(24);
  maker.add(q, 8, false);
  const VectorXd expected = quadratic_program(q, 0.05);
  const std::size_t own = q.impacts.size();
  for (int i = 0; i < PUSH_IMPACTS; ++i) q.impacts.push_back(q.impacts[static_cast<std::size_t>(i) % own]);
  const VectorXd got = project(q, 0.05, false);
  CHECK(cost(q, got - expected) < 0.01 * cost(q, expected));
}

TEST_CASE("teams that spread impulses add every row in order, however long", "[impact]")
{
  // 700 impacts at vertex 0, whose row takes more than two teams, and in all at 40 vertices of cloth; 40 and 41 are
  // none.
  constexpr int rows = 40, n = 700;
  std::mt19937 random(3);
  std::uniform_real_distribution<double> number(-1, 1);
  std::uniform_int_distribution<int> other(1, 41);
  std::vector<impact> impacts;
  std::vector<kernels::impulse> impulses;
  for (int i = 0; i < n; ++i) {
    impact m{};
    m.node[i % 4] = 0;
    for (int k = 0; k < 4; ++k)
      while (k != i % 4 && m.node[k] == 0) m.node[k] = other(random);
    for (double &w : m.weight) w = number(random);
    m.normal = {number(random), number(random), number(random)};
    impacts.push_back(m);
    impulses.push_back({number(random), number(random)});
  }
  std::vector<std::vector<int>> entries(rows);
  for (int i = 0; i < n; ++i)
    for (int k = 0; k < 4; ++k)
      if (impacts[std::size_t(i)].node[k] < rows)
        entries[std::size_t(impacts[std::size_t(i)].node[k])].push_back(4 * i + k);
  std::vector<int> row = {0}, incidence;
  std::vector<double> inverse_mass;
  for (const auto &list : entries) {
    incidence.insert(incidence.end(), list.begin(), list.end());
    row.push_back(int(incidence.size()));
    inverse_mass.push_back(2 + number(random));
  }
  std::vector<kernels::row_head> head(4 * n);
  std::vector<kernels::impact_share> share(4 * n);
  list_shares(4 * n, rows, impacts.data(), row.data(), incidence.data(), head.data(), share.data());
  double scalar[2 * PUSH_COUNT] = {};
  const double momentum = scalar[PUSH_COUNT + PUSH_MOMENTUM] = 0.3;
  std::vector<dvec3> y(rows, dvec3{7, 7, 7});
  spread_extrapolated((4 * n - 1) / PUSH_TEAM + 1, 0, nullptr, 0, PUSH_COUNT, scalar, rows, row.data(),
                      incidence.data(), head.data(), share.data(), inverse_mass.data(), impulses.data(), y.data());
  for (std::size_t v = 0; v < rows; ++v) {
    dvec3 sum{0, 0, 0};
    for (const int e : entries[v]) {
      const impact &m = impacts[std::size_t(e / 4)];
      const kernels::impulse &p = impulses[std::size_t(e / 4)];
      const double given = m.weight[e % 4] * (p.lambda + momentum * p.change);
      sum = {sum.x + given * m.normal.x, sum.y + given * m.normal.y, sum.z + given * m.normal.z};
    }
    CAPTURE(v, entries[v].size());
    CHECK(y[v].x == inverse_mass[v] * sum.x);
    CHECK(y[v].y == inverse_mass[v] * sum.y);
    CHECK(y[v].z == inverse_mass[v] * sum.z);
  }
}

TEST_CASE("keys of pairs order them by kind and features", "[impact]")
{
  const std::vector<kernels::pair> faces = {{3, 1}, {0, 7}, {5, 5}}, edges = {{1, 2}, {0, 9}};
  const std::vector<int> code = {1, kernels::pair_code(1, 0), 2, kernels::pair_code(1, 1)};
  std::vector<key64> key(4);
  std::vector<int> index(4);
  coded_pairs(4, 31, 31, faces.data(), edges.data(), code.data(), key.data(), index.data());
  CHECK(index == code);
  const std::vector<key64> expected{7, key64(1) << 62 | key64(1) << 31 | 2, key64(5) << 31 | 5, key64(1) << 62 | 9};
  CHECK(key == expected);
  // With few bits the order is the same, and wide keys follow from these.
  std::vector<key64> narrow(4), wide(4);
  coded_pairs(4, 3, 4, faces.data(), edges.data(), code.data(), narrow.data(), index.data());
  CHECK(narrow[1] == ((key64(1) << 7) | (key64(1) << 4) | key64(2)));
  kernels::widen_keys(4, 3, 4, narrow.data(), wide.data());
  CHECK(wide == key);
}

TEST_CASE("impacts do not depend on how pairs are shared out, and decided pairs are left out", "[impact]")
{
  // Vertex 0 falls through the face, vertex 1 ends above it and vertex 2 beside it; the direction upwards decides the
  // second alone.
  const std::vector<dvec3> x = {{0.2, 0.2, 1}, {0.2, 0.2, 1}, {5, 5, 1}, {0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  std::vector<dvec3> y = x;
  y[0].z = y[2].z = -1;
  y[1].z = 0.5;
  const kernels::face_nodes face{{3, 4, 5}};
  const kernels::edge_nodes edges[2] = {{{0, 3}}, {{4, 5}}};
  const std::vector<float> error(9, 0);  // of vertices, the face and the edges
  const std::vector<unsigned char> motion(9, MOTION_OPEN);
  std::vector<kernels::vertex_contact> properties(6);
  for (auto &v : properties) v = {1e-3, 0, 0, 0, 0, 0, 0, SHAPE_MESH};
  const int faces = 5000, all = faces + 1;
  std::vector<kernels::pair> vertex_face(faces);
  for (int i = 0; i < faces; ++i) vertex_face[std::size_t(i)] = {i % 3, 0};
  const kernels::pair edge_edge{0, 1};
  const std::vector<kernels::fvec3> up(faces, kernels::fvec3_make(0, 0, 1)), none(1, kernels::fvec3_make(0, 0, 0));
  std::vector<float> bounds(all, 0.0f);
  // The codes of what is found, in order.
  const auto detect = [&](int list_teams, int faces_from, int edges_from, bool many = false) {
    const int first = faces - faces_from, pairs = first + 1 - edges_from;
    int found[DETECTION_COUNTS] = {};
    std::vector<int> open(all), list(all);
    select_open_pairs((pairs - 1) / RUN_PAIRS + 1, pairs, first, 6, 1, 0, vertex_face.data(), &edge_edge, 1.0, 1e-3,
                      error.data(), motion.data(), faces_from, edges_from, 0, bounds.data(), 0, bounds.data(),
                      open.data(), found);
    CHECK(found[DETECTION_OPEN] == pairs);
    select_ccd_pairs(list_teams, vertex_face.data(), &edge_edge, &face, edges, 1.0, x.data(), y.data(),
                     properties.data(), up.data(), none.data(), open.data(), list.data(), found);
    CHECK(found[DETECTION_UNCLEAR] < pairs);
    const auto find = [&](auto kernel) {
      kernel(list_teams, 0, vertex_face.data(), &edge_edge, &face, edges, x.data(), y.data(), properties.data(), 1.0,
             list.data(), found);
    };
    many ? find(kernels::find_many_impacts) : find(kernels::find_impacts);
    std::vector<int> code(std::size_t(found[DETECTION_IMPACTS]) + 2, -7);
    kernels::collect_impacts(list_teams, 1, list.data(), code.data(), found);
    CHECK(found[DETECTION_COLLECTED] == found[DETECTION_IMPACTS]);
    CHECK(code.front() == -7);
    CHECK(code.back() == -7);
    std::vector<int> codes(code.begin() + 1, code.end() - 1);
    std::sort(codes.begin(), codes.end());
    return codes;
  };
  std::vector<int> expected;
  const std::vector<int> one = detect(1, 0, 0);
  if (one.front() < 0) expected.push_back(kernels::pair_code(1, 0));  // of the edges, which is not at issue here
  for (int i = 0; i < faces; i += 3) expected.push_back(i);
  for (const int teams : {1, 2, 5, 16}) {
    INFO(teams << " teams");
    CHECK(detect(teams, 0, 0) == expected);
    CHECK(detect(teams, 0, 0, true) == expected);
  }
  // 4,000 faces and the edges are decided: only the rest counts.
  const std::vector<int> rest = detect(2, 4000, 1);
  CHECK(rest.size() == 333);  // 4,002 to 4,998 in threes
  CHECK(std::equal(rest.begin(), rest.end(), expected.end() - 333));
}

TEST_CASE("the code of a pair tells its list and its place", "[impact]")
{
  for (const int at : {0, 1, 7, 0x7ffffffe}) {
    CHECK(kernels::code_kind(kernels::pair_code(0, at)) == 0);
    CHECK(kernels::code_kind(kernels::pair_code(1, at)) == 1);
    for (const int kind : {0, 1}) {
      CHECK(kernels::code_place(kernels::pair_code(kind, at)) == at);
      CHECK(kernels::pair_code(kind, at) != NO_PAIR);
    }
  }
}

TEST_CASE("detection knows of a feature the largest error of its vertices, and whether one moves", "[impact]")
{
  // Vertices end 0, 1, 3 and 2 m from their predictions; 0 is fixed, and 3 alone has another motion than before.
  const std::vector<dvec3> x(4, dvec3{0, 0, 0}), y = {{0, 0, 0}, {1, 0, 0}, {0, 3, 0}, {0, 0, 2}};
  const std::vector<double> inverse_mass = {0, 1, 1, 1};
  const int changed[4] = {0, 0, 0, 1};
  const dvec3 bounds[2] = {{-10, -10, -10}, {10, 10, 10}};
  std::vector<kernels::box> boxes(4);
  for (auto &b : boxes)
    for (int k = 0; k < 3; ++k) {
      b.lo[k] = 0;
      b.hi[k] = 20;
    }
  boxes[2].hi[1] = 11;  // relative to the lower bound: vertex 2 leaves it
  const kernels::face_nodes faces[2] = {{{0, 1, 2}}, {{1, 2, 3}}};
  const kernels::edge_nodes edges[2] = {{{0, 1}}, {{0, 3}}};
  std::vector<float> found_error(8);
  std::vector<unsigned char> state(8);
  std::vector<kernels::end_boxes> ends;  // half a metre around the start, 1.5 m around the prediction: 3 leaves it too
  for (const dvec3 &p : x) {
    const auto around = [&](double r) { return kernels::swept_box(p, p, r, bounds[0]); };
    ends.push_back(kernels::make_end_boxes(around(0.5), around(1.5)));
  }
  for (const int localized : {0, 1}) {
    int escaped = 0, astray = 0;
    find_prediction_errors(4, x.data(), y.data(), x.data(), inverse_mass.data(), localized, changed, boxes.data(),
                           ends.data(), bounds, 0, found_error.data(), state.data(), &astray);
    CHECK(astray == 2);
    find_prediction_errors(4, x.data(), y.data(), x.data(), inverse_mass.data(), localized, changed, boxes.data(),
                           nullptr, bounds, 0, found_error.data(), state.data(), &escaped);
    find_feature_motions(4, 4, 2, faces, edges, found_error.data(), state.data());
    CHECK(escaped == 1);
    const double error[8] = {0, 1, 3, 2, 3, 3, 1, 2};  // of vertices, faces, edges
    const int free[8] = {0, 1, 1, 1, 1, 1, 1, 1}, other[8] = {0, 0, 0, 1, 0, 1, 0, 1};
    for (std::size_t i = 0; i < 8; ++i) {
      CAPTURE(localized, i);
      CHECK(found_error[i] == Approx(error[i]).margin(1e-6));
      CHECK(found_error[i] >= error[i]);
      CHECK(int(state[i]) == (free[i] * MOTION_FREE | (localized ? other[i] : 1) * MOTION_CHANGED));
    }
  }
}

TEST_CASE("what pushes leaves no impact violated by more than the tolerance", "[impact]")
{
  for (unsigned seed = 100; seed < 120; ++seed) {
    Maker maker(seed);
    Problem p = maker.vertices(40);
    maker.add(p, 12, false);
    const VectorXd moved = p.stacked() + project(p, 0.01, false);
    const VectorXd before = p.jacobian() * p.stacked(), after = p.jacobian() * moved;
    const double violated = (VectorXd::Constant(12, 0.01) - before).maxCoeff();
    for (int i = 0; i < 12; ++i) {
      INFO("seed " << seed << ", impact " << i);
      if ((p.jacobian() * p.mobility().asDiagonal() * p.jacobian().transpose())(i, i) > 0)
        CHECK(after[i] > 0.01 - 0.02 * violated);
    }
  }
}

TEST_CASE("an impact of two masses ends with the common velocity of the centre of mass", "[impact]")
{
  const double dt = 0.01;
  const dvec3 n{0, 0, 1};
  for (bool zones : {false, true})
    for (double ratio : {1.0, 3.0, 100.0}) {
      INFO((zones ? "zones, " : "") << "mass ratio " << ratio);
      Problem p;
      p.cloth = 4;
      const Vector3d v1(0.3, 0, -2), v2(-0.1, 0.2, 1);
      p.position = {
          {v1.x() * dt, v1.y() * dt, v1.z() * dt}, {v2.x() * dt, v2.y() * dt, v2.z() * dt}, {1, 0, 0}, {0, 1, 0}};
      p.inverse_mass = {1.0, ratio, 1.0, 1.0};  // m1 = 1, m2 = 1 / ratio
      p.impacts = {between(0, 1, n)};
      const VectorXd dx = project(p, 0, zones);
      const double common = (v1.z() + v2.z() / ratio) / (1 + 1 / ratio), tolerance = 3e-3;
      CHECK(std::abs(v1.z() + dx[2] / dt - common) < tolerance);
      CHECK(std::abs(v2.z() + dx[5] / dt - common) < tolerance);
      CHECK(dx[0] == 0);  // along the normal only
      CHECK(dx[4] == 0);
      CHECK(dx.tail(6).norm() == 0);
      if (ratio == 1) CHECK(std::abs(v1.z() + dx[2] / dt - 0.5 * (v1.z() + v2.z())) < tolerance);
    }
}

TEST_CASE("impacts that separate already are left alone", "[impact]")
{
  Problem p;
  p.cloth = 4;
  p.position = {{0, 0, 1}, {0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  p.inverse_mass.assign(4, 1.0);
  p.impacts = {between(0, 1, {0, 0, 1})};
  for (bool zones : {false, true}) CHECK(project(p, 0.1, zones).norm() == 0);
}

TEST_CASE("impacts between what cannot move change nothing and break nothing", "[impact]")
{
  Problem p;
  p.cloth = 2;
  p.position = {{0, 0, -1}, {0, 0, 0}, {1, 0, -3}, {0, 1, 0}};
  p.inverse_mass.assign(4, 0.0);
  p.impacts = {between(0, 1, {0, 0, 1}), between(2, 3, {0, 0, 1})};
  for (bool zones : {false, true}) CHECK(project(p, 0, zones).norm() == 0);
}

TEST_CASE("momentum is conserved to rounding by any set of impacts of free vertices", "[impact]")
{
  for (unsigned seed = 0; seed < 20; ++seed) {
    Maker maker(seed);
    Problem p = maker.vertices(25);
    for (double &m : p.inverse_mass) m = std::exp(maker.normal());
    p.cloth = static_cast<int>(p.position.size());
    maker.add(p, 9, false);
    for (bool zones : {false, true}) {
      const VectorXd dx = project(p, 0.1, zones);
      Vector3d momentum(0, 0, 0);
      double size = 0;
      for (std::size_t i = 0; i < p.position.size(); ++i) {
        const Vector3d part = dx.segment<3>(3 * static_cast<int>(i)) / p.inverse_mass[i];
        momentum += part;
        size += part.norm();
      }
      REQUIRE(size > 0);
      CHECK(momentum.norm() < 1e-14 * size);
    }
  }
}

TEST_CASE("angular momentum is conserved to rounding by an impact as detection finds it", "[impact]")
{
  int hits = 0;
  for (unsigned seed = 0; seed < 400 && hits < 60; ++seed) {
    Maker maker(seed);
    const int kind = static_cast<int>(seed % 2);
    std::vector<dvec3> x, y;
    if (kind == 0)
      x = {{0.3, 0.3, 0.5}, {0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    else
      x = {{-1, 0, 0.5}, {1, 0, 0.5}, {0, -1, 0}, {0, 1, 0}};
    for (int k = 0; k < 4; ++k) {
      const bool above = kind == 0 ? k == 0 : k < 2;
      x[static_cast<std::size_t>(k)] = kernels::daxpy(x[static_cast<std::size_t>(k)], 0.1, maker.vector());
      y.push_back(kernels::dadd(kernels::daxpy(x[static_cast<std::size_t>(k)], 0.2, maker.vector()),
                                {0, 0, above ? -1.0 : 0.2}));
    }
    Problem p;
    p.cloth = 4;
    p.position = y;
    p.impacts = find(x, y, kind, 1e-3);
    if (p.impacts.empty()) continue;
    ++hits;
    for (int k = 0; k < 4; ++k) p.inverse_mass.push_back(std::exp(maker.normal()));
    const VectorXd dx = project(p, 0.01, seed % 4 < 2);
    // Moments are about the positions at the time of impact, where the impulse acts.
    const std::array<dvec3, 4> start{x[0], x[1], x[2], x[3]}, end{y[0], y[1], y[2], y[3]};
    const double time = kind == 0 ? vertex_face_ccd(start, end, 1e-3).time : edge_edge_ccd(start, end, 1e-3).time;
    Vector3d linear(0, 0, 0), angular(0, 0, 0);
    double size = 0;
    for (std::size_t k = 0; k < 4; ++k) {
      const Vector3d impulse = dx.segment<3>(3 * static_cast<int>(k)) / p.inverse_mass[k];
      linear += impulse;
      angular += eigen(kernels::dlerp(x[k], y[k], time)).cross(impulse);
      size += impulse.norm();
    }
    INFO("seed " << seed);
    REQUIRE(size > 0);
    CHECK(linear.norm() < 1e-14 * size);
    CHECK(angular.norm() < 1e-12 * size);
  }
  CHECK(hits >= 30);
}

TEST_CASE("a rigid zone moves as its obstacle does, or by the mean of its masses", "[impact]")
{
  const Eigen::AngleAxisd turn(0.3, Vector3d(1, 2, -1).normalized());
  const Vector3d shift(0.02, -0.01, 0.05);
  Maker maker(11);
  Problem p = maker.vertices(8);
  for (std::size_t i = 0; i < p.position.size(); ++i) p.inverse_mass[i] = i < 8 ? std::exp(maker.normal()) : 0;
  p.position.push_back(maker.vector());  // an obstacle of three vertices behind the cloth
  p.inverse_mass.push_back(0);
  impact of_cloth = between(0, 1, {0, 0, 1}), of_both = between(4, 5, {0, 0, 1}), once = between(6, 7, {0, 0, 1});
  of_cloth.repeated = of_both.repeated = 1;
  of_both.node[2] = 8;
  of_both.node[3] = 9;
  impact other = of_both;
  other.node[0] = 5;
  other.node[1] = 10;
  std::vector<dvec3> wanted = p.position;
  for (dvec3 &x : wanted) {
    const Vector3d y = turn * eigen(x) + shift;
    x = {y.x(), y.y(), y.z()};
  }
  for (std::size_t i = 0; i < 8; ++i) wanted[i] = kernels::daxpy(wanted[i], 0.01, maker.vector());

  const auto backend = make_backend("auto", 0, 1);
  State state(*backend);
  state.mesh.cloth_vertices = 8;
  state.mesh.vertices = static_cast<int>(p.position.size());
  state.mesh.inverse_mass = {*backend, p.inverse_mass};
  state.contact.impact = {*backend, std::vector<impact>{of_cloth, of_both, other, once}};
  Stream<dvec3> from(*backend, p.position), end(*backend, wanted), positions(*backend, wanted);
  Stream<int> moved(*backend, std::vector<int>(p.position.size(), 0));
  move_rigid_zones(state, from, end, positions, moved);
  const std::vector<dvec3> x = positions.download();
  const std::vector<int> flag = moved.download();
  for (std::size_t v : {4, 5}) {  // with the obstacle
    const double error = (eigen(x[v]) - (turn * eigen(p.position[v]) + shift)).norm();
    INFO(error * 1e12 << "e-12");
    CHECK(error < 1e-12);
    CHECK(flag[v] == 1);
  }
  Vector3d before(0, 0, 0), after(0, 0, 0);
  for (std::size_t v : {0, 1, 2, 3}) {  // what the impact connects keeps its shape and the centre of what was wanted
    before += eigen(wanted[v]) / p.inverse_mass[v];
    after += eigen(x[v]) / p.inverse_mass[v];
    for (std::size_t w : {0, 1, 2, 3})
      CHECK(std::abs((eigen(x[v]) - eigen(x[w])).norm() - (eigen(p.position[v]) - eigen(p.position[w])).norm()) <
            1e-13);
  }
  CHECK((before - after).norm() < 1e-13 * (1 + before.norm()));
  for (std::size_t v : {6, 7}) {  // its impact was found once
    CHECK((eigen(x[v]) - eigen(wanted[v])).norm() == 0);
    CHECK(flag[v] == 0);
  }
}

TEST_CASE("duplicate and nearly duplicate impacts change nothing", "[impact]")
{
  Maker maker(3);
  Problem p = maker.vertices(12);
  maker.add(p, 4, false);
  const VectorXd alone = quadratic_program(p, 0.05);
  Problem many = p;
  for (int copy = 0; copy < 50; ++copy)
    for (const impact &m : p.impacts) {
      impact other = m;
      if (copy % 2) other.normal = kernels::dnormalize(kernels::daxpy(m.normal, 1e-9, maker.vector()));
      many.impacts.push_back(other);
    }
  const VectorXd pushed = project(many, 0.05, false);
  CHECK(cost(p, pushed - alone) < 0.05 * cost(p, alone));
  for (bool zones : {false, true}) {
    const VectorXd dx = project(many, 0.05, zones);
    REQUIRE(dx.allFinite());
    CHECK(cost(p, dx) < 2 * cost(p, alone));  // nothing diverges
  }
}

TEST_CASE("the projection is the same for any number of threads", "[impact]")
{
  Maker maker(8);
  Problem p = maker.vertices(3000);
  maker.add(p, 2500, false);
  for (bool zones : {false, true}) {
    const VectorXd one = project(p, 0.01, zones, 1), seven = project(p, 0.01, zones, 7);
    CHECK((one.array() == seven.array()).all());
  }
}

TEST_CASE("no vertex goes further from where it was wanted than twice the longest motion", "[impact]")
{
  const auto backend = make_backend("auto", 0, 1);
  State state(*backend);
  Maker maker(5);
  Problem p = maker.vertices(60);
  maker.add(p, 80, false);
  state.mesh.cloth_vertices = p.cloth;
  state.mesh.vertices = static_cast<int>(p.position.size());
  state.mesh.inverse_mass = {*backend, p.inverse_mass};
  state.contact.impact = {*backend, p.impacts};
  std::vector<dvec3> from = p.position;
  from[3].x += 0.02;  // the longest motion, 2 cm
  Stream<dvec3> positions(*backend, p.position);
  ImpactProjection stage(*backend);
  stage.start(state, Stream<dvec3>(*backend, from), positions);
  const double target = 10, most = 2 * 0.02 + target;  // a violation of metres
  bool held = false;
  for (int run = 0; run < 3; ++run) {
    const double apart = run == 0 ? target : 3 * target;
    for (impact &m : p.impacts) m.target = apart;
    state.contact.impact.assign(p.impacts);
    stage.run(state, positions);
  }
  const std::vector<dvec3> after = positions.download();
  for (int v = 0; v < p.cloth; ++v) {
    const double away = (eigen(after[v]) - eigen(p.position[v])).norm();
    CHECK(away <= 2 * 0.02 + 3 * target + 1e-9);
    held |= away > most;
  }
  CHECK(held);
}

TEST_CASE("lists grow from nothing: impacts by the thousand after none", "[impact]")
{
  const auto backend = make_backend("auto", 0, 1);
  State state(*backend);
  state.contact.impact = Stream<impact>(*backend, 1);
  ImpactProjection stage(*backend, strict);
  for (int count : {1, 0, 700, 3}) {
    Maker maker(9);
    Problem p = maker.vertices(900);
    maker.add(p, count, false);
    state.mesh.cloth_vertices = p.cloth;
    state.mesh.vertices = static_cast<int>(p.position.size());
    state.mesh.inverse_mass = {*backend, p.inverse_mass};
    for (impact &m : p.impacts) m.target = 0.01;
    state.contact.impact.assign(p.impacts);
    Stream<dvec3> positions(*backend, p.position);
    stage.start(state, Stream<dvec3>(*backend, std::vector<dvec3>(p.position.size(), dvec3{1e6, 0, 0})), positions);
    stage.run(state, positions);
    const std::vector<dvec3> after = positions.download();
    const VectorXd fresh = project(p, 0.01, false);
    for (std::size_t i = 0; i < after.size(); ++i)
      REQUIRE((eigen(after[i]) - eigen(p.position[i]) - fresh.segment<3>(3 * static_cast<int>(i))).norm() == 0);
  }
}
