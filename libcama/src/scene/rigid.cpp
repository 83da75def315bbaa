// SPDX-License-Identifier: Apache-2.0
#include "scene/rigid.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>

#include "cama/error.hpp"

namespace cama {
namespace {

constexpr double rounding = 1e-9;  // of a principal moment, by which it may exceed the sum of the others
constexpr double flat = 1e-12;  // of the cube of its size: the volume of a mesh without one

/// Throws MeshError unless every edge has a face on either side, with the same orientation.
void check_closed(const std::string &object, const Mesh &mesh)
{
  std::map<std::array<int, 2>, int> balance;
  for (const Triangle &f : mesh.face)
    for (int k = 0; k < 3; ++k) {
      const int a = f[static_cast<std::size_t>(k)], b = f[static_cast<std::size_t>((k + 1) % 3)];
      balance[{std::min(a, b), std::max(a, b)}] += a < b ? 1 : -1;
    }
  for (const auto &[edge, count] : balance)
    if (count != 0)
      throw MeshError("mesh of " + object + ": it is open, or faces are turned differently, at the edge of vertices " +
                      std::to_string(edge[0]) + " and " + std::to_string(edge[1]) +
                      "; close it, or give rigid a mass, a center and an inertia");
}

bool finite(const dvec3 &v) { return std::isfinite(v.x + v.y + v.z); }

[[noreturn]] void refuse(const std::string &object, const char *field, const std::string &what)
{
  throw SceneError(object + ": rigid" + field + ": " + what);
}

void check_inertia(const std::string &object, const SymmetricMatrix &m)
{
  for (double x : m)
    if (!std::isfinite(x)) refuse(object, ".inertia", "has a value that is not finite");
  Eigen::Matrix3d full;
  full << m[0], m[3], m[5], m[3], m[1], m[4], m[5], m[4], m[2];
  const Eigen::Vector3d moment =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(full, Eigen::EigenvaluesOnly).eigenvalues();
  if (!(moment[0] > 0)) refuse(object, ".inertia", "is not positive definite; give xx, yy, zz, xy, yz, zx in kg m^2");
  if (moment[2] > (moment[0] + moment[1]) * (1 + rounding))
    refuse(object, ".inertia", "is of no body: a principal moment is larger than the sum of the other two");
}

}  // namespace

MassProperties solid_properties(const std::string &object, const Mesh &mesh, double density)
{
  check_closed(object, mesh);
  const dvec3 origin = mesh.position.empty() ? dvec3{0, 0, 0} : mesh.position.front();
  double volume = 0, size = 0;
  std::array<double, 3> first{};
  SymmetricMatrix second{};  // integrals of x x, y y, z z, x y, y z, z x
  for (const Triangle &f : mesh.face) {
    std::array<std::array<double, 3>, 3> x;
    for (std::size_t k = 0; k < 3; ++k) {
      const dvec3 p = kernels::dsub(mesh.position[static_cast<std::size_t>(f[k])], origin);
      x[k] = {p.x, p.y, p.z};
      size = std::max(size, kernels::dnorm(p));
    }
    const auto &[a, b, c] = x;
    // The tetrahedron of the face and the origin has this volume; the integrals over it are sums over its corners.
    const double part =
        (a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])) /
        6;
    volume += part;
    for (std::size_t k = 0; k < 3; ++k) first[k] += part * (a[k] + b[k] + c[k]) / 4;
    constexpr std::array<std::array<std::size_t, 2>, 6> axes{{{0, 0}, {1, 1}, {2, 2}, {0, 1}, {1, 2}, {2, 0}}};
    for (std::size_t k = 0; k < 6; ++k) {
      const auto [i, j] = axes[k];
      second[k] += part * ((a[i] + b[i] + c[i]) * (a[j] + b[j] + c[j]) + a[i] * a[j] + b[i] * b[j] + c[i] * c[j]) / 20;
    }
  }
  if (!(std::abs(volume) > flat * size * size * size))
    throw MeshError("mesh of " + object + ": it encloses no volume; give rigid a mass, a center and an inertia");
  MassProperties p;
  p.mass = density * std::abs(volume);
  const std::array<double, 3> c{first[0] / volume, first[1] / volume, first[2] / volume};
  p.center = kernels::dadd(origin, {c[0], c[1], c[2]});
  const double d = volume < 0 ? -density : density;
  const double xx = d * (second[0] - volume * c[0] * c[0]), yy = d * (second[1] - volume * c[1] * c[1]),
               zz = d * (second[2] - volume * c[2] * c[2]);
  p.inertia = {yy + zz,
               zz + xx,
               xx + yy,
               -d * (second[3] - volume * c[0] * c[1]),
               -d * (second[4] - volume * c[1] * c[2]),
               -d * (second[5] - volume * c[2] * c[0])};
  return p;
}

MassProperties mass_properties(const Obstacle &o)
{
  const std::string object = "obstacle \"" + o.name + "\"";
  const Rigid &r = *o.rigid;
  if (o.shape != ObstacleShape::mesh && o.shape != ObstacleShape::box)
    refuse(object, "", "needs a mesh or a box; mesh the exact shape");
  if (!o.motion.is_static() || !o.motion.keys.empty() || o.motion.sampled)
    refuse(object, "", "has a motion; a rigid body moves by forces, so give one of rigid and motion");
  if (!(std::isfinite(r.mass) && r.mass >= 0) || !(std::isfinite(r.density) && r.density >= 0) ||
      (r.mass > 0) == (r.density > 0))
    refuse(object, "",
           "has mass " + std::to_string(r.mass) + " kg and density " + std::to_string(r.density) +
               " kg/m^3; give one of them, greater than 0");
  if (r.center && !finite(*r.center)) refuse(object, ".center", "is not finite");
  if (!finite(r.velocity)) refuse(object, ".velocity", "is not finite");
  if (!finite(r.angular_velocity)) refuse(object, ".angular_velocity", "is not finite");
  if (r.inertia) check_inertia(object, *r.inertia);
  if (r.center && r.inertia && r.mass > 0) return {r.mass, *r.center, *r.inertia};
  MassProperties p = solid_properties(object, o.mesh, r.density > 0 ? r.density : 1);
  if (r.mass > 0) {
    for (double &x : p.inertia) x *= r.mass / p.mass;
    p.mass = r.mass;
  }
  if (r.center) {  // Steiner
    const dvec3 c = kernels::dsub(*r.center, p.center);
    const double m = p.mass, cc = kernels::ddot(c, c);
    const SymmetricMatrix shift{cc - c.x * c.x, cc - c.y * c.y, cc - c.z * c.z, -c.x * c.y, -c.y * c.z, -c.z * c.x};
    for (std::size_t k = 0; k < 6; ++k) p.inertia[k] += m * shift[k];
    p.center = *r.center;
  }
  if (r.inertia) p.inertia = *r.inertia;
  check_inertia(object, p.inertia);
  return p;
}

}  // namespace cama
