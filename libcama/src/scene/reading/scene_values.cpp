// SPDX-License-Identifier: Apache-2.0
// Transforms, motions and inline meshes of a scene file.
#include <cmath>

#include "scene/constants.hpp"
#include "scene/reading/scene_reader.hpp"
#include "scene/shapes/quaternion.hpp"

namespace cama {
namespace {

Quaternion read_rotation(const Field &f)
{
  if (f.has("rotate") && f.has("quaternion")) f.fail("give \"rotate\" or \"quaternion\", not both");
  if (f.has("rotate")) {
    const Field r = f.at("rotate");
    r.only({"axis", "angle_deg"});
    const dvec3 axis = r.at("axis").vector();
    if (kernels::dnorm(axis) == 0) r.at("axis").fail("the axis has no length");
    return axis_angle(axis, degree * r.at("angle_deg").finite());
  }
  if (!f.has("quaternion")) return {1, 0, 0, 0};
  const auto q = f.at("quaternion").numbers(4);
  const double l = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  if (!(std::abs(l - 1) < 1e-6))
    f.at("quaternion").fail("must have length 1 (w, x, y, z), got length " + std::to_string(l));
  return {q[0], q[1], q[2], q[3]};
}

RigidTransform transform_parts(const Field &f)
{
  RigidTransform t;
  t.translation = f.vector("translate", t.translation);
  t.rotation = read_rotation(f);
  t.scale = f.positive("scale", 1);
  t.center = f.vector("center", t.center);
  return t;
}

/// A list of rows of `width` numbers, or one flat list of the same numbers.
std::vector<double> rows(const Field &f, std::size_t width)
{
  const Json &j = f.json();
  if (!j.is_array()) f.fail(std::string("expected a list, got ") + j.type_name());
  std::vector<double> all;
  if (j.empty() || j[0].is_array()) {
    all.reserve(width * j.size());
    for (std::size_t i = 0; i < j.size(); ++i)
      for (double x : f.at(i).numbers(width)) all.push_back(x);
    return all;
  }
  if (j.size() % width)
    f.fail("expected a multiple of " + std::to_string(width) + " numbers, got " + std::to_string(j.size()));
  all.reserve(j.size());
  for (std::size_t i = 0; i < j.size(); ++i) {
    if (!j[i].is_number()) f.at(i).fail("expected a number, got " + f.at(i).brief());
    all.push_back(j[i].get<double>());
  }
  return all;
}

std::vector<dvec3> points(const Field &f)
{
  const std::vector<double> x = rows(f, 3);
  std::vector<dvec3> p(x.size() / 3);
  for (std::size_t i = 0; i < p.size(); ++i) p[i] = {x[3 * i], x[3 * i + 1], x[3 * i + 2]};
  return p;
}

std::vector<Triangle> triangles(const Field &f)
{
  const std::vector<double> x = rows(f, 3);
  std::vector<Triangle> t(x.size() / 3);
  for (std::size_t i = 0; i < x.size(); ++i) {
    if (x[i] != std::floor(x[i]) || std::abs(x[i]) > 2147483647.0)
      f.fail("triangle " + std::to_string(i / 3) + ": vertex indices must be whole numbers, got " +
             std::to_string(x[i]));
    t[i / 3][i % 3] = static_cast<int>(x[i]);
  }
  return t;
}

}  // namespace

RigidTransform read_transform(const Field &f)
{
  f.only({"translate", "rotate", "quaternion", "scale", "center"});
  return transform_parts(f);
}

void apply_transform(const RigidTransform &transform, std::vector<dvec3> &position)
{
  for (dvec3 &x : position) x = transform.apply(x);
}

Motion read_motion(const Field &f)
{
  f.only({"keys", "velocity", "rotation_rate", "oscillation", "center", "start", "stop", "sampled"});
  Motion m;
  m.velocity = f.vector("velocity", m.velocity);
  m.rotation_rate = f.vector("rotation_rate", m.rotation_rate);
  m.center = f.vector("center", m.center);
  m.start = f.finite("start", m.start);
  m.stop = f.finite("stop", m.stop);
  if (f.has("oscillation")) {
    const Field o = f.at("oscillation");
    o.only({"amplitude", "period"});
    m.oscillation = o.at("amplitude").vector();
    m.period = o.positive("period", 1);
  }
  if (f.has("keys"))
    for (const Field &k : f.at("keys").items()) {
      k.only({"time", "translate", "rotate", "quaternion", "scale", "center"});
      m.keys.push_back({k.at("time").finite(), transform_parts(k)});
      if (m.keys.size() > 1 && !(m.keys.back().time > m.keys[m.keys.size() - 2].time))
        k.at("time").fail("times of keys must increase");
    }
  if (f.has("sampled")) {
    const Field s = f.at("sampled");
    s.only({"time", "position"});
    auto sampled = std::make_shared<Motion::Sampled>();
    for (const Field &t : s.at("time").items()) sampled->time.push_back(t.finite());
    for (const Field &p : s.at("position").items()) sampled->position.push_back(points(p));
    if (sampled->time.empty() || sampled->time.size() != sampled->position.size())
      s.fail("\"time\" and \"position\" must be lists of one length, not empty");
    m.sampled = std::move(sampled);
  }
  return m;
}

Mesh read_inline_mesh(const Field &f)
{
  f.only({"position", "face", "material_position", "material_face", "weld"});
  Mesh m;
  m.position = points(f.at("position"));
  m.face = triangles(f.at("face"));
  if (f.has("material_position")) {
    const std::vector<double> u = rows(f.at("material_position"), 2);
    for (std::size_t i = 0; i < u.size(); i += 2) m.material_position.push_back({u[i], u[i + 1]});
    m.material_face = f.has("material_face") ? triangles(f.at("material_face")) : m.face;
  } else if (f.has("material_face"))
    f.at("material_face").fail("needs \"material_position\" beside it");
  return m;
}

}  // namespace cama
