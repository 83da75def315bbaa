// SPDX-License-Identifier: Apache-2.0
#include "measurement.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <utility>

#include "cama/error.hpp"
#include "traffic.hpp"

namespace cama::benchmark {
namespace {

class Clock {
public:
  double seconds() const { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count(); }

private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

double median(const std::vector<double> &values) { return statistics(values).median; }

/// Times and counts of the measured steps.
class Samples {
public:
  /// stages: whether the times of stages measure their work; step: whether the step had no waits between stages. The
  /// last stage of a step waits for the device in any case.
  void add(const Simulation &simulation, bool stages, bool step)
  {
    std::string outer;
    const std::map<std::string, double> bytes = step_bytes(simulation);
    for (const StageTime &time : simulation.timings()) {
      const std::string name = nested_name(time, outer);
      if (std::find(order_.begin(), order_.end(), name) == order_.end()) order_.push_back(name);
      if (time.depth == 0 ? step : stages) times_[name].push_back(time.milliseconds);
      const auto found = bytes.find(name);
      if (found != bytes.end()) bytes_[name].push_back(found->second);
    }
    const StepReport &r = simulation.report();
    iterations_.push_back(r.iterations);
    launches_.push_back(static_cast<double>(r.launches));
    contacts_.push_back(r.contacts);
    candidates_.push_back(r.candidates);
    waits_.push_back(static_cast<double>(r.waits));
    worst_ = std::max(worst_, r.intersections);
  }

  void store(Measurement &m) const
  {
    for (const std::string &name : order_) {
      const auto times = times_.find(name), bytes = bytes_.find(name);
      if (times == times_.end()) continue;
      m.stages.push_back({name, statistics(times->second), bytes == bytes_.end() ? 0 : median(bytes->second)});
    }
    m.steps = static_cast<int>(iterations_.size());
    m.iterations = median(iterations_);
    m.launches = median(launches_);
    m.contacts = median(contacts_);
    m.candidates = median(candidates_);
    m.waits = median(waits_);
    m.intersections = worst_;
  }

private:
  std::vector<std::string> order_;
  std::map<std::string, std::vector<double>> times_, bytes_;
  std::vector<double> iterations_, launches_, contacts_, candidates_, waits_;
  int worst_ = -1;
};

/// Whether measured step number i waits for the device after every stage.
bool waits(const Settings &settings, int i)
{
  return settings.wait == Wait::always || (settings.wait == Wait::alternate && i % 2 == 1);
}

void run_steps(const Settings &settings, Simulation &simulation, Samples &samples, Measurement &m)
{
  const Clock all;
  const auto spent = [&] { return settings.limit > 0 && all.seconds() > settings.limit; };
  const bool synchronous = simulation.backend().name() == "cpu";  // its stages have ended when they return
  simulation.wait_for_stages(false);
  for (; m.skipped < settings.skip && !spent(); ++m.skipped) simulation.step();
  simulation.positions();  // waits for the device
  for (int i = 0; i < settings.steps && (i < 2 || !spent()); ++i) {
    const bool wait = waits(settings, i);
    simulation.wait_for_stages(wait);
    simulation.step();
    samples.add(simulation, wait || synchronous || settings.wait == Wait::never,
                !wait || synchronous || settings.wait == Wait::always);
  }
  m.seconds = all.seconds();
}

}  // namespace

Statistics statistics(std::vector<double> values)
{
  Statistics s;
  const std::size_t n = values.size();
  if (n == 0) return s;
  std::sort(values.begin(), values.end());
  for (double v : values) s.mean += v / static_cast<double>(n);
  double squares = 0;
  for (double v : values) squares += (v - s.mean) * (v - s.mean);
  s.deviation = n > 1 ? std::sqrt(squares / static_cast<double>(n - 1)) : 0;
  s.median = n % 2 ? values[n / 2] : 0.5 * (values[n / 2 - 1] + values[n / 2]);
  s.percentile95 = values[static_cast<std::size_t>(std::ceil(0.95 * static_cast<double>(n))) - 1];
  return s;
}

double exponent(const std::vector<double> &x, const std::vector<double> &y)
{
  const std::size_t n = std::min(x.size(), y.size());
  if (n < 2) return 0;
  double mx = 0, my = 0, xy = 0, xx = 0;
  for (std::size_t i = 0; i < n; ++i) {
    mx += std::log(x[i]) / static_cast<double>(n);
    my += std::log(y[i]) / static_cast<double>(n);
  }
  for (std::size_t i = 0; i < n; ++i) {
    xy += (std::log(x[i]) - mx) * (std::log(y[i]) - my);
    xx += (std::log(x[i]) - mx) * (std::log(x[i]) - mx);
  }
  return xx > 0 ? xy / xx : 0;
}

double copy_bandwidth(const OptionOverrides &options)
{
  constexpr std::size_t bytes = std::size_t{256} << 20;
  const auto backend =
      make_backend(options.backend.value_or("cpu"), options.device.value_or(0), options.threads.value_or(0));
  const Buffer from = backend->allocate(bytes), to = backend->allocate(bytes);
  backend->fill(from, 1, bytes);
  backend->copy(to, from, bytes);
  backend->synchronize();
  std::vector<double> seconds;
  for (int i = 0; i < 5; ++i) {
    const Clock one;
    backend->copy(to, from, bytes);
    backend->synchronize();
    seconds.push_back(one.seconds());
  }
  backend->release(from);
  backend->release(to);
  return 2.0 * static_cast<double>(bytes) / *std::min_element(seconds.begin(), seconds.end()) * 1e-9;
}

Measurement measure(const Settings &settings, int resolution)
{
  Scene scene = Scene::load(settings.scene, resolution);
  if (scene.time_step == 0) scene.time_step = chosen_time_step(Options::at(Accuracy::paper), scene);
  Simulation simulation(scene, settings.options);
  Samples samples;
  Measurement m;
  m.scene = scene.name;
  m.options = simulation.options();
  m.time_step = simulation.time_step();
  m.device = simulation.backend().device();
  m.triangles = simulation.cloth_triangle_count();
  try {
    run_steps(settings, simulation, samples, m);
  } catch (const Error &error) {
    m.error = error.what();
  }
  samples.store(m);
  m.intersections = std::max(m.intersections, simulation.count_intersections());
  m.peak_mib = static_cast<double>(simulation.peak_memory_bytes()) / (1 << 20);
  m.hash = simulation.state_hash();
  return m;
}

}  // namespace cama::benchmark
