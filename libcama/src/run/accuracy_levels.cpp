// SPDX-License-Identifier: Apache-2.0
// The time steps of the accuracy levels.
#include <algorithm>
#include <cmath>

#include "cama/options.hpp"
#include "cama/scene.hpp"

namespace cama {
namespace {

/// Time step of a level, s.
double level_time_step(Accuracy level)
{
  switch (level) {
  case Accuracy::preview: return 1.0 / 120;
  case Accuracy::interactive: return 1.0 / 240;
  case Accuracy::production: return 1.0 / 240;
  case Accuracy::accurate: return 1.0 / 1200;
  case Accuracy::reference: return 1.0 / 4800;
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
  double step = level_time_step(level);
  if (scene.time_step > 0 && (level == Accuracy::accurate || level == Accuracy::reference))
    step = std::min(step, scene.time_step);
  const double frame = scene.frame_time > 0 ? scene.frame_time : std::max(scene.seconds_per_frame(), step);
  return frame / std::ceil(frame / step * (1 - 1e-9));
}

}  // namespace cama
