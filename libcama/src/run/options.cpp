// SPDX-License-Identifier: Apache-2.0
// Accuracy levels: what one word sets, and what of it was chosen by whom.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "cama/error.hpp"
#include "cama/simulation.hpp"

namespace cama {
namespace {

/// Mean length of the edges of all cloth triangles, in the material where that is known, m.
double mean_edge(const Scene &scene)
{
  double sum = 0, count = 0;
  for (const Cloth &cloth : scene.cloths) {
    const Mesh &m = cloth.mesh;
    const bool rest = !m.material_face.empty();
    for (const Triangle &f : rest ? m.material_face : m.face)
      for (std::size_t k = 0; k < 3; ++k, ++count) {
        const auto a = static_cast<std::size_t>(f[k]), b = static_cast<std::size_t>(f[(k + 1) % 3]);
        if (rest)
          sum += std::hypot(m.material_position.at(a)[0] - m.material_position.at(b)[0],
                            m.material_position.at(a)[1] - m.material_position.at(b)[1]);
        else
          sum += kernels::dnorm(kernels::dsub(m.position.at(a), m.position.at(b)));
      }
  }
  return count > 0 ? sum / count : 0;
}

/// Ten steps h of backward Euler leave a motion of constant acceleration a off by 5 a h^2: by a hundredth of an edge
/// where h^2 = edge / (500 a). a = 300 m/s^2 by measurement (docs/accuracy.md); from 1/960 s down to a third of it.
double step_for_edges(const Scene &scene)
{
  constexpr double acceleration = 300, longest = 1.0 / 960;
  return std::clamp(std::sqrt(mean_edge(scene) / (500 * acceleration)), longest / 3, longest);
}

/// Time step of a level, s.
double level_time_step(const std::string &accuracy, const Scene &scene)
{
  if (accuracy == "preview") return 1.0 / 120;
  if (accuracy == "interactive") return 1.0 / 240;
  if (accuracy == "production") return step_for_edges(scene);
  if (accuracy == "accurate") return step_for_edges(scene) / 5;
  if (accuracy == "reference") return step_for_edges(scene) / 20;
  return 1.0 / 200;   // the paper's
}

bool finer(const std::string &accuracy) { return accuracy == "accurate" || accuracy == "reference"; }

/// Whether the level takes a scene's own time step as it is.
bool takes_own_step(const std::string &accuracy) { return accuracy == "production" || accuracy == "paper"; }

std::string number(double value)
{
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

const char *word(Integrator i) { return i == Integrator::bdf2 ? "bdf2" : "backward_euler"; }
const char *word(ContactRefresh r) { return r == ContactRefresh::iteration ? "iteration" : "step"; }
const char *word(bool b) { return b ? "true" : "false"; }

}  // namespace

const std::vector<std::string> &accuracy_levels()
{
  static const std::vector<std::string> names = {"preview",  "interactive", "production",
                                                 "accurate", "reference",   "paper"};
  return names;
}

Options Options::preset(const std::string &accuracy)
{
  Options o;
  o.accuracy = accuracy;
  if (accuracy == "production") return o;
  if (accuracy == "preview" || accuracy == "interactive") {
    const bool preview = accuracy == "preview";
    o.precision = "single";
    o.tolerance = preview ? 1e-1 : 3e-2;
    o.max_iterations = preview ? 24 : 80;
    o.max_impact_passes = preview ? 2 : 4;
    return o;
  }
  if (accuracy == "accurate") {
    o.integrator = Integrator::bdf2;
    o.newton_iterations = 4;
    o.newton_tolerance = 1e-3;
    o.tolerance = 1e-2;   // of each of Newton's solves: a tighter one changes nothing
    return o;
  }
  if (accuracy == "reference") {
    o.precision = "double";
    o.integrator = Integrator::bdf2;
    o.newton_iterations = 40;
    o.newton_tolerance = 1e-8;
    o.tolerance = 1e-3;   // Newton's tolerance decides
    o.max_iterations = 20000;
    o.max_impact_passes = 100;
    o.contact_refresh = ContactRefresh::iteration;
    return o;
  }
  if (accuracy == "paper") {
    o.assembly = Assembly::algorithm1;
    o.contact_form = ContactForm::star;
    o.anticipate_contacts = false;
    o.precision = "double";
    o.preconditioner = Preconditioner::jacobi;
    o.tolerance = 1e-6;
    o.max_iterations = 20000;   // 3,000 at 200,000 triangles; they grow with the square root
    o.max_impact_passes = 100;
    o.search = SearchKind::fronts;
    o.linear_impacts = true;
    o.cubic_impacts = true;
    o.commit = false;
    return o;
  }
  std::string names;
  for (const std::string &name : accuracy_levels())
    names += (names.empty() ? "" : name == accuracy_levels().back() ? " or " : ", ") + name;
  throw SceneError("accuracy: '" + accuracy + "' is not known; use " + names);
}

double chosen_time_step(const Options &options, const Scene &scene)
{
  if (options.time_step > 0) return options.time_step;
  if (scene.time_step > 0 && takes_own_step(options.accuracy)) return scene.time_step;
  double step = level_time_step(options.accuracy, scene);
  if (scene.time_step > 0 && finer(options.accuracy)) step = std::min(step, scene.time_step);
  const double frame = scene.frame_time > 0 ? scene.frame_time : std::max(scene.seconds_per_frame(), step);
  return frame / std::ceil(frame / step * (1 - 1e-9));
}

std::vector<Setting> settings(const Options &o, const Scene &scene)
{
  const Options level = Options::preset(o.accuracy);
  std::vector<Setting> list;
  const auto add = [&](const char *name, const std::string &value, bool own, const char *trades) {
    list.push_back({name, value, own ? "user" : "level", trades});
  };
  const double step = chosen_time_step(o, scene);
  list.push_back({"time_step", number(step) + " s",
                  step == chosen_time_step(level, scene)
                      ? (scene.time_step > 0 && takes_own_step(o.accuracy) ? "scene" : "level")
                      : "user",
                  "error of the motion, damping of wrinkles"});
  add("integrator", word(o.integrator), o.integrator != level.integrator, "order in the time step, damping");
  add("newton_iterations", std::to_string(o.newton_iterations), o.newton_iterations != level.newton_iterations,
      "nonlinear equation of a step");
  add("newton_tolerance", number(o.newton_tolerance), o.newton_tolerance != level.newton_tolerance,
      "when Newton's method ends early");
  add("tolerance", number(o.tolerance), o.tolerance != level.tolerance, "linear solve");
  add("max_iterations", std::to_string(o.max_iterations), o.max_iterations != level.max_iterations,
      "budget of a linear solve");
  add("precision", o.precision, o.precision != level.precision, "rounding of forces, matrix and solve");
  add("contact_refresh", word(o.contact_refresh), o.contact_refresh != level.contact_refresh,
      "closest points while contacts slide");
  add("anticipate_contacts", word(o.anticipate_contacts), o.anticipate_contacts != level.anticipate_contacts,
      "impacts left to the projection");
  add("max_impact_passes", std::to_string(o.max_impact_passes), o.max_impact_passes != level.max_impact_passes,
      "motion that the commit cuts");
  add("commit", word(o.commit), o.commit != level.commit, "the certificate itself");
  return list;
}

}  // namespace cama
