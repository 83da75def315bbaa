// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

#include "cama/simulation.hpp"

namespace cama::benchmark {

enum class Wait { never, always, alternate };   ///< whether to wait for the device after every stage

/// What to run and what to measure.
struct Settings {
  std::string scene;
  std::vector<int> resolutions = {0};   ///< triangles; 0: the scene's own
  int skip = 10;                        ///< steps before the measurement
  int steps = 20;                       ///< measured steps
  double limit = 0;  ///< of wall time for each resolution, s, after which the measurement ends; 0: none
  double bandwidth = 0;  ///< GB/s; 0: measured by copying
  Wait wait = Wait::alternate;
  bool header = true;
  OptionOverrides options;  ///< of the simulation; the backend is cpu unless set
  std::string changed;  ///< those that influence the result besides level and precision: "name=value name=value"
};

/// Parses SCENE [name=value ...]. Throws SceneError, which lists the names, if one is unknown.
Settings parse_settings(int count, const char *const *arguments);

/// All names with their values, for a usage message.
std::string settings_help();

}  // namespace cama::benchmark
