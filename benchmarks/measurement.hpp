// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "settings.hpp"

namespace cama::benchmark {

struct Statistics {
  double mean = 0, median = 0, deviation = 0, percentile95 = 0;
};   ///< deviation: of a sample, n - 1
Statistics statistics(std::vector<double> values);

/// One stage over the measured steps.
struct StageRow {
  std::string name;
  Statistics milliseconds;
  double bytes = 0;
};

/// One scene at one resolution. Counts of a step are medians over the measured steps.
struct Measurement {
  std::string scene, device, error;       ///< error: why it ended early, else empty
  int triangles = 0, skipped = 0, steps = 0, intersections = -1;
  double time_step = 0, seconds = 0;      ///< s, of all steps
  double iterations = 0, launches = 0, contacts = 0, candidates = 0;
  double waits = -1;                      ///< of the host for the device; -1: not counted by the backend
  double peak_mib = 0;
  std::uint64_t hash = 0;
  std::vector<StageRow> stages;           ///< the whole step first
};

/// Steps from rest, then the measured ones. An error of the simulation ends it and is kept; errors of the scene are
/// thrown.
Measurement measure(const Settings &settings, int resolution);

/// Bytes read and written a second by copying 256 MiB on the device, best of five, GB/s: a floor is of the undisturbed
/// device.
double copy_bandwidth(const Options &options);

/// Slope of the least squares line through (log x, log y); 0 with fewer than two points.
double exponent(const std::vector<double> &x, const std::vector<double> &y);

}  // namespace cama::benchmark
