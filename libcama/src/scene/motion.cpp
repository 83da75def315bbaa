// SPDX-License-Identifier: Apache-2.0
#include "cama/motion.hpp"

#include <algorithm>
#include <cmath>

#include "scene/constants.hpp"
#include "scene/shapes/quaternion.hpp"

namespace cama {
namespace {

RigidTransform between(const RigidTransform &a, const RigidTransform &b, double t)
{
  RigidTransform r;
  r.translation = kernels::dlerp(a.translation, b.translation, t);
  r.rotation = slerp(a.rotation, b.rotation, t);
  r.scale = a.scale + t * (b.scale - a.scale);
  r.center = kernels::dlerp(a.center, b.center, t);
  return r;
}

bool zero(const dvec3 &v) { return v.x == 0 && v.y == 0 && v.z == 0; }

/// The position of `time` among sorted times: left index and fraction.
template <class Times> std::pair<std::size_t, double> locate(const Times &at, std::size_t count, double time)
{
  if (count < 2 || time <= at(0)) return {0, 0.0};
  if (time >= at(count - 1)) return {count - 2, 1.0};
  std::size_t lo = 0, hi = count - 1;
  while (hi - lo > 1) {
    const std::size_t mid = (lo + hi) / 2;
    (at(mid) <= time ? lo : hi) = mid;
  }
  return {lo, (time - at(lo)) / (at(hi) - at(lo))};
}

}  // namespace

dvec3 RigidTransform::apply(const dvec3 &x) const
{
  const dvec3 r = rotate(rotation, kernels::dsub(x, center));
  return kernels::dadd(kernels::dadd(translation, center), kernels::dscale(scale, r));
}

bool Motion::is_static() const
{
  const auto same = [&](const Key &k) {
    const RigidTransform &a = k.transform, &b = keys.front().transform;
    return a.scale == b.scale && a.rotation == b.rotation && zero(kernels::dsub(a.translation, b.translation)) &&
           zero(kernels::dsub(a.center, b.center));
  };
  const bool steady = stop <= start || (zero(velocity) && zero(rotation_rate) && zero(oscillation));
  return steady && std::all_of(keys.begin(), keys.end(), same) && (!sampled || sampled->position.size() < 2);
}

RigidTransform Motion::at(double time) const
{
  RigidTransform key;
  if (keys.size() == 1)
    key = keys[0].transform;
  else if (keys.size() > 1) {
    const auto [i, t] = locate([&](std::size_t k) { return keys[k].time; }, keys.size(), time);
    key = between(keys[i].transform, keys[i + 1].transform, t);
  }
  const double elapsed = std::clamp(time, start, std::max(start, stop)) - start;
  if (zero(velocity) && zero(rotation_rate) && zero(oscillation)) return key;

  const double phase = 2 * pi * elapsed / period, rate = kernels::dnorm(rotation_rate);
  RigidTransform steady;
  steady.center = center;
  steady.translation = kernels::daxpy(kernels::dscale(elapsed, velocity), std::sin(phase), oscillation);
  if (rate > 0) steady.rotation = axis_angle(rotation_rate, rate * elapsed);
  if (keys.empty()) return steady;

  // steady after keys, about the origin: x -> steady(key(x))
  RigidTransform both;
  both.rotation = normalized(multiply(steady.rotation, key.rotation));
  both.scale = key.scale;
  both.translation = steady.apply(key.apply({0, 0, 0}));
  return both;
}

void Motion::evaluate(double time, const std::vector<dvec3> &rest, std::vector<dvec3> &position) const
{
  position.resize(rest.size());
  const std::vector<dvec3> *base = &rest;
  if (sampled && !sampled->position.empty()) {
    const auto &s = *sampled;
    if (s.position.size() == 1)
      position = s.position[0];
    else {
      const auto [i, t] = locate([&](std::size_t k) { return s.time[k]; }, s.time.size(), time);
      const auto &a = s.position[i], &b = s.position[i + 1];
      position.resize(a.size());
      for (std::size_t v = 0; v < a.size(); ++v) position[v] = t >= 1 ? b[v] : kernels::dlerp(a[v], b[v], t);
    }
    base = &position;
  }
  const bool moves = !keys.empty() || !zero(velocity) || !zero(rotation_rate) || !zero(oscillation);
  if (!moves) {
    if (base != &position) position = rest;
    return;
  }
  const RigidTransform transform = at(time);
  for (std::size_t v = 0; v < position.size(); ++v) position[v] = transform.apply((*base)[v]);
}

}  // namespace cama
