// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

#include "cama/simulation.hpp"

namespace cama::benchmark {

enum class Wait { never, always, alternate };   ///< for the device after every stage

/// What to run and what to measure of it.
struct Settings {
  std::string scene;
  std::vector<int> resolutions = {0};   ///< 0: the scene's own
  double time_step = 0;                 ///< s; 0: the scene's, or that of the level paper
  int skip = 10;                        ///< steps from rest that are not measured
  int steps = 20;                       ///< measured
  double limit = 0;  ///< s of wall time a resolution; 0: none. Reached: what was measured by then is the result
  double bandwidth = 0;  ///< GB/s; 0: measured by copying
  Wait wait = Wait::alternate;
  bool header = true;
  Options options;
  std::string changed;  ///< options set by name, as "name=value name=value"
};

/// SCENE [name=value ...]. Throws SceneError that lists the names where one is not known.
Settings parse_settings(int count, const char *const *arguments);

/// All names with their values, for a usage message.
std::string settings_help();

}  // namespace cama::benchmark
