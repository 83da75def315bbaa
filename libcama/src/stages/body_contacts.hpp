// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>
#include <string>
#include <vector>

#include "model/access.hpp"
#include "solver/contact_impulses.hpp"
#include "stages/meetings.hpp"

namespace cama {

class PrescribedMotion;

/// Contact of rigid bodies with each other and with all other obstacles, on the host.
class BodyContacts {
public:
  using Rooms = Access<const Clock, const MeshState, RigidState>;

  /// Throws CollisionError for bodies that overlap something at the start; with `exempt` they pass through it.
  BodyContacts(const Scene &scene, const MeshState &mesh, bool exempt);
  /// Whether a scene has anything that bodies can touch but cloth.
  static bool needed(const Scene &scene);
  void follow(const PrescribedMotion &motion) { motion_ = &motion; }

  /// Forgets the contacts of the last step.
  void begin_step(RigidState &rigid);
  /// Moves the bodies by the impulses that they have, and by those of contact, which it finds. Throws SolverError if a
  /// body turns too fast, or if it is squeezed.
  void move(const Rooms &state);
  /// Moves one as if it could touch nothing but cloth. Throws SolverError.
  static void move_alone(const Rooms &state, RigidBody &body);
  /// Finds the impulses of contact again, for other impulses [bodies] of the cloth, and sets these; poses stay.
  void finish(const Rooms &state, const std::vector<BodyWrench> &impulses);

private:
  struct Object {
    Object(const std::string &its_name, const Obstacle &its_description, const ContactProperties &its_properties,
           int its_body, int its_obstacle);

    std::string name;  // "obstacle 'ball'"
    Obstacle description;
    ContactProperties properties;
    int body, obstacle;  // body: -1 if it is none
    std::unique_ptr<ContactShape> shape;
    std::unique_ptr<PlacedShape> placed;
    dvec3 middle{0, 0, 0};  // of a sphere around the vertices as they are in the scene
    double extent = 0;  // its radius with that of the shape
    bool deforms = false;  // by a vertex animation
    bool fitted = false;  // it stands still, and its boxes are known
    bool placed_now = false;  // in this step
  };
  struct Pair {
    int a, b;  // objects; a is a body
    double gap, friction, static_friction;
  };
  struct Contact {
    int pair;
    Meeting meeting;
    dvec3 lever_a, lever_b;
    double allowed;  // m: 0, or below it where the sides are nearer than the gap at the start
    double room = 0;  // m that the sides are apart beyond the gap at the end of the step
    double press = 0;
    dvec3 rub{0, 0, 0};
    bool slides = false;
  };

  void make_shape(Object &object);
  void place(Object &object, const Rooms &state);
  void place_bodies(const RigidState &rigid);
  ContactTree::Box bounds(Object &object, const Rooms &state);
  bool near(const Pair &pair, const Rooms &state);
  void find_near(const Rooms &state);
  void look(const RigidState &rigid);
  void add(int pair, const Meeting &meeting, const RigidState &rigid);
  void measure();
  bool touch(RigidState &rigid) const;
  std::vector<MovableBody> movable(const RigidState &rigid) const;
  std::vector<ContactPoint> points(const Rooms &state, const std::vector<MovableBody> &pushed,
                                   const std::vector<MovableBody> &change) const;
  void solve(const Rooms &state, const std::vector<MovableBody> &change);
  void settle(const Rooms &state);
  bool add_crossings(const RigidState &rigid);
  void part(RigidState &rigid);
  void stop_before_crossing(const Rooms &state);

  const PrescribedMotion *motion_ = nullptr;
  std::vector<Object> objects_;
  std::vector<Pair> pairs_;
  std::vector<int> near_;  // pairs
  std::vector<Contact> contacts_;
};

}  // namespace cama
