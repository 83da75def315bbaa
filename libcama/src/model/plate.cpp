// SPDX-License-Identifier: Apache-2.0
#include "model/plate.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <random>

#include "scene/constants.hpp"

namespace cama {
namespace {

constexpr double least_share = 1e-3;   // of the largest stiffness: what a direction without stiffness has
// The matrix has a diagonal in place of the inverse compliance. Newton's method needs more than half of a bound from
// above; with less than the whole it takes larger steps.
constexpr double bound_share = 0.6;
constexpr double moment_error = 0.005; // of moments, relative, for eigenvalues of the compliance inside the interval
constexpr int fewest_iterations = 5, most_iterations = 16;

/// Hinge stiffness of a row at no curvature, or the least of the row that is not zero.
double unbent(const std::array<double, 5> &row)
{
  if (row[0] > 0) return row[0];
  double least = 0;
  for (double k : row)
    if (k > 0 && (least <= 0 || k < least)) least = k;
  return least;
}

std::array<double, 3> unbent_rows(const Material &m)
{
  std::array<double, 3> k;
  for (int r = 0; r < 3; ++r) k[r] = unbent(m.bending[r]);
  const double floor = least_share * *std::max_element(k.begin(), k.end());
  for (double &value : k) value = std::max(value, floor);
  return k;
}

/// Hinge stiffness at no curvature if it varies with curvature, else 0.
double reference_of(const Material &m, const std::array<double, 3> &k, const RestHinge &h)
{
  const auto varies = [](const std::array<double, 5> &row) {
    return std::any_of(row.begin(), row.end(), [&](double v) { return v != row[0]; });
  };
  if (std::none_of(m.bending.begin(), m.bending.end(), varies)) return 0;
  const auto sample = [&](double direction) {
    const int r = direction < 1 ? 0 : 1;
    return k[r] + (direction - r) * (k[r + 1] - k[r]);
  };
  return std::min(sample(h.direction[0]), sample(h.direction[1]));
}

/// Row k is the constant moment (11, 22, 12) of a triangle with the normal component 1 on the edge opposite corner k
/// and 0 on the others.
Eigen::Matrix3d triangle_moments(const RestTriangle &r)
{
  Eigen::Matrix2d inverse;
  inverse << r.d[0], r.d[1], r.d[2], r.d[3];
  const Eigen::Matrix2d edge = inverse.inverse();
  const Eigen::Vector2d corner[3] = {{0, 0}, edge.col(0), edge.col(1)};
  Eigen::Vector2d along[3];
  for (int k = 0; k < 3; ++k) along[k] = (corner[(k + 2) % 3] - corner[(k + 1) % 3]).normalized();
  Eigen::Matrix3d moment;
  for (int k = 0; k < 3; ++k) {
    const Eigen::Vector2d normal{along[k][1], -along[k][0]}, &p = along[(k + 1) % 3], &q = along[(k + 2) % 3];
    moment.row(k) = Eigen::RowVector3d(p[0] * q[0], p[1] * q[1], 0.5 * (p[0] * q[1] + p[1] * q[0])) /
                    (normal.dot(p) * normal.dot(q));
  }
  return moment;
}

/// Area times compliance between the moments on the three edges of a triangle, 1/N.
Eigen::Matrix3d triangle_compliance(const RestTriangle &r, const Eigen::Matrix3d &compliance)
{
  const Eigen::Matrix3d moment = triangle_moments(r);
  return r.area * moment * compliance * moment.transpose();
}

/// Curvatures (11, 22, 2 12) for moments (11, 22, 12), 1/(N m); zero without bending.
Eigen::Matrix3d bending_compliance(const Material &m)
{
  Eigen::Matrix3d c = Eigen::Matrix3d::Zero();
  if (!m.has_bending()) return c;
  const PlateStiffness d = plate_stiffness(m);
  const double det = d.d11 * d.d22 - d.d12 * d.d12;
  c << d.d22 / det, -d.d12 / det, 0, -d.d12 / det, d.d11 / det, 0, 0, 0, 2 / d.d33;
  return c;
}

struct LocalCompliance {
  Eigen::Matrix3d value;
  double least;   // eigenvalue, scaled to a diagonal of ones
};

LocalCompliance local_compliance(const RestTriangle &r, const Eigen::Matrix3d &compliance)
{
  LocalCompliance c;
  c.value = triangle_compliance(r, compliance);
  const Eigen::Vector3d scale = c.value.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::Matrix3d scaled = scale.asDiagonal() * c.value * scale.asDiagonal();
  const Eigen::Vector3d values =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(scaled, Eigen::EigenvaluesOnly).eigenvalues();
  c.least = std::max(values[0], 0.0);
  return c;
}

/// The hinges of a cloth, which couple among themselves alone.
struct HingeRange {
  std::size_t first, end;
};

/// Eigenvalues of the scaled compliance as Lanczos' method sees them from a start vector, in rising order.
Eigen::VectorXd ritz_values(const std::vector<HingeCoupling> &hinge, HingeRange range, Eigen::VectorXd v, int steps)
{
  Eigen::VectorXd before = Eigen::VectorXd::Zero(v.size()), diagonal(steps), beside(steps);
  v.normalize();
  double link = 0;
  int n = 0;
  while (n < steps) {
    Eigen::VectorXd w = v - link * before;
    for (std::size_t i = range.first; i < range.end; ++i)
      for (int k = 0; k < 4; ++k) w[i - range.first] += hinge[i].coupling[k] * v[hinge[i].neighbour[k] - range.first];
    diagonal[n] = w.dot(v);
    w -= diagonal[n] * v;
    beside[n] = link = w.norm();
    ++n;
    if (link < 1e-6) break;
    before = v;
    v = w / link;
  }
  Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver;
  solver.computeFromTridiagonal(diagonal.head(n), beside.head(n - 1), Eigen::EigenvaluesOnly);
  return solver.eigenvalues();
}

/// The interval reaches from what a uniformly bent sheet has (`smooth`: its scaled angles) to the largest eigenvalue.
MomentIteration moment_iteration(const std::vector<HingeCoupling> &hinge, HingeRange range,
                                 const Eigen::VectorXd &smooth)
{
  std::mt19937 random(1);
  Eigen::VectorXd rough(smooth.size());
  for (double &value : rough) value = random() / 4294967296.0 - 0.5;
  const auto rounded = [](double value) { return std::round(value * 128) / 128; };   // the same on all machines
  MomentIteration m;
  m.largest = rounded(1.05 * ritz_values(hinge, range, rough, 16).tail(1)[0]);
  m.least = std::clamp(rounded(ritz_values(hinge, range, smooth, 8)[0]), m.largest / 64, m.largest / 2);
  const double root = std::sqrt(m.largest / m.least), rate = (root - 1) / (root + 1);
  m.count = std::clamp(static_cast<int>(std::ceil(std::log(moment_error) / std::log(rate))) - 1, fewest_iterations,
                       most_iterations);
  return m;
}

/// Whether the edge of a hinge runs from its node 0 to its node 1 in the winding of a triangle.
bool runs_along(const RestTriangle &t, const RestHinge &h)
{
  for (int k = 0; k < 3; ++k)
    if (t.node[k] == h.node[0]) return t.node[(k + 1) % 3] == h.node[1];
  return true;
}

/// 1 or -1 for each hinge: what makes the signs of its angle and of its neighbours' those of one side of the cloth,
/// whichever way the triangles wind.
std::vector<int> sides(const Topology &t)
{
  std::vector<std::vector<int>> hinges(t.triangle.size());
  for (std::size_t i = 0; i < t.hinge.size(); ++i)
    for (int f : t.hinge[i].triangle) hinges[f].push_back(static_cast<int>(i));
  std::vector<int> side(t.triangle.size(), 0), of_hinge(t.hinge.size());
  std::vector<int> queue;
  for (std::size_t start = 0; start < t.triangle.size(); ++start) {
    if (side[start]) continue;
    side[start] = 1;
    queue.assign(1, static_cast<int>(start));
    while (!queue.empty()) {
      const int f = queue.back();
      queue.pop_back();
      for (int i : hinges[f]) {
        const RestHinge &h = t.hinge[i];
        const int other = h.triangle[h.triangle[0] == f];
        if (side[other]) continue;
        side[other] = runs_along(t.triangle[f], h) == runs_along(t.triangle[other], h) ? -side[f] : side[f];
        queue.push_back(other);
      }
    }
  }
  for (std::size_t i = 0; i < t.hinge.size(); ++i) {
    const int f = t.hinge[i].triangle[0];
    of_hinge[i] = runs_along(t.triangle[f], t.hinge[i]) ? side[f] : -side[f];
  }
  return of_hinge;
}

}  // namespace

PlateStiffness plate_stiffness(const Material &m)
{
  const std::array<double, 3> k = unbent_rows(m);
  // A row is the direction of the fold line: the first row bends the weft.
  const double d11 = k[2] / hinge_per_plate, d22 = k[0] / hinge_per_plate, bias = k[1] / hinge_per_plate;
  const std::array<double, 4> &s = m.stretching[0];
  const double between = s[0] * s[2] > 0 && !m.has_table() ? s[1] / std::sqrt(s[0] * s[2]) : 0;
  const double d12 = std::clamp(between, -0.9, 0.9) * std::sqrt(d11 * d22);
  // At 45 degrees a cylinder has the curvatures 1/2, 1/2 and a twist of 1/2: (D11 + D22 + 2 D12 + 2 D33) / 4.
  const double d33 = std::max(0.5 * (4 * bias - d11 - d22 - 2 * d12), 0.1 * std::sqrt(d11 * d22));
  return {d11, d12, d22, d33};
}

std::vector<std::vector<MomentStep>> moment_steps(const std::vector<MomentIteration> &iteration)
{
  int longest = 0;
  for (const MomentIteration &m : iteration) longest = std::max(longest, m.count);
  std::vector<std::vector<MomentStep>> steps(longest + 1, std::vector<MomentStep>(iteration.size()));
  for (std::size_t c = 0; c < iteration.size(); ++c) {
    const MomentIteration &m = iteration[c];
    const double middle = 0.5 * (m.largest + m.least), half = 0.5 * (m.largest - m.least);
    double rho = half / middle;
    steps[0][c].share = 2 / (m.least + m.largest);
    for (int k = 0; k < m.count; ++k) {
      const double next = 1 / (2 * middle / half - rho);
      steps[k + 1][c] = {next * rho, 2 * next / half};
      rho = next;
    }
  }
  return steps;
}

Plate couple_hinges(const Scene &scene, const Topology &t)
{
  std::vector<Eigen::Matrix3d> compliance;
  std::vector<std::array<double, 3>> rows;
  for (const Cloth &cloth : scene.cloths) {
    rows.push_back(unbent_rows(cloth.material));
    compliance.push_back(bending_compliance(cloth.material));
  }
  // What meets at each triangle: the first hinge on each edge. More than one of an edge of three faces do not couple.
  std::vector<std::array<int, 3>> first(t.triangle.size(), {-1, -1, -1});
  const auto corner_of = [&](const RestHinge &h, int side) {
    const auto &node = t.triangle[h.triangle[side]].node;
    return static_cast<int>(std::find(node.begin(), node.end(), h.node[2 + side]) - node.begin());
  };
  for (std::size_t i = 0; i < t.hinge.size(); ++i)
    for (int side = 0; side < 2; ++side) {
      int &slot = first[t.hinge[i].triangle[side]][corner_of(t.hinge[i], side)];
      if (slot < 0) slot = static_cast<int>(i);
    }
  Plate plate;
  std::vector<double> diagonal(t.hinge.size()), least(t.hinge.size());
  Eigen::VectorXd smooth = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(t.hinge.size()));
  for (std::size_t i = 0; i < t.hinge.size(); ++i) {
    const RestHinge &h = t.hinge[i];
    HingeCoupling c;
    c.neighbour.fill(static_cast<int>(i));
    c.cloth = h.material;
    for (int side = 0; side < 2; ++side) {
      const int f = h.triangle[side], corner = corner_of(h, side);
      const LocalCompliance local = local_compliance(t.triangle[f], compliance[h.material]);
      diagonal[i] += local.value(corner, corner);
      least[i] += local.least * local.value(corner, corner);
      smooth[static_cast<Eigen::Index>(i)] += local.value.row(corner).sum();
      if (first[f][corner] != static_cast<int>(i)) continue;
      for (int k = 1; k < 3; ++k) {
        const int other = (corner + k) % 3;
        if (first[f][other] < 0) continue;
        c.neighbour[2 * side + k - 1] = first[f][other];
        c.coupling[2 * side + k - 1] = local.value(corner, other);
      }
    }
    c.reference = reference_of(scene.cloths[h.material].material, rows[h.material], h);
    plate.hinge.push_back(c);
  }
  const std::vector<int> side = sides(t);
  for (std::size_t i = 0; i < t.hinge.size(); ++i) {
    HingeCoupling &c = plate.hinge[i];
    // Rounded to single precision, so that set-up on another machine gives the same bits.
    for (int k = 0; k < 4; ++k)
      c.coupling[k] = static_cast<float>(side[i] * side[c.neighbour[k]] * c.coupling[k] /
                                         std::sqrt(diagonal[i] * diagonal[c.neighbour[k]]));
    c.scale = static_cast<float>(t.hinge[i].length / std::sqrt(diagonal[i]));
    smooth[static_cast<Eigen::Index>(i)] *= side[i] / std::sqrt(diagonal[i]);
  }
  plate.iteration.resize(scene.cloths.size());
  for (HingeRange range{0, 0}; range.first < t.hinge.size(); range.first = range.end) {
    const int cloth = t.hinge[range.first].material;
    while (range.end < t.hinge.size() && t.hinge[range.end].material == cloth) ++range.end;
    MomentIteration &iteration = plate.iteration[static_cast<std::size_t>(cloth)];
    iteration = moment_iteration(plate.hinge, range, smooth.segment(range.first, range.end - range.first));
    // What the iteration makes of the softest moment there can be.
    const double stiffest = (iteration.count + 1) / std::sqrt(iteration.least * iteration.largest);
    for (std::size_t i = range.first; i < range.end; ++i)
      plate.hinge[i].bound =
          static_cast<float>(bound_share * std::min(diagonal[i] / std::max(least[i], 1e-9 * diagonal[i]), stiffest));
  }
  plate.side = side;
  plate.opposite = std::move(first);
  return plate;
}

PlasticPlate plastic_plate(const Scene &scene, const Topology &t, const Plate &plate)
{
  PlasticPlate result;
  result.hinge.resize(t.hinge.size());
  for (std::size_t f = 0; f < t.triangle.size(); ++f) {
    const RestTriangle &r = t.triangle[f];
    const Eigen::Matrix3d moment = triangle_moments(r),
                          curvature = moment * bending_compliance(scene.cloths[r.material].material);
    PlasticTriangle triangle{plate.opposite[f], {}};
    for (int k = 0; k < 3; ++k) {
      const int i = plate.opposite[f][k];
      if (i < 0) continue;
      const RestHinge &h = t.hinge[i];
      const double scale = plate.hinge[i].scale;
      auto &angle = result.hinge[i].angle[h.triangle[1] == static_cast<int>(f)];
      for (int c = 0; c < 3; ++c) {
        triangle.curvature[k][c] =
            static_cast<float>(plate.side[i] * scale * scale / h.length * curvature(k, c));  // as in couple_hinges
        angle[c] = static_cast<float>(plate.side[i] * r.area / h.length * moment(k, c));
      }
    }
    result.triangle.push_back(triangle);
  }
  return result;
}

}  // namespace cama
