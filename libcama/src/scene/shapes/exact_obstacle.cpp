// SPDX-License-Identifier: Apache-2.0
// Spheres, capsules, boxes and planes that are not meshed: making, reading from a scene file, checking.
#include <algorithm>
#include <cmath>

#include "cama/error.hpp"
#include "device/kernels.hpp"
#include "scene/shapes/exact_obstacle.hpp"

namespace cama {
namespace {

using namespace kernels;

bool finite(const dvec3 &v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

Obstacle made(ObstacleShape shape, std::vector<dvec3> points, double radius)
{
  Obstacle o;
  o.shape = shape;
  o.radius = radius;
  o.mesh.position = std::move(points);
  o.source = std::string("exact ") + shape_name(shape);
  if (shape == ObstacleShape::box)   // with outward normals
    o.mesh.face = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                   {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
  return o;
}

std::size_t point_count(ObstacleShape shape)
{
  switch (shape) {
  case ObstacleShape::sphere: return 1;
  case ObstacleShape::capsule: return 2;
  case ObstacleShape::plane: return 3;
  case ObstacleShape::box: return 8;
  case ObstacleShape::mesh: break;
  }
  return 0;
}

void check_box(const std::string &object, const std::vector<dvec3> &p)
{
  const dvec3 side[3] = {dsub(p[1], p[0]), dsub(p[2], p[0]), dsub(p[4], p[0])};
  const double size = std::max({dnorm(side[0]), dnorm(side[1]), dnorm(side[2])});
  bool good = true;
  for (int a = 0; a < 3; ++a) {
    const dvec3 &s = side[a], &t = side[(a + 1) % 3];
    good = good && dnorm(s) > 0 && std::abs(ddot(s, t)) <= 1e-9 * dnorm(s) * dnorm(t);
  }
  good = good && ddot(dcross(side[0], side[1]), side[2]) > 0;
  for (int k = 0; good && k < 8; ++k) {
    dvec3 corner = p[0];
    for (int a = 0; a < 3; ++a)
      if (k >> a & 1) corner = dadd(corner, side[a]);
    good = dnorm(dsub(corner, p[k])) <= 1e-9 * (size + dnorm(corner));
  }
  if (!good)
    throw SceneError(object + ": its eight corners are not those of a box; give corner k at the high side along axis a "
                              "where bit a of k is set");
}

void check_motion(const std::string &object, const Obstacle &o)
{
  const Motion &m = o.motion;
  if (m.sampled)
    throw SceneError(object + ": motion: has sampled positions; a " + shape_name(o.shape) +
                     " that is exact moves rigidly, use a mesh");
  for (const Motion::Key &k : m.keys) {
    if (o.shape != ObstacleShape::box && k.transform.scale != 1)
      throw SceneError(object + ": motion.keys: scale is " + std::to_string(k.transform.scale) + "; an exact " +
                       shape_name(o.shape) + " cannot be scaled; use a mesh");
    const auto &q = k.transform.rotation;
    if (o.shape == ObstacleShape::plane && (q[1] != 0 || q[2] != 0 || q[3] != 0))
      throw SceneError(object + ": motion.keys: turns a plane; a plane may only translate, use a box");
  }
  if (o.shape == ObstacleShape::plane && dnorm(m.rotation_rate) != 0)
    throw SceneError(object + ": motion.rotation_rate: turns a plane; a plane may only translate, use a box");
}

}  // namespace

const char *shape_name(ObstacleShape shape)
{
  switch (shape) {
  case ObstacleShape::sphere: return "sphere";
  case ObstacleShape::capsule: return "capsule";
  case ObstacleShape::box: return "box";
  case ObstacleShape::plane: return "plane";
  case ObstacleShape::mesh: break;
  }
  return "mesh";
}

void validate_exact(const std::string &object, const Obstacle &o)
{
  const std::vector<dvec3> &p = o.mesh.position;
  const char *name = shape_name(o.shape);
  const bool round = o.shape == ObstacleShape::sphere || o.shape == ObstacleShape::capsule;
  if (p.size() != point_count(o.shape))
    throw SceneError(object + ": has " + std::to_string(p.size()) + " points; a " + name + " is given by " +
                     std::to_string(point_count(o.shape)));
  if (!std::all_of(p.begin(), p.end(), finite))
    throw SceneError(object + ": a point of the " + name + " is not finite; give finite numbers, m");
  if (round ? !(std::isfinite(o.radius) && o.radius > 0) : o.radius != 0)
    throw SceneError(object + ": radius is " + std::to_string(o.radius) + "; " +
                     (round ? "give metres, greater than 0" : "a " + std::string(name) + " has none"));
  if (o.shape == ObstacleShape::capsule && !(dnorm(dsub(p[1], p[0])) > 0))
    throw SceneError(object + ": both ends of the capsule coincide; use a sphere");
  if (o.shape == ObstacleShape::plane &&
      !(dnorm(dcross(dsub(p[1], p[0]), dsub(p[2], p[0]))) > 1e-9 * dnorm(dsub(p[1], p[0])) * dnorm(dsub(p[2], p[0]))))
    throw SceneError(object + ": the points of the plane lie on a line; give a point and a normal");
  if (o.shape == ObstacleShape::box) {
    check_box(object, p);
    o.mesh.validate(object);
  }
  check_motion(object, o);
}

Obstacle exact_sphere(const dvec3 &center, double radius)
{
  Obstacle o = made(ObstacleShape::sphere, {center}, radius);
  validate_exact("sphere", o);
  return o;
}

Obstacle exact_capsule(const dvec3 &end_a, const dvec3 &end_b, double radius)
{
  Obstacle o = made(ObstacleShape::capsule, {end_a, end_b}, radius);
  validate_exact("capsule", o);
  return o;
}

Obstacle exact_box(const dvec3 &center, const dvec3 &size)
{
  std::vector<dvec3> p;
  for (int k = 0; k < 8; ++k)
    p.push_back(
        dadd(center, {(k & 1 ? 0.5 : -0.5) * size.x, (k & 2 ? 0.5 : -0.5) * size.y, (k & 4 ? 0.5 : -0.5) * size.z}));
  Obstacle o = made(ObstacleShape::box, std::move(p), 0);
  validate_exact("box", o);
  return o;
}

Obstacle exact_plane(const dvec3 &point, const dvec3 &normal)
{
  if (!finite(normal) || !(dnorm(normal) > 0))
    throw SceneError("plane: normal has no length; give a direction out of the solid side");
  const dvec3 n = dnormalize(normal), u = any_perpendicular(n), w = dcross(n, u);
  Obstacle o = made(ObstacleShape::plane, {point, dadd(point, u), dadd(point, w)}, 0);
  validate_exact("plane", o);
  return o;
}

Obstacle read_exact(const Field &f)
{
  f.only({"sphere", "capsule", "box", "plane"});
  if (f.json().size() != 1) f.fail("give exactly one of sphere, capsule, box, plane");
  const std::string name = f.json().begin().key();
  const Field s = f.at(name);
  const auto points = [&](ObstacleShape shape, double radius) {
    std::vector<dvec3> p;
    for (const Field &x : s.at("points").items()) p.push_back(x.vector());
    Obstacle o = made(shape, std::move(p), radius);
    validate_exact(s.path(), o);
    return o;
  };
  try {
    if (name == "sphere") {
      s.only({"radius", "points"});
      const double r = s.positive("radius", 0.25);
      return s.has("points") ? points(ObstacleShape::sphere, r) : exact_sphere({0, 0, 0}, r);
    }
    if (name == "capsule") {
      s.only({"radius", "length", "points"});
      const double r = s.positive("radius", 0.1);
      if (s.has("points")) return points(ObstacleShape::capsule, r);
      const double half = 0.5 * s.positive("length", 0.5);
      return exact_capsule({0, 0, -half}, {0, 0, half}, r);
    }
    if (name == "box") {
      s.only({"size", "points"});
      if (s.has("points")) return points(ObstacleShape::box, 0);
      const dvec3 size = s.at("size").vector();
      if (!(size.x > 0) || !(size.y > 0) || !(size.z > 0))
        s.at("size").fail("must be greater than 0 in all directions, got " + s.at("size").brief());
      return exact_box({0, 0, 0}, size);
    }
    s.only({"normal", "points"});
    if (s.has("points")) return points(ObstacleShape::plane, 0);
    const dvec3 normal = s.vector("normal", {0, 0, 1});
    if (!(dnorm(normal) > 0)) s.at("normal").fail("the normal has no length");
    return exact_plane({0, 0, 0}, normal);
  } catch (const MeshError &e) {
    s.fail(e.what());
  }
}

void place_exact(const RigidTransform &t, Obstacle &o)
{
  for (dvec3 &x : o.mesh.position) x = t.apply(x);
  o.radius *= t.scale;
}

}  // namespace cama
