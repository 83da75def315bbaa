// SPDX-License-Identifier: Apache-2.0
// A human-like body without data files: a smooth union of round cones, meshed by surface nets, skinned to thirteen
// bones, walking in place.
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>

#include "cama/error.hpp"
#include "cama/generators.hpp"
#include "scene/constants.hpp"
#include "scene/shapes/quaternion.hpp"

namespace cama {
namespace {

using namespace kernels;

enum Bone {
  pelvis,
  spine,
  head,
  arm_left,
  forearm_left,
  arm_right,
  forearm_right,
  thigh_left,
  shin_left,
  foot_left,
  thigh_right,
  shin_right,
  foot_right,
  bone_count
};

/// The flesh of one bone: a segment with a radius at each end.
struct Part {
  Bone bone;
  dvec3 a, b;
  double ra, rb;
};

dvec3 mirrored(const dvec3 &x) { return {-x.x, x.y, x.z}; }

const dvec3 hip{0.095, 0, 0.92}, knee{0.112, -0.006, 0.5}, ankle{0.122, 0.014, 0.085}, toe{0.132, -0.125, 0.038};
const dvec3 shoulder{0.185, 0.005, 1.385};
const double arm_angle = 52 * degree;   // from the vertical, at rest
const dvec3 elbow = daxpy(shoulder, 0.27, {std::sin(arm_angle), 0, -std::cos(arm_angle)});
const dvec3 hand = daxpy(shoulder, 0.53, {std::sin(arm_angle), -0.04, -std::cos(arm_angle)});

std::vector<Part> body_parts()
{
  std::vector<Part> p{{pelvis, {-0.068, 0, 0.945}, {0.068, 0, 0.945}, 0.112, 0.112},
                      {spine, {-0.05, 0.002, 1.1}, {0.05, 0.002, 1.1}, 0.098, 0.098},
                      {spine, {-0.075, 0, 1.27}, {0.075, 0, 1.27}, 0.112, 0.112},
                      {spine, {-0.145, 0.005, 1.39}, {0.145, 0.005, 1.39}, 0.06, 0.06},
                      {head, {0, 0.005, 1.45}, {0, -0.005, 1.52}, 0.055, 0.055},
                      {head, {0, -0.015, 1.575}, {0, -0.015, 1.61}, 0.085, 0.085}};
  const std::vector<Part> left{{arm_left, shoulder, elbow, 0.05, 0.041},
                               {forearm_left, elbow, hand, 0.04, 0.032},
                               {thigh_left, hip, knee, 0.09, 0.06},
                               {shin_left, knee, ankle, 0.057, 0.042},
                               {foot_left, ankle, toe, 0.045, 0.035}};
  for (const Part &l : left) {
    p.push_back(l);
    const Bone other = static_cast<Bone>(l.bone < thigh_left ? l.bone + 2 : l.bone + 3);
    p.push_back({other, mirrored(l.a), mirrored(l.b), l.ra, l.rb});
  }
  return p;
}

double part_distance(const Part &p, const dvec3 &x)
{
  const dvec3 d = dsub(p.b, p.a), e = dsub(x, p.a);
  const double t = clamp_double(ddot(d, e) / ddot(d, d), 0, 1);
  return dnorm(daxpy(e, -t, d)) - (p.ra + t * (p.rb - p.ra));
}

double body_distance(const std::vector<Part> &parts, const dvec3 &x)
{
  double d = 1e9;
  for (const Part &p : parts) {
    const double e = part_distance(p, x), k = p.bone >= thigh_left ? 0.03 : 0.05,
                 h = std::max(k - std::abs(d - e), 0.0) / k;
    d = std::min(d, e) - 0.25 * h * h * k;   // polynomial smooth union
  }
  return d;
}

dvec3 gradient(const std::vector<Part> &parts, const dvec3 &x)
{
  const double h = 1e-4;
  const auto f = [&](double a, double b, double c) { return body_distance(parts, {x.x + a, x.y + b, x.z + c}); };
  return dscale(0.5 / h, {f(h, 0, 0) - f(-h, 0, 0), f(0, h, 0) - f(0, -h, 0), f(0, 0, h) - f(0, 0, -h)});
}

/// Surface nets: a vertex in every cell that the surface crosses, a quadrilateral around every crossed grid edge.
Mesh surface_net(const std::function<double(const dvec3 &)> &distance, const dvec3 &lo, const dvec3 &hi, double cell)
{
  const std::array<int, 3> n{static_cast<int>(std::ceil((hi.x - lo.x) / cell)) + 1,
                             static_cast<int>(std::ceil((hi.y - lo.y) / cell)) + 1,
                             static_cast<int>(std::ceil((hi.z - lo.z) / cell)) + 1};
  const auto at = [&](int i, int j, int k) { return (static_cast<std::size_t>(k) * n[1] + j) * n[0] + i; };
  const auto point = [&](int i, int j, int k) { return dvec3{lo.x + i * cell, lo.y + j * cell, lo.z + k * cell}; };
  std::vector<double> value(static_cast<std::size_t>(n[0]) * n[1] * n[2]);
  for (int k = 0; k < n[2]; ++k)
    for (int j = 0; j < n[1]; ++j)
      for (int i = 0; i < n[0]; ++i) value[at(i, j, k)] = distance(point(i, j, k));
  Mesh m;
  std::vector<int> vertex(value.size(), -1);
  for (int k = 0; k + 1 < n[2]; ++k)
    for (int j = 0; j + 1 < n[1]; ++j)
      for (int i = 0; i + 1 < n[0]; ++i) {
        dvec3 sum{0, 0, 0};
        int count = 0;
        for (int a = 0; a < 8; ++a)
          for (int axis = 0; axis < 3; ++axis) {
            if (a >> axis & 1) continue;
            const int b = a | 1 << axis, i0 = i + (a & 1), j0 = j + (a >> 1 & 1), k0 = k + (a >> 2), i1 = i + (b & 1),
                      j1 = j + (b >> 1 & 1), k1 = k + (b >> 2);
            const double f = value[at(i0, j0, k0)], g = value[at(i1, j1, k1)];
            if ((f < 0) == (g < 0)) continue;
            sum = dadd(sum, dlerp(point(i0, j0, k0), point(i1, j1, k1), f / (f - g)));
            ++count;
          }
        if (!count) continue;
        vertex[at(i, j, k)] = static_cast<int>(m.position.size());
        m.position.push_back(dscale(1.0 / count, sum));
      }
  for (int k = 1; k + 1 < n[2]; ++k)
    for (int j = 1; j + 1 < n[1]; ++j)
      for (int i = 1; i + 1 < n[0]; ++i)
        for (int axis = 0; axis < 3; ++axis) {
          const int di = axis == 0, dj = axis == 1, dk = axis == 2;
          const double f = value[at(i, j, k)], g = value[at(i + di, j + dj, k + dk)];
          if ((f < 0) == (g < 0)) continue;
          // u and v: the two other axes, in order.
          const int ui = axis == 2, uj = axis == 0, uk = axis == 1, vi = axis == 1, vj = axis == 2, vk = axis == 0;
          int q[4] = {vertex[at(i - ui - vi, j - uj - vj, k - uk - vk)], vertex[at(i - vi, j - vj, k - vk)],
                      vertex[at(i, j, k)], vertex[at(i - ui, j - uj, k - uk)]};
          if (f >= 0) std::swap(q[1], q[3]);   // outward
          const double across = dnorm(dsub(m.position[q[0]], m.position[q[2]])),
                       other = dnorm(dsub(m.position[q[1]], m.position[q[3]]));
          if (across <= other)
            m.face.insert(m.face.end(), {{q[0], q[1], q[2]}, {q[0], q[2], q[3]}});
          else
            m.face.insert(m.face.end(), {{q[0], q[1], q[3]}, {q[1], q[2], q[3]}});
        }
  return m;
}

std::vector<std::vector<int>> neighbours(const Mesh &m)
{
  std::vector<std::vector<int>> near(m.position.size());
  for (const auto &[a, b] : unique_edges(m.face)) {
    near[a].push_back(b);
    near[b].push_back(a);
  }
  return near;
}

/// Evens out the triangles, then projects vertices back to the surface.
void relax(Mesh &m, const std::vector<Part> &parts, const std::vector<std::vector<int>> &near)
{
  for (int round = 0; round < 6; ++round) {
    std::vector<dvec3> next = m.position;
    for (std::size_t v = 0; v < next.size(); ++v) {
      dvec3 mean{0, 0, 0};
      for (int u : near[v]) mean = daxpy(mean, 1.0 / static_cast<double>(near[v].size()), m.position[u]);
      dvec3 x = dlerp(m.position[v], mean, 0.5);
      for (int k = 0; k < 2; ++k) {
        const dvec3 g = gradient(parts, x);
        x = daxpy(x, -body_distance(parts, x) / std::max(ddot(g, g), 0.25), g);
      }
      next[v] = x;
    }
    m.position = std::move(next);
  }
}

using Weights = std::array<double, bone_count>;

std::vector<Weights> skin(const Mesh &m, const std::vector<Part> &parts, const std::vector<std::vector<int>> &near)
{
  std::vector<Weights> w(m.position.size());
  for (std::size_t v = 0; v < w.size(); ++v) {
    w[v].fill(0);
    double sum = 0;
    for (const Part &p : parts) {
      const double f = std::pow(0.01 + std::max(part_distance(p, m.position[v]), 0.0), -4.0);
      if (f > w[v][p.bone]) w[v][p.bone] = f;
    }
    for (double f : w[v]) sum += f;
    for (double &f : w[v]) f /= sum;
  }
  for (int round = 0; round < 8; ++round) {
    std::vector<Weights> next = w;
    for (std::size_t v = 0; v < w.size(); ++v)
      for (int b = 0; b < bone_count; ++b) {
        double mean = 0;
        for (int u : near[v]) mean += w[u][b];
        next[v][b] = 0.5 * w[v][b] + 0.5 * mean / static_cast<double>(near[v].size());
      }
    w = std::move(next);
  }
  return w;
}

struct Frame {
  Quaternion q{1, 0, 0, 0};
  dvec3 t{0, 0, 0};
};

Frame about(const dvec3 &pivot, const Quaternion &q) { return {q, dsub(pivot, rotate(q, pivot))}; }
Frame after(const Frame &a, const Frame &b) { return {multiply(a.q, b.q), dadd(rotate(a.q, b.t), a.t)}; }
Quaternion turn_x(double a) { return axis_angle({1, 0, 0}, a); }
Quaternion turn_y(double a) { return axis_angle({0, 1, 0}, a); }
Quaternion turn_z(double a) { return axis_angle({0, 0, 1}, a); }

/// Bones at a phase of the walk; `amount` 0 is the pose at rest, 1 the full walk. The body looks along -y.
std::array<Frame, bone_count> pose(double phase, double amount, double stride)
{
  const double s = std::sin(phase), c = std::cos(phase), swing = stride * degree * amount;
  const auto flex = [&](double x) { return 42 * degree * amount * std::max(0.0, x) * std::max(0.0, x); };
  std::array<Frame, bone_count> f;
  Frame root = about({0, 0, 0.95}, multiply(turn_z(5 * degree * amount * s), turn_y(2.5 * degree * amount * c)));
  root.t = dadd(root.t, {0.018 * amount * c, 0, -0.012 * amount * (1 - std::cos(2 * phase)) * 0.5});
  f[pelvis] = root;
  f[spine] =
      after(root, about({0, 0, 1.06}, multiply(turn_z(-8 * degree * amount * s), turn_y(-2 * degree * amount * c))));
  f[head] = after(f[spine], about({0, 0, 1.45}, turn_z(3 * degree * amount * s)));
  for (const double side : {1.0, -1.0}) {
    const auto place = [&](const dvec3 &x) { return side > 0 ? x : mirrored(x); };
    const int arm = side > 0 ? arm_left : arm_right, thigh = side > 0 ? thigh_left : thigh_right;
    const Quaternion lowered = turn_y(side * 13 * degree * amount);
    f[arm] = after(f[spine], about(place(shoulder), multiply(turn_x(side * 0.8 * swing * s), lowered)));
    f[arm + 1] = after(f[arm], about(place(elbow), turn_x(-12 * degree * amount * (1 - 0.5 * side * s))));
    f[thigh] = after(root, about(place(hip), turn_x(-side * swing * s)));
    f[thigh + 1] = after(f[thigh], about(place(knee), turn_x(flex(side * c) + 4 * degree * amount)));
    f[thigh + 2] =
        after(f[thigh + 1], about(place(ankle), turn_x(-0.5 * flex(side * c) + 6 * degree * amount * side * s)));
  }
  return f;
}

double eased(double t)
{
  t = clamp_double(t, 0, 1);
  return t * t * t * (10 + t * (6 * t - 15));
}

}  // namespace

Character make_walker(const Walker &w)
{
  if (!(w.height > 0) || !(w.cell > 0.004) || !(w.cell <= 0.1) || !(w.period > 0) || !(w.duration > 0) ||
      !(w.samples_per_second > 0))
    throw MeshError(
        "walker: height, period, duration and samples_per_second must be greater than 0 and cell from 0.004 to 0.1 m");
  const std::vector<Part> parts = body_parts();
  Character c;
  c.mesh = surface_net([&](const dvec3 &x) { return body_distance(parts, x); }, {-0.75, -0.3, -0.06}, {0.75, 0.3, 1.8},
                       w.cell);
  const auto near = neighbours(c.mesh);
  relax(c.mesh, parts, near);
  const std::vector<Weights> weight = skin(c.mesh, parts, near);
  const double scale = w.height / 1.7;
  if (!(w.duration * w.samples_per_second * static_cast<double>(c.mesh.position.size()) < most_sampled_positions))
    throw MeshError("walker: duration times samples_per_second is too much; give fewer of either, or a larger cell");
  const int count = std::max(1, static_cast<int>(std::ceil(w.duration * w.samples_per_second)));
  auto sampled = std::make_shared<Motion::Sampled>();
  for (int i = 0; i <= count; ++i) {
    const double t = w.duration * i / count;
    const auto frame = pose(2 * pi * std::max(0.0, t - w.rest) / w.period, eased((t - w.rest) / 0.9), w.stride);
    std::vector<dvec3> x(c.mesh.position.size());
    for (std::size_t v = 0; v < x.size(); ++v) {
      dvec3 sum{0, 0, 0};
      for (int b = 0; b < bone_count; ++b)
        if (weight[v][b] > 0) sum = daxpy(sum, weight[v][b], dadd(rotate(frame[b].q, c.mesh.position[v]), frame[b].t));
      x[v] = dscale(scale, sum);
    }
    sampled->time.push_back(t);
    sampled->position.push_back(std::move(x));
  }
  c.mesh.position = sampled->position.front();
  c.motion.sampled = std::move(sampled);
  c.duration = w.duration;
  return c;
}

}  // namespace cama
