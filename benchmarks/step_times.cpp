// SPDX-License-Identifier: Apache-2.0
// step_times SCENE RESOLUTION STEPS [backend=cpu] [precision=double] [accuracy=production] [device=0] [threads=0]
// One CSV row per stage: median milliseconds a step, and for the whole step iterations, launches, intersections and the state hash.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <string>
#include <vector>

#include "cama/error.hpp"
#include "cama/simulation.hpp"

namespace {

double median(std::vector<double> values)
{
  std::sort(values.begin(), values.end());
  return values.empty() ? 0 : values[values.size() / 2];
}

std::string option(int argc, char **argv, const std::string &name, const std::string &otherwise)
{
  for (int i = 4; i < argc; ++i)
    if (std::string(argv[i]).rfind(name + "=", 0) == 0) return argv[i] + name.size() + 1;
  return otherwise;
}

int measure(int argc, char **argv)
{
  const int steps = std::atoi(argv[3]);
  const cama::Scene scene = cama::Scene::load(argv[1], std::atoi(argv[2]));
  cama::Options options = cama::Options::preset(option(argc, argv, "accuracy", "production"));
  options.backend = option(argc, argv, "backend", "cpu");
  options.precision = option(argc, argv, "precision", options.precision);
  options.device = std::atoi(option(argc, argv, "device", "0").c_str());
  options.threads = std::atoi(option(argc, argv, "threads", "0").c_str());
  cama::Simulation simulation(scene, options);
  std::vector<std::string> order;
  std::map<std::string, std::vector<double>> times;
  std::vector<double> iterations;
  const long launches = simulation.backend().launches();
  for (int i = 0; i < steps; ++i) {
    simulation.step();
    iterations.push_back(simulation.report().iterations);
    std::string outer;
    for (const cama::StageTime &t : simulation.timings()) {
      if (t.depth <= 1) outer = t.name;
      const std::string name = t.depth <= 1 ? t.name : outer + "/" + t.name;
      if (!times.count(name)) order.push_back(name);
      times[name].push_back(t.milliseconds);
    }
  }
  for (const std::string &name : order)
    std::printf("%s,%d,%s,%s,%s,\"%s\",%.4f\n", scene.name.c_str(), simulation.cloth_triangle_count(), options.backend.c_str(),
                options.precision.c_str(), options.accuracy.c_str(), name.c_str(), median(times[name]));
  std::printf("# %s on %s: %d triangles, median %.0f iterations, %.0f launches a step, %d intersections, peak %.0f MiB, hash %016llx\n",
              scene.name.c_str(), simulation.backend().device().c_str(), simulation.cloth_triangle_count(), median(iterations),
              double(simulation.backend().launches() - launches) / std::max(steps, 1), simulation.count_intersections(),
              double(simulation.peak_memory_bytes()) / (1 << 20), static_cast<unsigned long long>(simulation.state_hash()));
  return 0;
}

}  // namespace

int main(int argc, char **argv)
{
  if (argc < 4) {
    std::fprintf(stderr, "usage: step_times SCENE RESOLUTION STEPS [backend=] [precision=] [accuracy=] [device=] [threads=]\n");
    return 2;
  }
  try {
    return measure(argc, argv);
  } catch (const cama::Error &error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
}
