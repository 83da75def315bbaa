// SPDX-License-Identifier: Apache-2.0
// Which obstacles bodies can touch, where they are, and which are near.
#include <algorithm>
#include <cmath>

#include "cama/error.hpp"
#include "device/kernels.hpp"
#include "stages/body_contacts.hpp"
#include "stages/prescribed_motion.hpp"

namespace cama {
namespace {

using kernels::dadd;
using kernels::dcross;
using kernels::ddot;
using kernels::dnorm;
using kernels::dnormalize;
using kernels::dscale;
using kernels::dsub;
using kernels::dvec3_max;
using kernels::dvec3_min;

constexpr double margin = 1.25;  // of the gap, within which boxes are near

std::size_t number(int i) { return static_cast<std::size_t>(i); }

void include(ContactTree::Box &box, const dvec3 &x, double radius)
{
  const dvec3 r{radius, radius, radius};
  box.low = dvec3_min(box.low, dsub(x, r));
  box.high = dvec3_max(box.high, dadd(x, r));
}

ContactTree::Box around(const dvec3 &x, double radius)
{
  ContactTree::Box box{x, x};
  include(box, x, radius);
  return box;
}

}  // namespace

BodyContacts::Object::Object(const std::string &its_name, const Obstacle &its_description,
                             const ContactProperties &its_properties, int its_body, int its_obstacle)
    : name(its_name), description(its_description), properties(its_properties), body(its_body), obstacle(its_obstacle)
{}

bool BodyContacts::needed(const Scene &scene)
{
  return scene.contact.enabled && scene.obstacles.size() > 1 &&
         std::any_of(scene.obstacles.begin(), scene.obstacles.end(), [](const Obstacle &o) { return o.rigid; });
}

BodyContacts::BodyContacts(const Scene &scene, const MeshState &mesh, bool exempt)
{
  int bodies = 0;
  for (std::size_t o = 0; o < scene.obstacles.size(); ++o) {
    const std::size_t object = scene.cloths.size() + o;
    const int body = scene.obstacles[o].rigid ? bodies++ : -1;
    objects_.emplace_back(mesh.object_name[object], scene.obstacles[o], scene.contact_properties(object), body,
                          static_cast<int>(o));
    make_shape(objects_.back());
  }
  for (Object &o : objects_) {
    o.description.motion.evaluate(0, o.shape->rest, o.placed->start);
    o.placed->end = o.placed->start;
    o.placed->fit();
  }
  for (std::size_t i = 0; i < objects_.size(); ++i)
    for (std::size_t j = 0; j < objects_.size(); ++j) {
      const Object &a = objects_[i], &b = objects_[j];
      if (a.body < 0 || i == j || (b.body >= 0 && j < i)) continue;
      const Pair pair{static_cast<int>(i), static_cast<int>(j), 0.5 * (a.properties.thickness + b.properties.thickness),
                      0.5 * (a.properties.friction + b.properties.friction),
                      0.5 * (a.properties.static_friction + b.properties.static_friction)};
      const double depth = MeetingSearch(*a.placed, *b.placed, pair.gap).depth();
      if (depth > 0 && exempt) continue;
      if (depth > 0)
        throw CollisionError("the scene starts with " + a.name + ", which is rigid, " + std::to_string(depth) +
                             " m deep in " + b.name +
                             "; move them apart, or set the option intersections to "
                             "\"exempt\": then they pass through each other");
      pairs_.push_back(pair);
    }
}

void BodyContacts::make_shape(Object &o)
{
  o.shape = std::make_unique<ContactShape>(o.description);
  o.placed = std::make_unique<PlacedShape>(*o.shape);
  o.deforms = !o.description.motion.is_rigid();
  const std::vector<dvec3> &rest = o.shape->rest;
  if (o.body >= 0) {
    o.middle = {0, 0, 0};
    return;  // its centre of mass
  }
  for (const dvec3 &x : rest) o.middle = dadd(o.middle, dscale(1 / static_cast<double>(rest.size()), x));
  for (const dvec3 &x : rest) o.extent = std::max(o.extent, dnorm(dsub(x, o.middle)));
}

/// Where an obstacle that is no body starts and ends the step.
void BodyContacts::place(Object &o, const Rooms &state)
{
  const Motion *motion = motion_->motion_of(o.obstacle);
  if (o.placed_now || (o.fitted && !motion)) return;
  o.placed_now = true;
  o.fitted = !motion;
  if (motion && !motion->is_rigid() && !o.deforms) {  // a driver has set its vertices
    o.description.motion = *motion;
    make_shape(o);
  }
  if (!motion) motion = &o.description.motion;
  motion->evaluate(state.time.now, o.shape->rest, o.placed->start);
  motion->evaluate(state.time.now + state.time.step, o.shape->rest, o.placed->end);
  o.placed->fit();
}

/// A box around an object in the step.
ContactTree::Box BodyContacts::bounds(Object &o, const Rooms &state)
{
  if (o.body >= 0) {
    const RigidBody &body = state.rigid.body[number(o.body)];
    if (o.extent == 0)
      for (const dvec3 &x : o.shape->rest) o.extent = std::max(o.extent, dnorm(dsub(x, body.rest_center)));
    ContactTree::Box box = around(body.center, o.extent + o.shape->radius);
    include(box, body.center_next, o.extent + o.shape->radius);
    return box;
  }
  const Motion *motion = motion_->motion_of(o.obstacle);
  if (!motion || !motion->is_rigid()) {
    place(o, state);
    ContactTree::Box box = o.placed->tree.box();
    include(box, box.low, o.shape->radius);
    include(box, box.high, o.shape->radius);
    return box;
  }
  const RigidTransform start = motion->at(state.time.now), end = motion->at(state.time.now + state.time.step);
  ContactTree::Box box = around(start.apply(o.middle), start.scale * o.extent + o.shape->radius);
  include(box, end.apply(o.middle), end.scale * o.extent + o.shape->radius);
  return box;
}

bool BodyContacts::near(const Pair &pair, const Rooms &state)
{
  Object &a = objects_[number(pair.a)], &b = objects_[number(pair.b)];
  const ContactTree::Box own = bounds(a, state);
  if (!b.shape->plane) return ContactTree::near(own, bounds(b, state), margin * pair.gap);
  place(b, state);
  const RigidBody &body = state.rigid.body[number(a.body)];
  const double reach = a.extent + a.shape->radius + margin * pair.gap;
  const auto above = [&](const std::vector<dvec3> &p, const dvec3 &x) {
    return ddot(dnormalize(dcross(dsub(p[1], p[0]), dsub(p[2], p[0]))), dsub(x, p[0])) > reach;
  };
  return !above(b.placed->start, body.center) || !above(b.placed->end, body.center_next);
}

/// Adds pairs that come near to those that do already, and places what is no body in them.
void BodyContacts::find_near(const Rooms &state)
{
  for (std::size_t p = 0; p < pairs_.size(); ++p) {
    const int index = static_cast<int>(p);
    if (std::find(near_.begin(), near_.end(), index) != near_.end() || !near(pairs_[p], state)) continue;
    near_.push_back(index);
    Object &b = objects_[number(pairs_[p].b)];
    if (b.body < 0) place(b, state);
  }
}

}  // namespace cama
