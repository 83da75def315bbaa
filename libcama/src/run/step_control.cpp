// SPDX-License-Identifier: Apache-2.0
#include "run/step_control.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "cama/error.hpp"
#include "stages/estimate_error.hpp"

namespace cama {
namespace {

// Steps in a frame of 1/60 s at most: the root of r = size over error over the first, or r over the second.
constexpr double root_steps = 2, linear_steps = 40;
constexpr double stretch_pieces = 4;  // into which edges that stretch too far divide the shortest step at most
constexpr double least_error = 1e-6;  // of the size
constexpr double longest_ratio = 2;  // of a step to the one before
constexpr double safety = 2;  // by which errors in contact exceed the estimate
constexpr double rejected = 3;  // share of the allowed error from which a step is taken again
constexpr double recovery = 1.1;  // by which steps grow after one was too long for edges
constexpr double rounding = 1e-6;  // of a step: a whole number of the shortest ones may fill a frame
constexpr double smallest_share = 1e-2;  // that the next step is chosen by

struct Unit {
  const char *name;
  double metres;
};
constexpr Unit units[] = {{"m", 1}, {"cm", 1e-2}, {"mm", 1e-3}, {"um", 1e-6}, {"µm", 1e-6}};

/// The largest side of the bounding box of points; coordinates(point): [Dimensions].
template <int Dimensions, class Points, class F> double largest_side(const Points &points, F &&coordinates)
{
  double side = 0;
  for (std::size_t k = 0; k < Dimensions; ++k) {
    double low = std::numeric_limits<double>::infinity(), high = -low;
    for (const auto &point : points) {
      low = std::min(low, coordinates(point)[k]);
      high = std::max(high, coordinates(point)[k]);
    }
    if (!points.empty()) side = std::max(side, high - low);
  }
  return side;
}

/// Of the cloth at rest, m^2.
double area_at_rest(const Mesh &mesh)
{
  double sum = 0;
  for (const Triangle &f : mesh.material_face) {
    const auto at = [&](int k) {
      return mesh.material_position[static_cast<std::size_t>(f[static_cast<std::size_t>(k)])];
    };
    const MaterialPoint a = at(0), b = at(1), c = at(2);
    sum += 0.5 * std::abs((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]));
  }
  return sum;
}

/// x^(1/8), by operations that round alike everywhere.
double eighth_root(double x) { return std::sqrt(std::sqrt(std::sqrt(x))); }

/// Number of frames that are complete.
double frames_of(const Clock &time) { return std::floor(time.now / time.frame + 1e-6); }

/// The shortest step for edges that stretch too far, s.
double shortest_by_stretch(const Clock &time) { return time.shortest / stretch_pieces; }

/// Of the error allowed in this step, the share that it has.
double share_of(const Clock &time) { return safety * time.step_error / (time.error * ERROR_FRAMES * time.step); }

}  // namespace

double allowed_error(const std::string &text, double size)
{
  char *end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  const std::string unit = text.substr(std::min(text.find_first_not_of(' ', end - text.c_str()), text.size()));
  if (end != text.c_str() && std::isfinite(value) && value > 0) {
    double error = unit == "%" ? 0.01 * value * size : 0;
    for (const Unit &u : units)
      if (unit == u.name) error = value * u.metres;
    if (error > 0 && error < least_error * size)
      throw SceneError("error: '" + text + "' is less than a millionth of the cloth's size; no step is short enough");
    if (error > 0 || size == 0) return error;
  }
  throw SceneError("error: '" + text +
                   "' is not a length above 0 or a share of the cloth's size; give \"1 mm\" or \"0.1 %\"");
}

// Cloth may start crumpled, so that it is larger at rest, or with its panels apart, so that it is smaller. In material
// space panels, or even triangles, may lie on top of each other: cloth is no smaller than a square of its area.
double cloth_size(const Scene &scene)
{
  double size = 0;
  for (const Cloth &cloth : scene.cloths) {
    const double start = largest_side<3>(cloth.mesh.position, [](const dvec3 &x) { return std::array{x.x, x.y, x.z}; });
    const double flat =
        std::max(largest_side<2>(cloth.mesh.material_position, [](const MaterialPoint &u) { return u; }),
                 std::sqrt(area_at_rest(cloth.mesh)));
    size = std::max(size, cloth.mesh.material_position.empty() ? start : std::min(start, flat));
  }
  return size;
}

double shortest_step(double error, double size, double frame)
{
  const double ratio = std::max(size / error, 1.0);
  const double steps = ERROR_FRAMES * frame * std::max({std::sqrt(ratio) / root_steps, ratio / linear_steps, 1.0});
  return frame / std::max(std::ceil(steps - 0.5 - rounding), 1.0);
}

void choose_step(Clock &time)
{
  if (!(time.error > 0)) return;
  const double end = (frames_of(time) + 1) * time.frame, left = end - time.now;
  double wanted = time.wanted > 0 ? time.wanted : time.step;
  wanted = std::min(wanted, time.longest);
  wanted = std::max(wanted, time.shortest);
  if (time.max_by_stretch > 0) wanted = std::max(std::min(wanted, time.max_by_stretch), shortest_by_stretch(time));
  if (time.history) wanted = std::min(wanted, longest_ratio * time.step_before);
  const double parts = std::max(std::ceil(left / wanted * (1 - 1e-9)), 1.0);
  time.step = left / parts;
  time.end = parts > 1 ? time.now + time.step : end;
}

bool ends_frame(const Clock &time)
{
  return time.error > 0 && time.now > 0 && std::abs(time.now - frames_of(time) * time.frame) < 1e-6 * time.frame;
}

bool over_error(const Clock &time) { return time.error > 0 && share_of(time) > rejected; }

bool judge_step(Clock &time)
{
  if (!(time.error > 0)) return true;
  const double share = share_of(time);
  const bool over = over_error(time) && time.step > (1 + rounding) * time.shortest,
             torn = time.stretched && time.step > (1 + rounding) * shortest_by_stretch(time);
  if (over || torn) {
    if (torn) time.max_by_stretch = std::max(time.step / 2, shortest_by_stretch(time));
    if (over) {
      const double factor = time.multistep ? 1 / std::sqrt(share) : 1 / share;
      time.wanted = std::max(0.9 * time.step * std::max(factor, 0.2), time.shortest);
    }
    return false;
  }
  if (time.max_by_stretch > 0 && !time.stretched)
    time.max_by_stretch = time.max_by_stretch < time.longest ? recovery * time.max_by_stretch : 0;
  // A proportional and integral controller (Gustafsson 1991); backward Euler's error is of one order less.
  const double now = std::max(share, smallest_share), before = time.last_share > 0 ? time.last_share : now;
  const double root = eighth_root(now), steps = 1 / (root * root * root) * eighth_root(before);
  time.wanted = time.step * std::clamp(0.9 * (time.multistep ? steps : steps * steps), 0.2, longest_ratio);
  if (time.crowding > 0) time.wanted = std::min(time.wanted, time.step / std::sqrt(time.crowding));
  time.last_share = now;
  return true;
}

}  // namespace cama
