// SPDX-License-Identifier: Apache-2.0
// Rigid obstacles that forces move: mass, pose and momentum.
#pragma once
#include <array>
#include <string>
#include <vector>

#include "cama/scene.hpp"
#include "cama/stream.hpp"
#include "model/life.hpp"

namespace cama {

/// Force and torque about the centre of mass, or their integrals over time.
struct BodyWrench {
  dvec3 force{0, 0, 0}, torque{0, 0, 0};
};

/// An obstacle that forces move. Torques and moments are about the centre of mass, unless they say otherwise.
class RigidBody {
public:
  /// number: among the bodies of the scene. first: vertex.
  RigidBody(int number, int obstacle, int first, const Obstacle &description);

  int obstacle, first, last;  // vertices [first, last)
  double mass;  // kg
  dvec3 rest_center;  // of mass, of the scene's vertices, m

  // At the start of the step.
  dvec3 center, velocity;  // m, m/s
  std::array<double, 4> rotation{1, 0, 0, 0};
  dvec3 angular_momentum;  // kg m^2/s
  dvec3 shift{0, 0, 0}, turn{0, 0, 0};  // m and rotation vector: by the last step, as BDF2 carries it on
  BodyWrench smooth;  // N s, N m s: what BDF2 carries on of the last step
  dvec3 smooth_moment{0, 0, 0};  // about the origin, N m s
  BodyWrench load;  // N, N m: mean of the last step

  // In the step: the impulse of the cloth that its motion reckons with, and that motion.
  BodyWrench impulse;  // N s, N m s
  dvec3 center_next{0, 0, 0}, turn_next{0, 0, 0};
  std::array<double, 4> rotation_next{1, 0, 0, 0};
  BodyWrench contact;  // N s, N m s: what other bodies and obstacles give it
  bool touching = false;  // it touches them: the step is one of backward Euler
  dvec3 contact_force{0, 0, 0};  // N: mean of `contact` over the step

  SymmetricMatrix inertia(const std::array<double, 4> &at) const;  ///< along the axes of the scene, kg m^2
  dvec3 angular_velocity(const std::array<double, 4> &at, const dvec3 &momentum) const;  ///< rad/s
  /// The motion of the step under `impulse`, `contact` and gravity: over the time step and the implicit step, s, with
  /// the share `memory` of that in the last step. Returns false if the body turns too fast for such a step.
  bool move(double time_step, double implicit_step, double memory, const dvec3 &gravity);
  dvec3 velocity_next(double time_step, const dvec3 &gravity) const;  ///< m/s, under `impulse`, `contact` and gravity
  dvec3 spin_next() const;  ///< angular velocity in `rotation_next`, rad/s, under `impulse` and `contact`
  /// The pose of the scene's vertices with the centre of mass and the rotation there.
  RigidTransform pose(const dvec3 &center_there, const std::array<double, 4> &rotation_there) const;
  RigidTransform pose_next() const { return pose(center_next, rotation_next); }  ///< at the end of the step

  /// Calls f(name, life, value) for every number.
  template <class F> void visit(F &&f)
  {
    std::size_t next = 0;
    const auto number = [&](Life life, double &value) { f(names_[next++].c_str(), life, value); };
    const auto vector = [&](Life life, dvec3 &v) {
      for (double *x : {&v.x, &v.y, &v.z}) number(life, *x);
    };
    for (dvec3 *v : {&center, &velocity, &angular_momentum, &shift, &turn, &smooth.force, &smooth.torque,
                     &smooth_moment, &load.force, &load.torque})
      vector(Life::run, *v);
    for (double &x : rotation) number(Life::run, x);
    for (dvec3 *v : {&impulse.force, &impulse.torque, &center_next, &turn_next, &contact.force, &contact.torque})
      vector(Life::step, *v);
    for (double &x : rotation_next) number(Life::step, x);
  }

private:
  SymmetricMatrix inertia_, inverse_;  // along the axes of the body
  std::vector<std::string> names_;
};

/// The rigid bodies of a scene.
struct RigidState {
  std::vector<RigidBody> body;
  Stream<int> vertex;  // [vertices] 1: of a body; without bodies empty
  dvec3 gravity{0, 0, 0};  // m/s^2, in the step

  template <class F> void visit(F &&f)
  {
    f("rigid.vertex", Life::scene, vertex);
    if (body.empty()) return;
    f("rigid.gravity.x", Life::step, gravity.x);
    f("rigid.gravity.y", Life::step, gravity.y);
    f("rigid.gravity.z", Life::step, gravity.z);
    for (RigidBody &b : body) b.visit(f);
  }
};

}  // namespace cama
