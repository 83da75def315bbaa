// SPDX-License-Identifier: Apache-2.0
// Terms of the system that are not elements of the cloth: contacts, friction and stitches, against plane and line
// distances, finite differences and Coulomb's law for one mass.
#include "../catch.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include <Eigen/Dense>

#include "device/kernels.hpp"

using namespace cama;
using namespace cama::kernels;

namespace {

using Vector = Eigen::Vector3d;
using Corners = std::array<Vector, 4>;
using Term = Types<double>::term;
using Matrix12 = Eigen::Matrix<double, 12, 12>;

dvec3 to_dvec3(const Vector &v) { return {v[0], v[1], v[2]}; }

class Random {
public:
  explicit Random(unsigned seed) : engine_(seed) {}
  double operator()(double lo, double hi) { return std::uniform_real_distribution<double>(lo, hi)(engine_); }
  Vector vector(double size) { return Vector((*this)(-size, size), (*this)(-size, size), (*this)(-size, size)); }

private:
  std::mt19937 engine_;
};

/// A pair closer than its thickness whose closest points lie inside its features: the vertex over the face, or the
/// edges crossing.
Corners close_pair(Random &random, int kind)
{
  const Eigen::Matrix3d turn =
      Eigen::Quaterniond(random(-1, 1), random(-1, 1), random(-1, 1), random(-1, 1)).normalized().toRotationMatrix();
  const Vector shift = random.vector(1);
  const double gap = random(1e-4, 9e-4) * (random(0, 1) < 0.5 ? 1 : -1);
  Corners x;
  if (kind == 0)
    x = {Vector(0.001, 0.002, gap), Vector(-0.02, -0.01, 0), Vector(0.02, -0.012, 0), Vector(0.001, 0.02, 0)};
  else
    x = {Vector(-0.01, random(-2e-3, 2e-3), gap), Vector(0.013, random(-2e-3, 2e-3), gap), Vector(1e-3, -0.012, 0),
         Vector(2e-3, 0.01, 0)};
  for (Vector &p : x) p = turn * p + shift;
  return x;
}

/// Distance of a point from a plane, or of two lines.
double reference_distance(int kind, const Corners &x)
{
  if (kind == 0) return std::abs((x[0] - x[1]).dot((x[2] - x[1]).cross(x[3] - x[1]).normalized()));
  return std::abs((x[2] - x[0]).dot((x[1] - x[0]).cross(x[3] - x[2]).normalized()));
}

constexpr double thickness = 1e-3, stiffness = 10, time_step = 1.0 / 200;

/// The contact of a pair of free vertices, and its term; `velocity`: free velocities.
void make_terms(int kind, const Corners &x, double friction, const std::array<Vector, 4> &velocity, double mass,
                contact &c, Term &t)
{
  dvec3 position[4], free_velocity[4];
  double inverse_mass[4];
  c = contact{};
  for (int a = 0; a < 4; ++a) {
    position[a] = to_dvec3(x[a]);
    free_velocity[a] = to_dvec3(velocity[a]);
    inverse_mass[a] = 1 / mass;
    c.node[a] = a;
  }
  const proximity p = pair_proximity(kind, {{0, 1, 2, 3}}, position);
  REQUIRE(p.interior);
  std::copy(p.weight, p.weight + 4, c.weight);
  c.kind = kind;
  c.normal = p.normal;
  c.distance = p.distance;
  c.thickness = thickness;
  c.stiffness = stiffness;
  c.friction = c.static_friction = friction;
  double load[4];   // the only contact of its vertices, so that each gives it its whole mass
  for (int a = 0; a < 4; ++a) load[a] = std::abs(c.weight[a]) * stiffness * (thickness - p.distance);
  f64::make_contact_terms(1, &c, inverse_mass, free_velocity, load, time_step, &t);
}

Matrix12 matrix(const Term &t, int form)
{
  Matrix12 m;
  for (int a = 0; a < 4; ++a)
    for (int b = 0; b < 4; ++b) {
      const auto block = f64::term_block(t, form, a, b);
      for (int r = 0; r < 3; ++r) m.block<1, 3>(3 * a + r, 3 * b) << block.row[r].x, block.row[r].y, block.row[r].z;
    }
  return m;
}

double lowest_eigenvalue(const Matrix12 &m)
{
  return Eigen::SelfAdjointEigenSolver<Matrix12>(m, Eigen::EigenvaluesOnly).eigenvalues()[0];
}

}  // namespace

TEST_CASE("contact forces are the negative gradient of the penalty energy", "[term]")
{
  Random random(1);
  double worst = 0;
  for (int n = 0; n < 1000; ++n) {
    const int kind = n % 2;
    const Corners x = close_pair(random, kind);
    contact c;
    Term t;
    make_terms(kind, x, 0, {Vector::Zero(), Vector::Zero(), Vector::Zero(), Vector::Zero()}, 1e-4, c, t);
    REQUIRE(c.distance == Approx(reference_distance(kind, x)).epsilon(1e-9));
    const auto energy = [&](const Corners &y) {
      const double d = reference_distance(kind, y) - thickness;
      return 0.5 * c.stiffness * d * d;
    };
    Vector sum = Vector::Zero();
    double off = 0, scale = 0;
    for (int a = 0; a < 4; ++a) {
      const Vector force = t.weight[a] * t.push / time_step * Vector(t.normal.x, t.normal.y, t.normal.z);
      Vector expected;
      for (int k = 0; k < 3; ++k) {
        const auto at = [&](double s) {
          Corners y = x;
          y[a][k] += s;
          return energy(y);
        };
        const double h = 1e-6;
        expected[k] = -(8 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))) / (12 * h);
      }
      off = std::max(off, (force - expected).norm());
      scale = std::max(scale, expected.norm());
      sum += force;
    }
    worst = std::max(worst, off / scale);
    REQUIRE(sum.norm() <= 1e-12 * scale);
  }
  CAPTURE(worst);
  CHECK(worst < 1e-6);
}

TEST_CASE(
    "contact matrices are symmetric, positive semidefinite and blind to translation, in both forms, with friction",
    "[term]")
{
  Random random(2);
  for (int n = 0; n < 1000; ++n) {
    const int kind = n % 2;
    const Corners x = close_pair(random, kind);
    contact c;
    Term t;
    make_terms(kind, x, random(0, 1), {random.vector(1), random.vector(1), random.vector(1), random.vector(1)}, 1e-4, c,
               t);
    for (int form : {FORM_RANK_ONE, FORM_STAR}) {
      const Matrix12 m = matrix(t, form);
      const double scale = m.cwiseAbs().maxCoeff();
      REQUIRE((m - m.transpose()).cwiseAbs().maxCoeff() <= 1e-14 * scale);
      REQUIRE(lowest_eigenvalue(m) >= -1e-13 * scale);
      Eigen::Matrix<double, 12, 1> shift;
      shift << 1, 2, 3, 1, 2, 3, 1, 2, 3, 1, 2, 3;
      REQUIRE((m * shift).norm() <= 1e-12 * scale);
    }
    // Without friction the rank-one form is dt^2 k (w n)(w n)', the Gauss-Newton part of the energy's Hessian.
    t.along += t.around;
    t.around = 0;
    Eigen::Matrix<double, 12, 1> g;
    for (int a = 0; a < 4; ++a) g.segment<3>(3 * a) = t.weight[a] * Vector(t.normal.x, t.normal.y, t.normal.z);
    REQUIRE(
        (matrix(t, FORM_RANK_ONE) - time_step * time_step * c.stiffness * g * g.transpose()).cwiseAbs().maxCoeff() <=
        1e-12 * t.along);
  }
}

TEST_CASE("friction of one contact obeys Coulomb's law over a backward Euler step", "[term]")
{
  // A mass m with free speed s and damping phi ends at v = s / (1 + phi dt / m); the friction was phi v.
  Random random(3);
  for (int n = 0; n < 2000; ++n) {
    const double mass = std::pow(10, random(-6, -3)), normal = mass * random(0, 100), mu = random(0, 1),
                 speed = std::pow(10, random(-6, 1));
    const double phi = f64::friction_alone(mu, mu, normal, speed, mass, time_step);
    const double after = speed / (1 + phi * time_step / mass), force = phi * after, stopping = speed * mass / time_step;
    REQUIRE(phi >= 0);
    REQUIRE(force <= mu * normal * (1 + 1e-9) + 1e-300);
    if (stopping <= mu * normal)
      REQUIRE(after <= speed / 1000);                             // sticks
    else if (after > speed / 500)
      REQUIRE(force == Approx(mu * normal).epsilon(1e-9));       // slides at the cone
  }
  // With a static coefficient above the kinetic one it sticks up to the first and slides with the second.
  const double mass = 2e-4, normal = 3e-3;
  const auto force = [&](double stopping, double &after) {
    const double speed = stopping * time_step / mass,
                 phi = f64::friction_alone(0.5, 0.3, normal, speed, mass, time_step);
    after = speed / (1 + phi * time_step / mass);
    return phi * after;
  };
  double after;
  CHECK(force(0.499 * normal, after) == Approx(0.499 * normal).epsilon(2e-3));
  CHECK(after <= 0.499 * normal * time_step / mass / 1000);
  CHECK(force(0.501 * normal, after) == Approx(0.3 * normal).epsilon(1e-9));
  CHECK(after == Approx(0.201 * normal * time_step / mass).epsilon(1e-9));
  CHECK(f64::friction_alone(0.0, 0.0, 1.0, 1.0, 1.0, time_step) == 0.0);
  CHECK(f64::friction_alone(1.0, 1.0, 0.0, 1.0, 1.0, time_step) == 0.0);
}

TEST_CASE("friction around an iterate is Coulomb's: at the cone where it slides, as it was where it sticks", "[term]")
{
  Random random(4);
  const double mass = 2e-4, change = time_step / mass;  // m/s a newton
  const auto at = [](const f64::friction_law &law, const dvec3 &v) { return daxpy(law.force, -law.damping, v); };
  for (int n = 0; n < 1000; ++n) {
    const double normal = random(0.01, 1), mu = random(0.1, 1), mu_s = mu * random(1, 2), cone = mu * normal,
                 could = mu_s * normal * change,
                 angle = random(0, 6.28);  // could: what friction can change in the step
    const dvec3 none = {0, 0, 0}, along = {std::cos(angle), std::sin(angle), 0},
                fast = dscale(could * random(1, 3), along);
    const auto around = [&](const dvec3 &force, const dvec3 &v, const dvec3 &expected) {
      return f64::friction_around(mu_s, mu, normal, force, v, expected, mass, time_step);
    };
    // Sliding: mu N against the velocity, whether or not there was friction before, at the velocity that is expected.
    for (const dvec3 &before : {none, dscale(-cone, along)})
      for (const double faster : {1.0, 1.1}) {
        const dvec3 expected = dscale(faster, fast), f = at(around(before, fast, expected), expected);
        REQUIRE(dnorm(daxpy(f, cone, along)) <= 1e-12 * cone);
      }
    // It never pushes: the more it slides, the more friction.
    REQUIRE(around(none, fast, fast).damping >= 0);
    // At rest within the static cone it has the force that it had, and hardly moves.
    const dvec3 held = dscale(random(0, 0.999) * mu_s * normal, along);
    REQUIRE(dnorm(dsub(at(around(held, none, none), none), held)) == 0);
    REQUIRE(around(held, none, none).damping * change >= 99);
    // More than that tears it loose, with static friction while it is slow.
    const dvec3 torn = at(around(dscale(1.3 * mu_s * normal, along), none, none), none);
    REQUIRE(dnorm(daxpy(torn, -mu_s * normal, along)) <= 1e-12 * mu_s * normal);
    const dvec3 slow = dscale(0.05 * could, along),
                slowed = at(around(dscale(-mu_s * normal, along), slow, slow), slow);
    REQUIRE(dnorm(daxpy(slowed, mu_s * normal, along)) <= 1e-12 * mu_s * normal);
    // What moved backwards under friction that was too large stops, and is not pushed the other way.
    const dvec3 back = dscale(-0.05 * could, along);
    REQUIRE(around(dscale(-0.99 * mu_s * normal, along), back, back).damping * change >= 50);
    // One that is stopped has a few times its cone at most if others go on pulling it.
    const dvec3 stopping = dscale(0.5 * cone * change, along);
    REQUIRE(dnorm(at(around(none, stopping, stopping), stopping)) <= 4.001 * cone);
    // What holds with a force far beyond the cone lets go, as fast as that force would have it: a vertex torn from a
    // wall.
    const double beyond = 1e4 * mu_s * normal;
    const f64::friction_law lost = around(dscale(beyond, along), none, none);
    REQUIRE(dnorm(at(lost, dscale(-beyond * change, along))) <= 2.001 * cone);
  }
  const dvec3 v = {1, 0, 0};
  for (const f64::friction_law &law :
       {f64::friction_around(0, 0, 1, v, v, v, 1, time_step), f64::friction_around(1, 1, 0, v, v, v, 1, time_step)}) {
    CHECK(dnorm(law.force) == 0.0);
    CHECK(law.damping == 0.0);
  }
}

TEST_CASE("contacts find the friction that they had by their features, or of the face that their vertex comes from",
          "[term]")
{
  // A strip of faces 0 to 3 and one apart, 4; vertices 7 and 8.
  const std::vector<face_nodes> face = {{{0, 1, 2}}, {{2, 1, 3}}, {{2, 3, 4}}, {{4, 3, 5}}, {{10, 11, 12}}};
  const auto pair = [](int vertex, int on) { return key64(vertex) << 31 | key64(on); };
  const key64 edges = key64(1) << 62;
  const auto recall = [&](const std::vector<key64> &before, const std::vector<key64> &now) {
    std::vector<dvec3> force, kept(now.size());
    for (std::size_t i = 0; i < before.size(); ++i) force.push_back({1.0 + static_cast<double>(i), 2, 3});
    f64::recall_friction(static_cast<int>(now.size()), static_cast<int>(before.size()), face.data(), now.data(),
                         before.data(), force.data(), kept.data());
    std::vector<double> x;
    for (const dvec3 &k : kept) x.push_back(k.x);
    return x;
  };
  using List = std::vector<double>;
  CHECK(recall({pair(7, 0), pair(8, 1), edges}, {pair(6, 0), pair(7, 0), pair(8, 1), edges, edges + 1}) ==
        List{0, 1, 2, 3, 0});
  CHECK(recall({pair(7, 0)}, {pair(7, 1)}) == List{1});  // over an edge
  CHECK(recall({pair(7, 0)}, {pair(7, 2)}) == List{1});  // over a corner
  CHECK(recall({pair(7, 0)}, {pair(7, 3)}) == List{0});  // no neighbour
  CHECK(recall({pair(7, 0)}, {pair(7, 4)}) == List{0});
  CHECK(recall({pair(7, 0)}, {pair(8, 1)}) == List{0});  // another vertex
  CHECK(recall({pair(7, 0)}, {pair(7, 0), pair(7, 1)}) == List{1, 0});  // it is still there
  CHECK(recall({pair(7, 0), pair(7, 1)}, {pair(7, 2)}) == List{2});  // the nearest of both
  CHECK(recall({edges + pair(7, 0)}, {edges + pair(7, 1)}) == List{0});  // edges
  CHECK(recall({}, {pair(7, 1)}) == List{0});
}

TEST_CASE("a stitch pulls with the gradient of its energy and its matrix is the exact Hessian", "[term]")
{
  Random random(4);
  for (int n = 0; n < 200; ++n) {
    dvec3 x[3];
    for (dvec3 &p : x) p = to_dvec3(random.vector(0.1));
    const stitch s{{0, 1, 2}, random(0, 1), random(1, 2000), 0};
    const auto term_of = [&](const dvec3 *y) {
      Term t;
      f64::make_stitch_terms(1, &s, y, time_step, 0, &t);
      return t;
    };
    const auto energy = [&](const dvec3 *y) {
      const Vector gap(y[0].x - (1 - s.ratio) * y[1].x - s.ratio * y[2].x,
                       y[0].y - (1 - s.ratio) * y[1].y - s.ratio * y[2].y,
                       y[0].z - (1 - s.ratio) * y[1].z - s.ratio * y[2].z);
      return 0.5 * s.stiffness * gap.squaredNorm();
    };
    const Term t = term_of(x);
    const Matrix12 m = matrix(t, FORM_RANK_ONE) / (time_step * time_step);
    const auto shifted = [&](int i, double h) {
      std::array<dvec3, 3> y{x[0], x[1], x[2]};
      (&y[static_cast<std::size_t>(i / 3)].x)[i % 3] += h;
      return y;
    };
    const auto force = [&](const Term &of, int i) {
      const double normal[3] = {of.normal.x, of.normal.y, of.normal.z};
      return of.weight[i / 3] * of.push / time_step * normal[i % 3];
    };
    const double h = 1e-3, scale = s.stiffness * 0.1;
    for (int i = 0; i < 9; ++i) {
      const auto p = shifted(i, h), q = shifted(i, -h);
      // Quadratic: exact.
      REQUIRE(std::abs(force(t, i) + (energy(p.data()) - energy(q.data())) / (2 * h)) <= 1e-9 * scale);
      for (int j = 0; j < 9; ++j)
        REQUIRE(std::abs(m(j, i) + (force(term_of(p.data()), j) - force(term_of(q.data()), j)) / (2 * h)) <=
                1e-9 * s.stiffness);
    }
  }
}

TEST_CASE("an elastic pulls with the gradient of its energy, its matrix is the Hessian, and it is slack when short",
          "[term]")
{
  Random random(5);
  int pulling = 0, slack = 0;
  for (int n = 0; n < 200; ++n) {
    const double size = 0.1, h = 1e-6;
    std::array<dvec3, 2> x{to_dvec3(random.vector(size)), to_dvec3(random.vector(size))};
    const auto distance = [](const std::array<dvec3, 2> &y) {
      return Vector(y[0].x - y[1].x, y[0].y - y[1].y, y[0].z - y[1].z).norm();
    };
    const stitch s{{0, 1, 1}, 0, random(1, 2000), random(0.3, 1.5) * distance(x)};
    if (std::abs(distance(x) - s.length) < 1e-3 * size) continue;  // beside the kink of its force
    const auto energy = [&](const std::array<dvec3, 2> &y) {
      const double stretch = std::max(distance(y) - s.length, 0.0);
      return 0.5 * s.stiffness * stretch * stretch;
    };
    const auto term_of = [&](const std::array<dvec3, 2> &y) {
      Term t;
      f64::make_stitch_terms(1, &s, y.data(), time_step, 0, &t);
      return t;
    };
    const auto shifted = [&](int i, double by) {
      std::array<dvec3, 2> y = x;
      (&y[static_cast<std::size_t>(i / 3)].x)[i % 3] += by;
      return y;
    };
    const auto force = [&](const Term &of, int i) {
      const double normal[3] = {of.normal.x, of.normal.y, of.normal.z};
      return of.weight[i / 3] * of.push / time_step * normal[i % 3];
    };
    const Term t = term_of(x);
    double measured = -1;
    const double step = time_step, inverse_mass[2] = {1, 1};
    f64::measure_terms(1, 0, 0, 0, step, nullptr, &s, x.data(), x.data(), x.data(), inverse_mass, nullptr, &t, nullptr,
                       &measured);
    REQUIRE(measured == Approx(energy(x)).margin(1e-15));
    const Matrix12 m = matrix(t, FORM_RANK_ONE) / (time_step * time_step);
    for (int i = 0; i < 6; ++i) {
      const auto p = shifted(i, h), q = shifted(i, -h);
      REQUIRE(std::abs(force(t, i) + (energy(p) - energy(q)) / (2 * h)) <= 1e-6 * s.stiffness * size);
      for (int j = 0; j < 6; ++j)
        REQUIRE(std::abs(m(j, i) + (force(term_of(p), j) - force(term_of(q), j)) / (2 * h)) <= 1e-6 * s.stiffness);
    }
    REQUIRE(Eigen::SelfAdjointEigenSolver<Matrix12>(m).eigenvalues().minCoeff() >= -1e-9 * s.stiffness);
    ++(distance(x) > s.length ? pulling : slack);
  }
  CHECK(pulling > 50);
  CHECK(slack > 50);
}
