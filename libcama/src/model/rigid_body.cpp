// SPDX-License-Identifier: Apache-2.0
#include "model/rigid_body.hpp"

#include <algorithm>
#include <cmath>

#include "scene/rigid.hpp"
#include "scene/shapes/quaternion.hpp"

namespace cama {
namespace {

constexpr int max_turns = 60;
constexpr double turn_tolerance = 1e-13;  // rad, for angles up to one, else relative

dvec3 product(const SymmetricMatrix &m, const dvec3 &v)
{
  return {m[0] * v.x + m[3] * v.y + m[5] * v.z, m[3] * v.x + m[1] * v.y + m[4] * v.z,
          m[5] * v.x + m[4] * v.y + m[2] * v.z};
}

SymmetricMatrix inverse_of(const SymmetricMatrix &m)
{
  const double a = m[1] * m[2] - m[4] * m[4], b = m[4] * m[5] - m[3] * m[2], c = m[3] * m[4] - m[1] * m[5],
               determinant = m[0] * a + m[3] * b + m[5] * c;
  return {a / determinant, (m[0] * m[2] - m[5] * m[5]) / determinant, (m[0] * m[1] - m[3] * m[3]) / determinant,
          b / determinant, (m[3] * m[5] - m[0] * m[4]) / determinant, c / determinant};
}

Quaternion conjugate(const Quaternion &q) { return {q[0], -q[1], -q[2], -q[3]}; }

}  // namespace

RigidBody::RigidBody(int number, int obstacle_index, int first_vertex, const Obstacle &description)
    : obstacle(obstacle_index), first(first_vertex),
      last(first_vertex + static_cast<int>(description.mesh.position.size()))
{
  const MassProperties p = mass_properties(description);
  mass = p.mass;
  rest_center = center = center_next = p.center;
  velocity = description.rigid->velocity;
  inertia_ = p.inertia;
  inverse_ = inverse_of(p.inertia);
  angular_momentum = product(inertia_, description.rigid->angular_velocity);
  const std::string name = "rigid." + std::to_string(number) + ".";
  const auto add = [&](const char *quantity, const char *components) {
    for (const char *c = components; *c; ++c) names_.push_back(name + quantity + "." + *c);
  };
  for (const char *quantity : {"center", "velocity", "angular_momentum", "shift", "turn", "smooth_force",
                               "smooth_torque", "smooth_moment", "load_force", "load_torque"})
    add(quantity, "xyz");
  add("rotation", "wxyz");
  for (const char *quantity :
       {"impulse_force", "impulse_torque", "center_next", "turn_next", "contact_force", "contact_torque"})
    add(quantity, "xyz");
  add("rotation_next", "wxyz");
}

SymmetricMatrix RigidBody::inertia(const std::array<double, 4> &at) const
{
  const Quaternion back = conjugate(at);
  const auto column = [&](const dvec3 &axis) { return rotate(at, product(inertia_, rotate(back, axis))); };
  const dvec3 x = column({1, 0, 0}), y = column({0, 1, 0}), z = column({0, 0, 1});
  return {x.x, y.y, z.z, x.y, y.z, z.x};
}

dvec3 RigidBody::angular_velocity(const std::array<double, 4> &at, const dvec3 &momentum) const
{
  return rotate(at, product(inverse_, rotate(conjugate(at), momentum)));
}

dvec3 RigidBody::velocity_next(double time_step, const dvec3 &gravity) const
{
  const dvec3 v = kernels::daxpy(kernels::daxpy(velocity, time_step, gravity), 1 / mass, impulse.force);
  return touching ? kernels::daxpy(v, 1 / mass, contact.force) : v;
}

dvec3 RigidBody::spin_next() const
{
  const dvec3 momentum = kernels::dadd(angular_momentum, impulse.torque);
  return angular_velocity(rotation_next, touching ? kernels::dadd(momentum, contact.torque) : momentum);
}

bool RigidBody::move(double time_step, double implicit_step, double memory, const dvec3 &gravity)
{
  if (touching) {
    implicit_step = time_step;
    memory = 0;
  }
  center_next = kernels::daxpy(kernels::daxpy(center, memory, shift), implicit_step, velocity_next(time_step, gravity));
  // The angular velocity belongs to the rotation at the end of the step.
  rotation_next = rotation;
  turn_next = {0, 0, 0};
  for (int pass = 0; pass < max_turns; ++pass) {
    const dvec3 before = turn_next;
    turn_next = kernels::daxpy(kernels::dscale(memory, turn), implicit_step, spin_next());
    const double angle = kernels::dnorm(turn_next);
    rotation_next = normalized(multiply(axis_angle(turn_next, angle), rotation));
    if (kernels::dnorm(kernels::dsub(turn_next, before)) <= turn_tolerance * std::max(angle, 1.0)) return true;
  }
  return false;
}

RigidTransform RigidBody::pose(const dvec3 &center_there, const std::array<double, 4> &rotation_there) const
{
  RigidTransform t;
  t.translation = kernels::dsub(center_there, rest_center);
  t.rotation = rotation_there;
  t.center = rest_center;
  return t;
}

}  // namespace cama
