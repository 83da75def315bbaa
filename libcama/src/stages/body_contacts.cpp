// SPDX-License-Identifier: Apache-2.0
#include "stages/body_contacts.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "cama/error.hpp"
#include "device/kernels.hpp"
#include "scene/shapes/quaternion.hpp"
#include "stages/prescribed_motion.hpp"

namespace cama {
namespace {

using kernels::dadd;
using kernels::daxpy;
using kernels::dcross;
using kernels::ddot;
using kernels::dlerp;
using kernels::dnorm;
using kernels::dscale;
using kernels::dsub;

constexpr int max_rounds = 20;
constexpr double tolerance = 1e-5;  // of the gap
constexpr double parted = 0.2;  // share of what sides are too near that a step parts them
constexpr double parted_from = 1e-3;  // of the gap
constexpr double same_place = 0.05;  // of the gap: contacts that say the same
constexpr double same_direction = 1e-3;  // rad
constexpr int max_crossings = 6;
constexpr int max_cuts = 8;
constexpr double kept = 0.9;  // of the way to a crossing

std::size_t number(int i) { return static_cast<std::size_t>(i); }

MovableBody still(const RigidBody &body)
{
  MovableBody m{};
  m.inverse_mass = 1 / body.mass;
  const dvec3 x = body.angular_velocity(body.rotation_next, {1, 0, 0}),
              y = body.angular_velocity(body.rotation_next, {0, 1, 0}),
              z = body.angular_velocity(body.rotation_next, {0, 0, 1});
  m.inverse_inertia = {x.x, y.y, z.z, x.y, y.z, z.x};
  return m;
}

dvec3 product(const SymmetricMatrix &m, const dvec3 &v)
{
  return {m[0] * v.x + m[3] * v.y + m[5] * v.z, m[3] * v.x + m[1] * v.y + m[4] * v.z,
          m[5] * v.x + m[4] * v.y + m[2] * v.z};
}

void push(MovableBody &body, const BodyWrench &wrench)
{
  body.velocity = daxpy(body.velocity, body.inverse_mass, wrench.force);
  body.spin = dadd(body.spin, product(body.inverse_inertia, wrench.torque));
}

dvec3 at(const MovableBody &body, const dvec3 &lever) { return dadd(body.velocity, dcross(body.spin, lever)); }

}  // namespace

void BodyContacts::move_alone(const Rooms &state, RigidBody &body)
{
  const Clock &time = state.time;
  if (body.move(time.step, time.implicit_step, time.memory, state.rigid.gravity)) return;
  throw SolverError(state.mesh.object_name[number(state.mesh.object_of(body.first))] +
                    " turns too fast for the time step; take a smaller one");
}

/// Switches bodies to the step of contact (RigidBody::touching) if a contact of theirs is closed or would be, and those
/// that they touch. Returns whether it has switched any.
bool BodyContacts::touch(RigidState &rigid) const
{
  bool any = false, again = true;
  const auto body = [&](int object) { return objects_[number(object)].body; };
  const auto set = [&](int index) {
    if (index < 0 || rigid.body[number(index)].touching) return;
    rigid.body[number(index)].touching = any = again = true;
  };
  for (const Contact &c : contacts_)
    if (c.press > 0 || c.room < c.allowed - tolerance * pairs_[number(c.pair)].gap) {
      set(body(pairs_[number(c.pair)].a));
      set(body(pairs_[number(c.pair)].b));
    }
  while (again) {
    again = false;
    for (const Contact &c : contacts_) {
      const int a = body(pairs_[number(c.pair)].a), b = body(pairs_[number(c.pair)].b);
      if (b < 0) continue;
      if (rigid.body[number(a)].touching) set(b);
      if (rigid.body[number(b)].touching) set(a);
    }
  }
  return any;
}

void BodyContacts::begin_step(RigidState &rigid)
{
  contacts_.clear();
  near_.clear();
  for (Object &o : objects_) o.placed_now = false;
  for (RigidBody &body : rigid.body) {
    body.touching = false;
    body.contact = {};
  }
}

void BodyContacts::place_bodies(const RigidState &rigid)
{
  for (Object &o : objects_) {
    if (o.body < 0) continue;
    const RigidBody &body = rigid.body[number(o.body)];
    const RigidTransform start = body.pose(body.center, body.rotation), end = body.pose_next();
    PlacedShape &p = *o.placed;
    p.start.resize(o.shape->rest.size());
    p.end.resize(o.shape->rest.size());
    for (std::size_t v = 0; v < p.start.size(); ++v) {
      p.start[v] = start.apply(o.shape->rest[v]);
      p.end[v] = end.apply(o.shape->rest[v]);
    }
    p.fit();
  }
}

void BodyContacts::add(int pair, const Meeting &meeting, const RigidState &rigid)
{
  const Pair &p = pairs_[number(pair)];
  const Object &a = objects_[number(p.a)], &b = objects_[number(p.b)];
  Contact c{};
  c.pair = pair;
  c.meeting = meeting;
  const auto where = [&](const Object &o, const Foot &foot) {
    return dlerp(foot.at(o.placed->start), foot.at(o.placed->end), meeting.time);
  };
  const dvec3 on_a = daxpy(where(a, meeting.a), -a.shape->radius, meeting.normal),
              on_b = daxpy(where(b, meeting.b), b.shape->radius, meeting.normal), point = dlerp(on_a, on_b, 0.5);
  const auto lever = [&](const Object &o) {
    if (o.body < 0) return dvec3{0, 0, 0};
    const RigidBody &body = rigid.body[number(o.body)];
    return dsub(point, dlerp(body.center, body.center_next, meeting.time));
  };
  c.lever_a = lever(a);
  c.lever_b = lever(b);
  for (const Contact &known : contacts_)  // of the same corner, say, with another face
    if (known.pair == pair && dnorm(dsub(known.lever_a, c.lever_a)) <= same_place * p.gap &&
        dnorm(dsub(known.meeting.normal, c.meeting.normal)) <= same_direction)
      return;
  const double room = ddot(meeting.normal, dsub(meeting.a.at(a.placed->start), meeting.b.at(b.placed->start))) -
                      a.shape->radius - b.shape->radius - p.gap;
  c.allowed = meeting.time == 0 ? std::min(room, 0.0) : 0;
  contacts_.push_back(c);
}

void BodyContacts::look(const RigidState &rigid)
{
  for (int pair : near_) {
    const Pair &p = pairs_[number(pair)];
    const MeetingSearch search(*objects_[number(p.a)].placed, *objects_[number(p.b)].placed, p.gap);
    for (const Meeting &m : search.meetings())
      if (std::none_of(contacts_.begin(), contacts_.end(),
                       [&](const Contact &c) { return c.pair == pair && c.meeting.key == m.key; }))
        add(pair, m, rigid);
  }
}

/// How far apart the sides of all contacts are at the end of the step.
void BodyContacts::measure()
{
  for (Contact &c : contacts_) {
    const Pair &p = pairs_[number(c.pair)];
    const Object &a = objects_[number(p.a)], &b = objects_[number(p.b)];
    c.room = ddot(c.meeting.normal, dsub(c.meeting.a.at(a.placed->end), c.meeting.b.at(b.placed->end))) -
             a.shape->radius - b.shape->radius - p.gap;
  }
}

/// The bodies as what contact has given them moves them.
std::vector<MovableBody> BodyContacts::movable(const RigidState &rigid) const
{
  std::vector<MovableBody> bodies;
  for (const RigidBody &body : rigid.body) {
    bodies.push_back(still(body));
    push(bodies.back(), body.contact);
  }
  return bodies;
}

/// change: of the bodies' motion since the contacts were measured.
std::vector<ContactPoint> BodyContacts::points(const Rooms &state, const std::vector<MovableBody> &pushed,
                                               const std::vector<MovableBody> &change) const
{
  const double h = state.time.step;
  std::vector<MovableBody> now;  // velocities
  for (const RigidBody &body : state.rigid.body) {
    now.push_back(still(body));
    now.back().velocity = body.velocity_next(h, state.rigid.gravity);
    now.back().spin = body.spin_next();
  }
  std::vector<ContactPoint> result;
  for (const Contact &c : contacts_) {
    const Pair &p = pairs_[number(c.pair)];
    const Object &a = objects_[number(p.a)], &b = objects_[number(p.b)];
    ContactPoint point{};
    point.a = a.body;
    point.b = b.body;
    point.normal = c.meeting.normal;
    point.lever_a = c.lever_a;
    point.lever_b = c.lever_b;
    point.friction = p.friction;
    point.static_friction = p.static_friction;
    const auto relative = [&](const std::vector<MovableBody> &bodies) {
      const dvec3 own = at(bodies[number(a.body)], c.lever_a);
      return b.body < 0 ? own : dsub(own, at(bodies[number(b.body)], c.lever_b));
    };
    dvec3 slip = dsub(relative(now), relative(pushed));
    if (b.body < 0) slip = daxpy(slip, -1 / h, dsub(c.meeting.b.at(b.placed->end), c.meeting.b.at(b.placed->start)));
    point.slip = slip;
    point.approach = (c.room - c.allowed) / h + ddot(c.meeting.normal, dsub(relative(change), relative(pushed)));
    point.press = c.press;
    point.rub = c.rub;
    point.slides = c.slides;
    result.push_back(point);
  }
  return result;
}

void BodyContacts::solve(const Rooms &state, const std::vector<MovableBody> &change)
{
  std::vector<MovableBody> bodies = movable(state.rigid);
  std::vector<ContactPoint> point = points(state, bodies, change);
  double gap = std::numeric_limits<double>::infinity();
  for (const Contact &c : contacts_) gap = std::min(gap, pairs_[number(c.pair)].gap);
  solve_contacts(bodies, point, state.time.step * dnorm(state.rigid.gravity) + 1e-2 * gap / state.time.step);
  for (RigidBody &body : state.rigid.body) body.contact = {};
  for (std::size_t k = 0; k < point.size(); ++k) {
    Contact &c = contacts_[k];
    c.press = point[k].press;
    c.rub = point[k].rub;
    c.slides = point[k].slides;
    const auto give = [&](int body, const dvec3 &impulse, const dvec3 &lever) {
      if (body < 0) return;
      BodyWrench &w = state.rigid.body[number(body)].contact;
      w = {dadd(w.force, impulse), dadd(w.torque, dcross(lever, impulse))};
    };
    const dvec3 impulse = point[k].impulse();
    give(point[k].a, impulse, c.lever_a);
    give(point[k].b, dscale(-1, impulse), c.lever_b);
  }
}

/// Moves sides apart that are nearer than the gap, without giving them a velocity.
void BodyContacts::part(RigidState &rigid)
{
  bool any = false;
  std::vector<ContactPoint> points;
  double gap = 0;
  for (const Contact &c : contacts_) {
    const Pair &p = pairs_[number(c.pair)];
    any |= c.room < -parted_from * p.gap;
    gap = std::max(gap, p.gap);
    ContactPoint point{};
    point.a = objects_[number(p.a)].body;
    point.b = objects_[number(p.b)].body;
    point.normal = c.meeting.normal;
    point.lever_a = c.lever_a;
    point.lever_b = c.lever_b;
    point.approach = c.room < 0 ? parted * c.room : c.room;  // m
    points.push_back(point);
  }
  if (!any) return;
  std::vector<MovableBody> bodies;
  for (const RigidBody &body : rigid.body) bodies.push_back(still(body));
  solve_contacts(bodies, points, gap);
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    if (dnorm(bodies[b].velocity) == 0 && dnorm(bodies[b].spin) == 0) continue;
    RigidBody &body = rigid.body[b];
    body.center_next = dadd(body.center_next, bodies[b].velocity);
    body.rotation_next = normalized(multiply(axis_angle(bodies[b].spin, dnorm(bodies[b].spin)), body.rotation_next));
  }
}

/// What is left to rounding and to contacts that were not foreseen: bodies go only as far as nothing crosses.
void BodyContacts::stop_before_crossing(const Rooms &state)
{
  std::vector<RigidBody> &bodies = state.rigid.body;
  std::vector<double> share(bodies.size(), 1);
  std::vector<dvec3> whole;  // centres
  for (const RigidBody &body : bodies) whole.push_back(body.center_next);
  for (int cut = 0;; ++cut) {
    place_bodies(state.rigid);
    bool crosses = false;
    for (int pair : near_) {
      const Pair &p = pairs_[number(pair)];
      const Object &a = objects_[number(p.a)], &b = objects_[number(p.b)];
      const double first = MeetingSearch(*a.placed, *b.placed, p.gap).first_crossing().time;
      if (first > 1) continue;
      crosses = true;
      bool stands = true;
      for (int body : {a.body, b.body}) {
        if (body < 0) continue;
        double &s = share[number(body)];
        stands = stands && s == 0;
        s = cut + 1 < max_cuts ? kept * first * s : 0;
      }
      if (stands)
        throw SolverError("step of " + std::to_string(state.time.step) + " s: " + a.name + " is squeezed: " + b.name +
                          " moves into it, and it has nowhere to go");
    }
    if (!crosses) return;
    for (std::size_t b = 0; b < bodies.size(); ++b) {
      if (share[b] == 1) continue;
      bodies[b].center_next = dlerp(bodies[b].center, whole[b], share[b]);
      const dvec3 turn = dscale(share[b], bodies[b].turn_next);
      bodies[b].rotation_next = normalized(multiply(axis_angle(turn, dnorm(turn)), bodies[b].rotation));
    }
  }
}

/// Finds contacts and their impulses until the motion is that which they leave.
void BodyContacts::settle(const Rooms &state)
{
  std::vector<RigidBody> &bodies = state.rigid.body;
  std::vector<MovableBody> none;
  for (const RigidBody &body : bodies) none.push_back(still(body));
  bool solved = std::none_of(contacts_.begin(), contacts_.end(), [](const Contact &c) { return c.press > 0; });
  for (int round = 0; round < max_rounds; ++round) {
    place_bodies(state.rigid);
    look(state.rigid);
    measure();
    if (touch(state.rigid)) {
      for (RigidBody &body : bodies) move_alone(state, body);
      place_bodies(state.rigid);
      look(state.rigid);
      measure();
    }
    const bool done = std::all_of(contacts_.begin(), contacts_.end(), [&](const Contact &c) {
      const double off = c.room - c.allowed;
      return (c.press > 0 ? std::abs(off) : -off) <= tolerance * pairs_[number(c.pair)].gap;
    });
    if (done && solved) return;
    solve(state, none);
    solved = true;
    for (RigidBody &body : bodies) move_alone(state, body);
  }
}

/// Adds the pairs that would still pass through each other: features that were not the closest at the start.
bool BodyContacts::add_crossings(const RigidState &rigid)
{
  bool any = false;
  place_bodies(rigid);
  for (int pair : near_) {
    const Pair &p = pairs_[number(pair)];
    const Meeting m =
        MeetingSearch(*objects_[number(p.a)].placed, *objects_[number(p.b)].placed, p.gap).first_crossing();
    if (m.time > 1) continue;
    const std::size_t before = contacts_.size();
    add(pair, m, rigid);
    any |= contacts_.size() > before;
  }
  return any;
}

void BodyContacts::move(const Rooms &state)
{
  for (RigidBody &body : state.rigid.body) move_alone(state, body);
  find_near(state);
  if (near_.empty()) return;
  for (int more = 0; more <= max_crossings; ++more) {
    settle(state);
    if (more == max_crossings || !add_crossings(state.rigid)) break;
  }
  part(state.rigid);
  stop_before_crossing(state);
}

void BodyContacts::finish(const Rooms &state, const std::vector<BodyWrench> &impulses)
{
  std::vector<MovableBody> change;
  for (std::size_t b = 0; b < impulses.size(); ++b) {
    RigidBody &body = state.rigid.body[b];
    change.push_back(still(body));
    push(change.back(), {dsub(impulses[b].force, body.impulse.force), dsub(impulses[b].torque, body.impulse.torque)});
    body.impulse = impulses[b];
  }
  if (std::any_of(state.rigid.body.begin(), state.rigid.body.end(), [](const RigidBody &b) { return b.touching; }))
    solve(state, change);
}

}  // namespace cama
