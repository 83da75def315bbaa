// SPDX-License-Identifier: Apache-2.0
// step_times SCENE [name=value ...]: one CSV row per stage and resolution; docs/reference/performance.md describes the
// columns.
#include <cstdio>
#include <string>
#include <vector>

#include "cama/error.hpp"
#include "measurement.hpp"

using namespace cama::benchmark;

namespace {

const char *columns =
    "scene,triangles,accuracy,backend,device,precision,options,time_step,skipped,steps,stage,mean_ms,median_ms,stddev_"
    "ms,p95_ms,bytes,"
    "bandwidth_gbs,floor_ms,ratio,iterations,launches,waits,contacts,candidates,intersections,peak_mib,hash";

std::string quoted(std::string text)
{
  for (char &c : text)
    if (c == '"' || c == '\n') c = '\'';
  return "\"" + text + "\"";
}

std::string number(double value, const char *format = "%.4f")
{
  char text[48];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

/// Columns for bytes, bandwidth, floor and ratio; empty if the bytes are unknown.
std::string floor_of(const StageRow &row, double bandwidth)
{
  if (row.bytes <= 0) return ",,,";
  const double floor = row.bytes / bandwidth * 1e-6;
  return number(row.bytes, "%.0f") + "," + number(bandwidth, "%.1f") + "," + number(floor, "%.5f") + "," +
         number(row.milliseconds.median / floor, "%.2f");
}

std::string counts_of(const Measurement &m)
{
  char hash[17];
  std::snprintf(hash, sizeof hash, "%016llx", static_cast<unsigned long long>(m.hash));
  return number(m.iterations, "%.0f") + "," + number(m.launches, "%.0f") + "," + number(m.waits, "%.0f") + "," +
         number(m.contacts, "%.0f") + "," + number(m.candidates, "%.0f") + "," + std::to_string(m.intersections) + "," +
         number(m.peak_mib, "%.1f") + "," + hash;
}

/// The value of an option as text.
std::string word(const Measurement &m, const char *option) { return cama::to_text(option_value(m.options, option)); }

void print(const Settings &s, const Measurement &m, double bandwidth)
{
  const std::string run = m.scene + "," + std::to_string(m.triangles) + "," + word(m, "accuracy") + "," +
                          word(m, "backend") + "," + quoted(m.device) + "," + word(m, "precision") + "," +
                          quoted(s.changed) + "," + number(m.time_step, "%.6g") + "," + std::to_string(m.skipped) +
                          "," + std::to_string(m.steps) + ",";
  for (std::size_t i = 0; i < m.stages.size(); ++i) {
    const StageRow &row = m.stages[i];
    const Statistics &t = row.milliseconds;
    std::printf("%s%s,%.4f,%.4f,%.4f,%.4f,%s,%s\n", run.c_str(), quoted(row.name).c_str(), t.mean, t.median,
                t.deviation, t.percentile95, floor_of(row, bandwidth).c_str(),
                i == 0 ? counts_of(m).c_str() : ",,,,,,,");
  }
  std::fflush(stdout);
}

void remark(const Measurement &m)
{
  if (m.stages.empty()) return;
  std::fprintf(
      stderr,
      "# %s on %s: %d triangles, %d steps after %d, median %.3f ms, %.0f iterations, %.0f launches, %d intersections, "
      "peak %.0f MiB, %.1f s, hash %016llx\n",
      m.scene.c_str(), m.device.c_str(), m.triangles, m.steps, m.skipped, m.stages[0].milliseconds.median, m.iterations,
      m.launches, m.intersections, m.peak_mib, m.seconds, static_cast<unsigned long long>(m.hash));
}

int run(int count, char **arguments)
{
  const Settings settings = parse_settings(count, arguments);
  const double bandwidth = settings.bandwidth > 0 ? settings.bandwidth : copy_bandwidth(settings.options);
  std::vector<double> triangles, times;
  int failures = 0;
  if (settings.header) std::printf("%s\n", columns);
  std::fflush(stdout);
  for (int resolution : settings.resolutions) {
    const Measurement m = measure(settings, resolution);
    print(settings, m, bandwidth);
    remark(m);
    if (!m.error.empty()) {
      std::fprintf(stderr, "%s\n", m.error.c_str());
      ++failures;
    }
    if (m.stages.empty()) continue;
    triangles.push_back(m.triangles);
    times.push_back(m.stages[0].milliseconds.median);
  }
  if (times.size() > 1)
    std::fprintf(stderr, "# exponent %.3f of the median step time in triangles\n", exponent(triangles, times));
  return failures ? 1 : 0;
}

}  // namespace

int main(int count, char **arguments)
{
  try {
    return run(count, arguments);
  } catch (const cama::Error &error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
}
