// SPDX-License-Identifier: Apache-2.0
// The time steps of the accuracy levels.
#include <algorithm>
#include <cmath>

#include "cama/options.hpp"
#include "cama/scene.hpp"

namespace cama {
namespace {

/// Mean length of the edges of all cloth triangles, in material space if there is one, m.
double mean_edge(const Scene &scene)
{
  double sum = 0, count = 0;
  for (const Cloth &cloth : scene.cloths) {
    const Mesh &m = cloth.mesh;
    const bool rest = !m.material_face.empty();
    for (const Triangle &f : rest ? m.material_face : m.face)
      for (std::size_t k = 0; k < 3; ++k, ++count) {
        const auto a = static_cast<std::size_t>(f[k]), b = static_cast<std::size_t>(f[(k + 1) % 3]);
        if (rest)
          sum += std::hypot(m.material_position.at(a)[0] - m.material_position.at(b)[0],
                            m.material_position.at(a)[1] - m.material_position.at(b)[1]);
        else
          sum += kernels::dnorm(kernels::dsub(m.position.at(a), m.position.at(b)));
      }
  }
  return count > 0 ? sum / count : 0;
}

/// Ten steps h of backward Euler have an error of 5 a h^2 for a motion of constant acceleration a: a hundredth of an
/// edge for h^2 = edge / (500 a). a = 300 m/s^2 by measurement (docs/theory/accuracy.md). The step is between 1/2880 s
/// and 1/960 s.
double step_for_edges(const Scene &scene)
{
  constexpr double acceleration = 300, longest = 1.0 / 960;
  return std::clamp(std::sqrt(mean_edge(scene) / (500 * acceleration)), longest / 3, longest);
}

/// Time step of a level, s.
double level_time_step(Accuracy level, const Scene &scene)
{
  switch (level) {
  case Accuracy::preview: return 1.0 / 120;
  case Accuracy::interactive: return 1.0 / 240;
  case Accuracy::production: return step_for_edges(scene);
  case Accuracy::accurate: return step_for_edges(scene) / 5;
  case Accuracy::reference: return step_for_edges(scene) / 20;
  case Accuracy::paper: break;
  }
  return 1.0 / 200;
}

}  // namespace

double chosen_time_step(const Options &options, const Scene &scene)
{
  const Accuracy level = options.accuracy;
  if (options.time_step > 0) return options.time_step;
  if (scene.time_step > 0 && (level == Accuracy::production || level == Accuracy::paper)) return scene.time_step;
  double step = level_time_step(level, scene);
  if (scene.time_step > 0 && (level == Accuracy::accurate || level == Accuracy::reference))
    step = std::min(step, scene.time_step);
  const double frame = scene.frame_time > 0 ? scene.frame_time : std::max(scene.seconds_per_frame(), step);
  return frame / std::ceil(frame / step * (1 - 1e-9));
}

}  // namespace cama
