// SPDX-License-Identifier: Apache-2.0
// The shipped scenes at small size: every folder of scenes/ that has a scene.json, so that added scenes are covered
// without a new test.
#pragma once
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <string>
#include <tuple>
#include <vector>

#include "../catch.hpp"
#include "../engine.hpp"
#include "../precision.hpp"
#include "cama/simulation.hpp"

namespace shipped {

/// Every value of Options::precision.
inline const std::vector<std::string> precisions = {"double", "mixed", "single"};

/// Whether a scene has a generated body, drum, coat or trousers, which the Python package makes.
inline bool needs_python(const std::filesystem::path &file)
{
  std::ifstream stream(file);
  const std::string text{std::istreambuf_iterator<char>(stream), {}};
  const std::vector<std::string> made{"body", "drum", "coat", "trousers"};
  return std::any_of(made.begin(), made.end(),
                     [&](const std::string &key) { return text.find('"' + key + "\": {") != std::string::npos; });
}

/// Sorted names of the scenes that the library reads by itself.
inline std::vector<std::string> scenes()
{
  std::vector<std::string> names;
  for (const auto &entry : std::filesystem::directory_iterator(std::filesystem::path(CAMA_SOURCE_DIR) / "scenes"))
    if (std::filesystem::exists(entry.path() / "scene.json") && !needs_python(entry.path() / "scene.json"))
      names.push_back(entry.path().filename().string());
  std::sort(names.begin(), names.end());
  return names;
}

/// The scene with about `triangles` triangles of cloth and the paper's time step. Read once.
inline const cama::Scene &load(const std::string &name, int triangles)
{
  static std::map<std::pair<std::string, int>, cama::Scene> loaded;
  const auto found = loaded.find({name, triangles});
  if (found != loaded.end()) return found->second;
  cama::Scene scene = cama::Scene::load(std::filesystem::path(CAMA_SOURCE_DIR) / "scenes" / name, triangles);
  scene.time_step = cama::chosen_time_step(cama::Options::at(cama::Accuracy::paper), scene);
  return loaded.emplace(std::pair{name, triangles}, std::move(scene)).first->second;
}

inline cama::Options options(const std::string &accuracy, const std::string &precision, const std::string &backend,
                             int threads = 0)
{
  cama::Options o = cama::Options::at(cama::accuracy_level(accuracy));
  o.precision = precision_of(precision);
  o.backend = backend;
  o.threads = backend == "cpu" ? threads : 0;
  return o;
}

/// A moment of a run.
struct Moment {
  int step = 0, contacts = 0;
  std::vector<cama::dvec3> position, velocity;   ///< of all vertices
};

/// The moment a few steps after a serial run first has at least `contacts` contacts, at the latest after `most` steps.
inline const Moment &in_contact(const std::string &name, int triangles, int contacts, int most)
{
  static std::map<std::tuple<std::string, int, int, int>, Moment> known;
  Moment &moment = known[{name, triangles, contacts, most}];
  if (!moment.position.empty()) return moment;
  cama::Simulation simulation(load(name, triangles), options("production", "double", "cpu", 1));
  int left = most;
  for (int more = 5; left > 0 && more > 0; --left) {
    simulation.step();
    if (simulation.report().contacts >= contacts) --more;
  }
  return moment = {simulation.step_count(), simulation.report().contacts, simulation.positions(),
                   simulation.velocities()};
}

/// Sets the engine to that moment.
inline void start_at(StagedEngine &engine, const Moment &moment)
{
  engine.state.mesh.position.assign(moment.position);
  engine.state.mesh.position_next.assign(moment.position);
  engine.state.mesh.velocity.assign(moment.velocity);
  engine.state.mesh.velocity_next.assign(moment.velocity);
  engine.state.report.step = moment.step;
  engine.end_step();
}

}  // namespace shipped
