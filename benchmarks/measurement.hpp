// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "settings.hpp"

namespace cama::benchmark {

struct Statistics {
  double mean = 0, median = 0, percentile95 = 0;
  double deviation = 0;   ///< of a sample, with n - 1
};
Statistics statistics(std::vector<double> values);

/// Times of one stage over the measured steps.
struct StageRow {
  std::string name;
  Statistics milliseconds;
  double bytes = 0;
};

/// One scene at one resolution. Counts of a step are medians over the measured steps.
struct Measurement {
  std::string scene, device, error;       ///< error: why it ended early, or empty
  int triangles = 0, skipped = 0, steps = 0, intersections = -1;
  Options options;                        ///< the resolved options
  double time_step = 0, seconds = 0;      ///< s, of all steps
  double iterations = 0, launches = 0, contacts = 0, candidates = 0;
  double waits = 0;                       ///< number of times that the host waited for the device
  double peak_mib = 0;
  std::uint64_t hash = 0;
  std::vector<StageRow> stages;           ///< the whole step first
};

/// Takes the steps to skip, then the measured ones. An error of the simulation ends the measurement and is kept in it;
/// errors of the scene are thrown.
Measurement measure(const Settings &settings, int resolution);

/// Bytes read and written per second by copying 256 MiB on the device, GB/s; the best of five, since a floor is that of
/// the undisturbed device.
double copy_bandwidth(const OptionOverrides &options);

/// Slope of the least squares line through (log x, log y); 0 with fewer than two points.
double exponent(const std::vector<double> &x, const std::vector<double> &y);

}  // namespace cama::benchmark
