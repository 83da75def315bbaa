// SPDX-License-Identifier: Apache-2.0
#include "stages/rigid_zones.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>

namespace cama {
namespace {

constexpr int max_rotations = 200;
constexpr double rotation_tolerance = 1e-15;  // rad

/// Sets of cloth vertices that impacts connect.
class Components {
public:
  explicit Components(int n) : parent_(static_cast<std::size_t>(n)) { std::iota(parent_.begin(), parent_.end(), 0); }
  int root(int v)
  {
    while (parent_[v] != v) v = parent_[v] = parent_[parent_[v]];
    return v;
  }
  void join(int a, int b)
  {
    a = root(a);
    b = root(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

private:
  std::vector<int> parent_;
};

struct RigidMotion {
  dvec3 from, to;               // centres
  std::array<dvec3, 3> column;  // of the rotation

  dvec3 operator()(dvec3 x) const
  {
    const dvec3 r = dsub(x, from);
    return dadd(to, dadd(dscale(r.x, column[0]), dadd(dscale(r.y, column[1]), dscale(r.z, column[2]))));
  }
};

dvec3 rotated(dvec3 v, dvec3 axis, double angle)
{
  const double c = std::cos(angle), s = std::sin(angle);
  return dadd(dscale(c, v), dadd(dscale(s, dcross(axis, v)), dscale((1 - c) * ddot(axis, v), axis)));
}

/// The rotation nearest to the matrix with columns a (Müller et al. 2016, "A robust method to extract the rotational
/// part of deformations"), from the identity on: what the points do not determine does not rotate.
std::array<dvec3, 3> nearest_rotation(const std::array<dvec3, 3> &a)
{
  std::array<dvec3, 3> r{kernels::dvec3_make(1, 0, 0), kernels::dvec3_make(0, 1, 0), kernels::dvec3_make(0, 0, 1)};
  for (int k = 0; k < max_rotations; ++k) {
    dvec3 turn = kernels::dvec3_make(0, 0, 0);
    double fit = 0;
    for (int i = 0; i < 3; ++i) {
      turn = dadd(turn, dcross(r[i], a[i]));
      fit += ddot(r[i], a[i]);
    }
    if (!(fit != 0)) break;
    turn = dscale(1 / std::abs(fit), turn);
    const double angle = dnorm(turn);
    if (!(angle > rotation_tolerance)) break;
    for (dvec3 &column : r) column = rotated(column, dscale(1 / angle, turn), angle);
  }
  r[0] = dnormalize(r[0]);
  r[1] = dnormalize(dsub(r[1], dscale(ddot(r[0], r[1]), r[0])));
  r[2] = dcross(r[0], r[1]);
  return r;
}

struct Sample {
  double weight;
  dvec3 from, to;
};

RigidMotion fitted(const std::vector<Sample> &samples)
{
  RigidMotion m{kernels::dvec3_make(0, 0, 0), kernels::dvec3_make(0, 0, 0), {}};
  double total = 0;
  for (const Sample &s : samples) {
    total += s.weight;
    m.from = dadd(m.from, dscale(s.weight, s.from));
    m.to = dadd(m.to, dscale(s.weight, s.to));
  }
  m.from = dscale(1 / total, m.from);
  m.to = dscale(1 / total, m.to);
  std::array<dvec3, 3> moments{kernels::dvec3_make(0, 0, 0), kernels::dvec3_make(0, 0, 0),
                               kernels::dvec3_make(0, 0, 0)};
  for (const Sample &s : samples) {
    const dvec3 a = dsub(s.from, m.from), b = dscale(s.weight, dsub(s.to, m.to));
    moments[0] = dadd(moments[0], dscale(a.x, b));
    moments[1] = dadd(moments[1], dscale(a.y, b));
    moments[2] = dadd(moments[2], dscale(a.z, b));
  }
  m.column = nearest_rotation(moments);
  return m;
}

}  // namespace

void move_rigid_zones(const Access<const MeshState, const ContactState> &state, const Stream<dvec3> &from,
                      const Stream<dvec3> &wanted, Stream<dvec3> &positions, Stream<int> &moved)
{
  const MeshState &mesh = state.mesh;
  const std::vector<kernels::impact> impacts = state.contact.impact.download();
  const std::vector<double> inverse_mass = mesh.inverse_mass.download();
  const std::vector<dvec3> start = from.download(), end = wanted.download();
  std::vector<dvec3> x = positions.download();
  std::vector<int> flag = moved.download();
  const auto free = [&](int v) { return inverse_mass[v] > 0; };

  Components components(mesh.vertices);
  const auto each_impact = [&](auto &&visit) {
    for (const kernels::impact &i : impacts) {
      if (!i.repeated) continue;
      std::vector<int> cloth, others;
      for (int v : i.node) (free(v) ? cloth : others).push_back(v);
      if (!cloth.empty()) visit(cloth, others);
    }
  };
  each_impact([&](const std::vector<int> &cloth, const std::vector<int> &) {
    for (int v : cloth) components.join(cloth.front(), v);
  });
  std::map<int, std::vector<int>> zones, held;  // by root: free vertices of the zone; prescribed ones of its impacts
  each_impact([&](const std::vector<int> &cloth, const std::vector<int> &others) {
    const int root = components.root(cloth.front());
    zones[root].insert(zones[root].end(), cloth.begin(), cloth.end());
    if (!others.empty()) held[root].insert(held[root].end(), others.begin(), others.end());
  });
  const auto make_unique = [](std::vector<int> &list) {
    std::sort(list.begin(), list.end());
    list.erase(std::unique(list.begin(), list.end()), list.end());
  };
  for (auto &[root, vertices] : zones) {
    make_unique(vertices);
    std::vector<Sample> samples;
    if (const auto at = held.find(root); at != held.end()) {
      make_unique(at->second);
      for (int v : at->second) samples.push_back({1, start[v], end[v]});
    } else {
      for (int v : vertices) samples.push_back({1 / inverse_mass[v], start[v], end[v]});
    }
    const RigidMotion motion = fitted(samples);
    for (int v : vertices) {
      flag[v] = 1;
      x[v] = motion(start[v]);
    }
  }
  positions.assign(x);
  moved.assign(flag);
}

}  // namespace cama
