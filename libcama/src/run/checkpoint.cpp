// SPDX-License-Identifier: Apache-2.0
#include "run/checkpoint.hpp"

#include <cmath>
#include <string>

#include "cama/error.hpp"
#include "device/fnv.hpp"

namespace cama {
namespace {

constexpr int max_terms = 1 << 29;   // with four entries each, the largest list

[[noreturn]] void refuse(const std::string &what) { throw SceneError("checkpoint: " + what); }

void check_vectors(const std::string &name, const std::vector<dvec3> &values, std::size_t count,
                   const char *of = " vertices")
{
  if (values.size() != count)
    refuse(name + " has " + std::to_string(values.size()) + " rows, the scene has " + std::to_string(count) + of);
  for (std::size_t i = 0; i < count; ++i)
    if (!std::isfinite(values[i].x + values[i].y + values[i].z))
      refuse(name + "[" + std::to_string(i) + "] is not finite");
}

constexpr int most_features = 0x7fffffff;

key64 key_of(const std::array<int, 3> &pair)
{
  const auto wide = [&](std::size_t k) { return static_cast<key64>(pair[k]); };
  return wide(0) << 62 | wide(1) << 31 | wide(2);  // as coded_pairs
}

void check_friction(const Checkpoint &c)
{
  if (c.friction_pair.size() != c.friction_force.size())
    refuse("friction_pair has " + std::to_string(c.friction_pair.size()) + " rows, friction_force " +
           std::to_string(c.friction_force.size()));
  for (std::size_t i = 0; i < c.friction_pair.size(); ++i) {
    const auto &[kind, a, b] = c.friction_pair[i];
    if (kind < 0 || kind > 1 || a < 0 || b < 0 || (i > 0 && key_of(c.friction_pair[i - 1]) >= key_of({kind, a, b})))
      refuse("friction_pair[" + std::to_string(i) + "] is not a pair, or not in order");
  }
  check_vectors("friction_force", c.friction_force, c.friction_pair.size());
}

/// Checks that blocks are not empty and that each level consists of the blocks below.
void check_matching(const Matching &m, int step, const State &state)
{
  if (m.step < 0 || m.step > step || m.terms < 0 || m.terms > max_terms || m.first_iterations < 0 ||
      m.last_iterations < 0)
    refuse("matching: step " + std::to_string(m.step) + ", " + std::to_string(m.terms) + " terms, " +
           std::to_string(m.first_iterations) + " and " + std::to_string(m.last_iterations) +
           " iterations are not counts of this run");
  std::vector<char> seen(static_cast<std::size_t>(state.mesh.cloth_vertices), 0);
  for (int v : m.order)
    if (v < 0 || v >= state.mesh.cloth_vertices || seen[static_cast<std::size_t>(v)]++)
      refuse("matching: vertex " + std::to_string(v) + " is not one of the cloth, or appears twice");
  if (m.order.empty() != m.levels.empty()) refuse("matching: has an order without levels, or levels without an order");
  std::size_t nodes = m.order.size();
  for (std::size_t l = 0; l < m.levels.size(); ++l) {
    const Matching::Level &level = m.levels[l];
    const std::string name = "matching: level " + std::to_string(l);
    if (level.parent.size() != nodes || level.start.size() < 2 || level.start.front() != 0 ||
        level.start.back() != static_cast<int>(nodes))
      refuse(name + " does not have " + std::to_string(nodes) + " nodes");
    for (std::size_t b = 0; b + 1 < level.start.size(); ++b) {
      const int first = level.start[b], last = level.start[b + 1];
      if (first < 0 || last <= first || last > static_cast<int>(nodes) || last - first > BLOCK_ROWS)
        refuse(name + ", block " + std::to_string(b) + " is not a block");
      for (int i = first; i < last; ++i)
        if (level.parent[static_cast<std::size_t>(i)] != static_cast<int>(b))
          refuse(name + ", node " + std::to_string(i) + " is not in its block");
    }
    nodes = level.start.size() - 1;
  }
}

}  // namespace

std::uint64_t scene_key(const Topology &t)
{
  const auto bytes = [](const auto &values) { return sizeof(values[0]) * values.size(); };
  const std::uint64_t hash = fnv1a(t.object.data(), bytes(t.object), fnv1a(t.face.data(), bytes(t.face)));
  return fnv1a(t.mass.data(), bytes(t.mass), hash);
}

Checkpoint take_checkpoint(State &s, Pipeline &step, const Topology &topology)
{
  Checkpoint c;
  c.scene = scene_key(topology);
  c.step = s.report.step;
  c.time_step = s.time.step;
  s.visit([&](const char *name, Life life, auto &value) {
    if (life != Life::run) return;
    using T = std::decay_t<decltype(value)>;
    if constexpr (!IsStream<T>::value) {
      c.numbers[name] = static_cast<double>(value);
    } else if constexpr (std::is_same_v<T, Stream<dvec3>>) {
      if (value.backend()) c.vectors[name] = value.download();
    }
  });
  const Exemptions::Kept kept = s.exemptions.kept();
  c.tangled.assign(kept.first.begin(), kept.first.end());
  c.let_go.assign(kept.second.begin(), kept.second.end());
  if (s.contact.kept.key.backend()) {
    for (const key64 key : s.contact.kept.key.download())
      c.friction_pair.push_back({static_cast<int>(key >> 62), static_cast<int>(key >> 31 & most_features),
                                 static_cast<int>(key & most_features)});
    c.friction_force = s.contact.kept.force.download();
  }
  step.save(s, c);
  return c;
}

void check_checkpoint(const Checkpoint &c, State &s, const Topology &t)
{
  const std::size_t vertices = static_cast<std::size_t>(s.mesh.vertices);
  for (const char *name : {"position", "velocity"})
    if (!c.vectors.count(name)) refuse(std::string("has no ") + name);
  const std::size_t found = c.vectors.at("position").size();
  if (found != vertices || c.scene != scene_key(t))
    refuse("is of another scene or resolution: " +
           (found == vertices
                ? "triangles, or masses of vertices, differ"
                : "it has " + std::to_string(found) + " vertices, this simulation has " + std::to_string(vertices)) +
           "; load the scene that it was taken from");
  const auto number = [&](const char *name) {
    const auto at = c.numbers.find(name);
    if (at == c.numbers.end()) refuse(std::string("has no ") + name);
    return at->second;
  };
  s.rigid.visit([&](const char *name, Life life, auto &) {
    if (life == Life::run && !c.numbers.count(name))
      refuse(std::string("has no ") + name + ": an obstacle that is rigid here was not in its run");
  });
  const double start_step = number("start_step");
  if (c.step < 0 || !(start_step >= 0) || start_step > c.step)
    refuse("step " + std::to_string(c.step) + " and start_step " + std::to_string(start_step) + " are not counts");
  const auto smoothed = c.numbers.find("smoothed_steps");   // an earlier version did not know it
  if (smoothed != c.numbers.end() && !(smoothed->second >= 0 && smoothed->second <= most_smoothed_steps))
    refuse("smoothed_steps " + std::to_string(smoothed->second) + " is not a count up to " +
           std::to_string(most_smoothed_steps));
  if (!std::isfinite(number("time")) || number("time") < 0 || !std::isfinite(number("start_time")) ||
      !std::isfinite(c.time_step) || c.time_step <= 0 || std::isnan(c.released))
    refuse("time, start_time, time_step or released is not a time in seconds");
  for (const auto &[name, value] : c.numbers)
    if (!std::isfinite(value)) refuse(name + " is not finite");
  for (const auto &[name, values] : c.vectors)
    if (name == "plastic_curvature")
      check_vectors(name, values, t.triangle.size(), " triangles of cloth");
    else
      check_vectors(name, values, vertices);
  const auto in = [](int i, std::size_t count) { return i >= 0 && static_cast<std::size_t>(i) < count; };
  for (const auto &[a, b] : c.tangled)
    if (!in(a, vertices) || !in(b, vertices))
      refuse("tangled: a vertex of " + std::to_string(a) + ", " + std::to_string(b) + " is not there");
  for (const auto &[a, object] : c.let_go)
    if (!in(a, vertices) || !in(object, s.mesh.object_name.size()))
      refuse("let_go: vertex or object of " + std::to_string(a) + ", " + std::to_string(object) + " is not there");
  if ((!c.tangled.empty() || !c.let_go.empty()) && !s.exemptions.row.backend())
    refuse(
        "has pairs that are exempt from contact, which this simulation's options do not allow; set intersections and "
        "pinch as in its run");
  check_friction(c);
  check_matching(c.matching, c.step, s);
}

void restore_checkpoint(const Checkpoint &c, State &s, Pipeline &step)
{
  step.restore(s, c);
  s.visit([&](const char *name, Life life, auto &value) {
    using T = std::decay_t<decltype(value)>;
    if (life != Life::run) return;
    if constexpr (!IsStream<T>::value) {
      const auto at = c.numbers.find(name);   // an earlier version did not know all
      value = at != c.numbers.end() ? static_cast<T>(at->second) : T{};
    } else if constexpr (std::is_same_v<T, Stream<dvec3>>) {
      const auto at = c.vectors.find(name);
      if (!value.backend()) return;
      if (at != c.vectors.end())
        value.assign(at->second);
      else
        value.fill_zero();
    }
  });
  s.mesh.position_next.assign(c.vectors.at("position"));
  if (s.time.error > 0) s.time.step = c.time_step;   // the first step of a run begins with a guess
  const bool same = c.time_step == s.time.step;
  s.time.history = s.time.history && s.mesh.position_before.backend() && c.vectors.count("position_before");
  if (!same) {
    s.time.start_step = c.step;
    s.time.start = s.time.now;
  }
  Exemptions::Kept kept{{c.tangled.begin(), c.tangled.end()}, {c.let_go.begin(), c.let_go.end()}};
  s.exemptions.keep(kept);
  s.contact.forget();
  if (s.contact.kept.key.backend()) {
    std::vector<key64> keys;
    for (const auto &pair : c.friction_pair) keys.push_back(key_of(pair));
    s.contact.kept.key.assign(keys);
    s.contact.kept.force.assign(c.friction_force);
  }
  s.report = StepReport{};
  s.report.step = c.step;
  s.report.time = s.time.now;
}

}  // namespace cama
