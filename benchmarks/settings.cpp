// SPDX-License-Identifier: Apache-2.0
#include "settings.hpp"

#include <algorithm>
#include <functional>
#include <sstream>

#include "cama/error.hpp"

namespace cama::benchmark {
namespace {

using Set = std::function<void(Settings &, const std::string &)>;
struct Entry {
  const char *name, *values;
  bool option;
  Set set;
};   // option: of cama::Options, and part of Settings::changed

[[noreturn]] void refuse(const std::string &value, const std::string &wanted)
{
  throw SceneError("\"" + value + "\" is not " + wanted);
}

double number(const std::string &value)
{
  std::size_t end = 0;
  double x = 0;
  try {
    x = std::stod(value, &end);
  } catch (const std::exception &) {
    end = 0;
  }
  if (end == 0 || end != value.size()) refuse(value, "a number");
  return x;
}

int whole(const std::string &value)
{
  const double x = number(value);
  if (x != static_cast<int>(x)) refuse(value, "a whole number");
  return static_cast<int>(x);
}

bool flag(const std::string &value)
{
  if (value != "0" && value != "1") refuse(value, "0 or 1");
  return value == "1";
}

std::vector<int> list(const std::string &value)
{
  std::vector<int> numbers;
  std::istringstream stream(value);
  for (std::string item; std::getline(stream, item, ',');) numbers.push_back(whole(item));
  if (numbers.empty()) refuse(value, "a list of numbers");
  return numbers;
}

/// Entries of cama::Options.
Entry integer(const char *name, int Options::*member)
{
  return {name, "N", true, [member](Settings &s, const std::string &v) { s.options.*member = whole(v); }};
}
Entry boolean(const char *name, bool Options::*member)
{
  return {name, "0|1", true, [member](Settings &s, const std::string &v) { s.options.*member = flag(v); }};
}

template <class Enum> struct Word {
  const char *name;
  Enum value;
};

/// One of a few words; `values` is them as "a|b|c".
template <class Enum>
Entry choice(const char *name, Enum Options::*member, const char *values, std::vector<Word<Enum>> words)
{
  return {name, values, true, [member, values, words](Settings &s, const std::string &v) {
            const auto word =
                std::find_if(words.begin(), words.end(), [&](const Word<Enum> &w) { return v == w.name; });
            if (word == words.end()) refuse(v, std::string("one of ") + values);
            s.options.*member = word->value;
          }};
}

Entry choose_wait()
{
  return {"wait", "alternate|always|never", false, [](Settings &s, const std::string &v) {
            if (v == "alternate")
              s.wait = Wait::alternate;
            else if (v == "always")
              s.wait = Wait::always;
            else if (v == "never")
              s.wait = Wait::never;
            else
              refuse(v, "one of alternate|always|never");
          }};
}

const std::vector<Entry> &entries()
{
  const auto skip = [](Settings &s, const std::string &v) { s.skip = whole(v); };
  static const std::vector<Entry> all = {
      {"resolutions", "N,N,...", false, [](Settings &s, const std::string &v) { s.resolutions = list(v); }},
      {"time_step", "SECONDS", false, [](Settings &s, const std::string &v) { s.time_step = number(v); }},
      {"skip", "N", false, skip},
      {"warmup", "N", false, skip},
      {"steps", "N", false, [](Settings &s, const std::string &v) { s.steps = whole(v); }},
      {"limit", "SECONDS", false, [](Settings &s, const std::string &v) { s.limit = number(v); }},
      {"bandwidth", "GB/s", false, [](Settings &s, const std::string &v) { s.bandwidth = number(v); }},
      {"header", "0|1", false, [](Settings &s, const std::string &v) { s.header = flag(v); }},
      choose_wait(),
      {"accuracy", "preview|interactive|production|accurate|reference|paper", false,
       [](Settings &, const std::string &) {}},   // read first, see parse_settings
      {"backend", "auto|cpu|opencl|cuda", false, [](Settings &s, const std::string &v) { s.options.backend = v; }},
      {"device", "N", false, [](Settings &s, const std::string &v) { s.options.device = whole(v); }},
      {"threads", "N", false, [](Settings &s, const std::string &v) { s.options.threads = whole(v); }},
      {"precision", "double|mixed|single", false, [](Settings &s, const std::string &v) { s.options.precision = v; }},
      {"audit", "0|1", false, [](Settings &s, const std::string &v) { s.options.audit = flag(v); }},
      choice<Assembly>(
          "assembly", &Options::assembly, "gather|algorithm1|sorted",
          {{"gather", Assembly::gather}, {"algorithm1", Assembly::algorithm1}, {"sorted", Assembly::sorted}}),
      boolean("atomic_filling", &Options::atomic_filling),
      choice<ContactForm>("contact_form", &Options::contact_form, "rank_one|star",
                          {{"rank_one", ContactForm::rank_one}, {"star", ContactForm::star}}),
      boolean("anticipate_contacts", &Options::anticipate_contacts),
      choice<SearchKind>("search", &Options::search, "tree|fronts",
                         {{"tree", SearchKind::tree}, {"fronts", SearchKind::fronts}}),
      boolean("localized_search", &Options::localized_search),
      choice<Preconditioner>("preconditioner", &Options::preconditioner, "none|jacobi|block_jacobi|schwarz",
                             {{"none", Preconditioner::none},
                              {"jacobi", Preconditioner::jacobi},
                              {"block_jacobi", Preconditioner::block_jacobi},
                              {"schwarz", Preconditioner::schwarz}}),
      choice<LinearSolver>(
          "solver", &Options::solver, "conjugate_gradient|direct",
          {{"conjugate_gradient", LinearSolver::conjugate_gradient}, {"direct", LinearSolver::direct}}),
      {"tolerance", "NUMBER", true, [](Settings &s, const std::string &v) { s.options.tolerance = number(v); }},
      integer("max_iterations", &Options::max_iterations),
      integer("max_impact_passes", &Options::max_impact_passes),
      boolean("linear_impacts", &Options::linear_impacts),
      boolean("cubic_impacts", &Options::cubic_impacts),
      boolean("commit", &Options::commit),
      boolean("arcsim_conventions", &Options::arcsim_conventions),
      choice<StartPolicy>(
          "intersections", &Options::intersections, "reject|exempt|untangle",
          {{"reject", StartPolicy::reject}, {"exempt", StartPolicy::exempt}, {"untangle", StartPolicy::untangle}}),
      choice<Pinch>("pinch", &Options::pinch, "stop|release", {{"stop", Pinch::stop}, {"release", Pinch::release}}),
  };
  return all;
}

void set(Settings &settings, const std::string &name, const std::string &value)
{
  for (const Entry &entry : entries()) {
    if (name != entry.name) continue;
    try {
      entry.set(settings, value);
    } catch (const SceneError &error) {
      throw SceneError(name + ": " + error.what());
    }
    if (entry.option) settings.changed += (settings.changed.empty() ? "" : " ") + name + "=" + value;
    return;
  }
  throw SceneError(name + ": is not known; names are\n" + settings_help());
}

}  // namespace

std::string settings_help()
{
  std::string help;
  for (const Entry &entry : entries()) help += std::string("  ") + entry.name + "=" + entry.values + "\n";
  return help;
}

Settings parse_settings(int count, const char *const *arguments)
{
  Settings settings;
  std::vector<std::pair<std::string, std::string>> given;
  for (int i = 1; i < count; ++i) {
    const std::string argument = arguments[i];
    const std::size_t equals = argument.find('=');
    if (equals != std::string::npos)
      given.emplace_back(argument.substr(0, equals), argument.substr(equals + 1));
    else if (settings.scene.empty())
      settings.scene = argument;
    else
      throw SceneError(argument + ": give it as name=value; names are\n" + settings_help());
  }
  if (settings.scene.empty())
    throw SceneError("usage: step_times SCENE [name=value ...]; names are\n" + settings_help());
  settings.options.backend = "cpu";
  for (const auto &[name, value] : given)   // the preset sets the options that the others change
    if (name == "accuracy") {
      settings.options = Options::preset(value);
      settings.options.backend = "cpu";
    }
  for (const auto &[name, value] : given) set(settings, name, value);
  if (settings.steps < 1 || settings.skip < 0) throw SceneError("steps: must be 1 or more, skip 0 or more");
  return settings;
}

}  // namespace cama::benchmark
