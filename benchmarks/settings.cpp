// SPDX-License-Identifier: Apache-2.0
#include "settings.hpp"

#include <functional>
#include <sstream>

#include "cama/error.hpp"

namespace cama::benchmark {
namespace {

using Set = std::function<void(Settings &, const std::string &)>;
struct Entry {
  const char *name, *values;
  Set set;
};

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

/// Arguments that are not options of the simulation.
const std::vector<Entry> &entries()
{
  static const std::vector<Entry> all = {
      {"resolutions", "N,N,...", [](Settings &s, const std::string &v) { s.resolutions = list(v); }},
      {"skip", "N", [](Settings &s, const std::string &v) { s.skip = whole(v); }},
      {"steps", "N", [](Settings &s, const std::string &v) { s.steps = whole(v); }},
      {"limit", "SECONDS", [](Settings &s, const std::string &v) { s.limit = number(v); }},
      {"bandwidth", "GB/s", [](Settings &s, const std::string &v) { s.bandwidth = number(v); }},
      {"header", "0|1", [](Settings &s, const std::string &v) { s.header = flag(v); }},
      {"wait", "alternate|always|never",
       [](Settings &s, const std::string &v) {
         if (v == "alternate")
           s.wait = Wait::alternate;
         else if (v == "always")
           s.wait = Wait::always;
         else if (v == "never")
           s.wait = Wait::never;
         else
           refuse(v, "one of alternate|always|never");
       }},
  };
  return all;
}

/// Options that have a column in the table, or that do not influence the result.
bool shown_elsewhere(const std::string &option)
{
  for (const char *name : {"accuracy", "backend", "device", "threads", "precision", "audit", "time_step"})
    if (option == name) return true;
  return false;
}

void set(Settings &settings, const std::string &name, const std::string &value)
{
  for (const Entry &entry : entries()) {
    if (name != entry.name) continue;
    try {
      return entry.set(settings, value);
    } catch (const SceneError &error) {
      throw SceneError(name + ": " + error.what());
    }
  }
  settings.options.set_text(name, value);
  if (!shown_elsewhere(name)) settings.changed += (settings.changed.empty() ? "" : " ") + name + "=" + value;
}

/// "schwarz|jacobi", "0|1", "NUMBER"
std::string values_of(const OptionInfo &option)
{
  if (option.type == "boolean") return "0|1";
  if (option.type == "integer") return "N";
  if (option.type == "number") return "NUMBER";
  std::string words;
  for (const std::string &word : option.words) words += (words.empty() ? "" : "|") + word;
  return words.empty() ? "TEXT" : words;
}

}  // namespace

std::string settings_help()
{
  std::string help;
  for (const Entry &entry : entries()) help += std::string("  ") + entry.name + "=" + entry.values + "\n";
  for (const OptionInfo &option : option_table()) help += "  " + option.name + "=" + values_of(option) + "\n";
  return help;
}

Settings parse_settings(int count, const char *const *arguments)
{
  Settings settings;
  settings.options.backend = "cpu";
  settings.options.accuracy = Accuracy::production;   // regardless of the scene
  for (int i = 1; i < count; ++i) {
    const std::string argument = arguments[i];
    const std::size_t equals = argument.find('=');
    if (equals != std::string::npos)
      set(settings, argument.substr(0, equals), argument.substr(equals + 1));
    else if (settings.scene.empty())
      settings.scene = argument;
    else
      throw SceneError(argument + ": give it as name=value; names are\n" + settings_help());
  }
  if (settings.scene.empty())
    throw SceneError("usage: step_times SCENE [name=value ...]; names are\n" + settings_help());
  if (settings.steps < 1 || settings.skip < 0) throw SceneError("steps: must be 1 or more, skip 0 or more");
  return settings;
}

}  // namespace cama::benchmark
