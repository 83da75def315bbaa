// SPDX-License-Identifier: Apache-2.0
// The table of options: conversion to and from text, checks, levels, and who chose which value.
#include "cama/options.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "cama/error.hpp"
#include "cama/scene.hpp"
#include "run/step_control.hpp"

namespace cama {
namespace {

constexpr double unlimited = 1e300;

struct Range {
  double low = -unlimited, high = unlimited;
  bool open = false;   // without its bounds
  bool holds(double x) const { return open ? x > low && x < high : x >= low && x <= high; }

  static Range at_least(double low) { return {low, unlimited, false}; }
  static Range inside(double low, double high) { return {low, high, true}; }
};

enum class SetBy { scene, user };

template <class T> struct Word {
  const char *text;
  T value;
};

/// The words of a choice, in the order of their values.
template <class T> const std::vector<Word<T>> &words();
#define CAMA_WORD_AS(word, text) {text, T::word},
#define CAMA_WORD(word) CAMA_WORD_AS(word, #word)
#define CAMA_CHOICE(Type, list)                      \
  template <> const std::vector<Word<Type>> &words() \
  {                                                  \
    using T = Type;                                  \
    static const std::vector<Word<T>> all = {list};  \
    return all;                                      \
  }
#include "cama/options.def"
#undef CAMA_WORD
#undef CAMA_WORD_AS

/// The values of levels that differ from the default.
template <class T> struct Levels {
  std::vector<std::pair<Accuracy, T>> own;
  Levels &&at(Accuracy level, T value) &&
  {
    own.emplace_back(level, value);
    return std::move(*this);
  }
};

template <class T> struct Row {
  const char *name;
  T value;   // the default
  Levels<T> levels;
  Range range;
  const char *unit;
  SetBy set_by;
  const char *trades, *help;

  T at(Accuracy level) const
  {
    for (const auto &[own, value_there] : levels.own)
      if (own == level) return value_there;
    return value;
  }
};

/// Calls f(row, member) for every option; member(o) is the option in an Options or in OptionOverrides.
template <class F> void for_each_option(F &&f)
{
#define AT(level, value) .at(Accuracy::level, value)
#define ANY \
  Range {}
#define AT_LEAST(x) Range::at_least(x)
#define INSIDE(x, y) Range::inside(x, y)
#define SCENE SetBy::scene
#define USER SetBy::user
#define CAMA_ROW(type, shown, member, value, levels, range, unit, set_by, trades, help) \
  f(Row<type>{shown, value, Levels<type>{} levels, range, unit, set_by, trades, help},  \
    [](auto &o) -> auto & { return o.member; });
#define CAMA_OPTION(type, name, ...) CAMA_ROW(type, #name, name, __VA_ARGS__)
#define CAMA_PAPER_OPTION(type, name, ...) CAMA_ROW(type, "paper." #name, paper.name, __VA_ARGS__)
#include "cama/options.def"
#undef CAMA_ROW
#undef AT
#undef ANY
#undef AT_LEAST
#undef INSIDE
#undef SCENE
#undef USER
}

std::string number(double value)
{
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

std::string listed(const std::vector<std::string> &names)
{
  std::string list;
  for (std::size_t i = 0; i < names.size(); ++i)
    list += (i == 0 ? "" : i + 1 == names.size() ? " or " : ", ") + names[i];
  return list;
}

std::string text_of(const Range &range)
{
  if (range.low == -unlimited) return "";
  if (range.high == unlimited) return number(range.low) + " or more";
  return "between " + number(range.low) + " and " + number(range.high) + (range.open ? ", both excluded" : "");
}

template <class T> std::vector<std::string> word_list()
{
  std::vector<std::string> list;
  if constexpr (std::is_enum_v<T>)
    for (const Word<T> &w : words<T>()) list.emplace_back(w.text);
  return list;
}

template <class T> OptionValue value_of(const T &value)
{
  if constexpr (std::is_enum_v<T>)
    return std::string(words<T>()[static_cast<std::size_t>(value)].text);
  else
    return value;
}

template <class T> const char *type_name()
{
  if constexpr (std::is_same_v<T, bool>)
    return "boolean";
  else if constexpr (std::is_same_v<T, int>)
    return "integer";
  else if constexpr (std::is_same_v<T, double>)
    return "number";
  else if constexpr (std::is_enum_v<T>)
    return "choice";
  else
    return "text";
}

[[noreturn]] void refuse(const std::string &name, const OptionValue &value, const std::string &wanted)
{
  const bool text = std::holds_alternative<std::string>(value);
  throw SceneError(name + ": " + (text ? "'" : "") + to_text(value) + (text ? "'" : "") + " is not " + wanted);
}

/// The value in the option's type. Throws SceneError.
template <class T> T checked(const Row<T> &row, const OptionValue &value)
{
  if constexpr (std::is_enum_v<T>) {
    if (const auto *text = std::get_if<std::string>(&value))
      for (const Word<T> &w : words<T>())
        if (*text == w.text) return w.value;
    refuse(row.name, value, "known; use " + listed(word_list<T>()));
  } else if constexpr (std::is_same_v<T, bool>) {
    if (const auto *flag = std::get_if<bool>(&value)) return *flag;
    refuse(row.name, value, "true or false");
  } else if constexpr (std::is_same_v<T, std::string>) {
    if (const auto *text = std::get_if<std::string>(&value)) return *text;
    refuse(row.name, value, "a text");
  } else {
    const int *whole = std::get_if<int>(&value);
    const double *real = std::get_if<double>(&value);
    const char *wanted = std::is_same_v<T, int> ? "a whole number" : "a number";
    if (!whole && (std::is_same_v<T, int> || !real)) refuse(row.name, value, wanted);
    const double x = whole ? *whole : *real;
    if (!std::isfinite(x)) refuse(row.name, value, "a finite number");
    if (!row.range.holds(x)) refuse(row.name, value, text_of(row.range));
    return static_cast<T>(x);
  }
}

/// "1e-4" or "1/200".
bool parse_number(const std::string &text, double &value)
{
  const std::size_t slash = text.find('/');
  const std::string head = text.substr(0, slash);
  char *end = nullptr;
  value = std::strtod(head.c_str(), &end);
  if (head.empty() || *end) return false;
  if (slash == std::string::npos) return true;
  const std::string tail = text.substr(slash + 1);
  const double divisor = std::strtod(tail.c_str(), &end);
  if (tail.empty() || *end || divisor == 0) return false;
  value /= divisor;
  return true;
}

/// The value of a text in the option's type, or the text itself if it is not a value of that type.
template <class T> OptionValue parsed(const std::string &text)
{
  if constexpr (std::is_same_v<T, bool>) {
    if (text == "true" || text == "1") return true;
    if (text == "false" || text == "0") return false;
  } else if constexpr (std::is_arithmetic_v<T>) {
    double x = 0;
    if (parse_number(text, x)) {
      if (std::is_same_v<T, int> && x == static_cast<int>(x)) return static_cast<int>(x);
      return x;
    }
  }
  return text;
}

std::size_t distance(const std::string &a, const std::string &b)   // Levenshtein
{
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = i - 1;
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t above = row[j];
      row[j] = std::min({above + 1, row[j - 1] + 1, diagonal + (a[i - 1] == b[j - 1] ? 0 : 1)});
      diagonal = above;
    }
  }
  return row[b.size()];
}

[[noreturn]] void refuse_name(const std::string &name)
{
  std::vector<std::string> names;
  std::string nearest;
  std::size_t fewest = 3;
  for_each_option([&](const auto &row, auto) {
    names.emplace_back(row.name);
    const bool paper = "paper." + name == row.name;
    const std::size_t edits = paper ? 0 : distance(name, row.name);
    if (edits < fewest) {
      fewest = edits;
      nearest = row.name;
    }
  });
  throw SceneError("option '" + name + "' is not known; " +
                   (nearest.empty() ? "there are " + listed(names) : "did you mean '" + nearest + "'?"));
}

/// Calls f(row, member) for the option with this name. Throws SceneError.
template <class F> void with_option(const std::string &name, F &&f)
{
  bool found = false;
  for_each_option([&](const auto &row, auto member) {
    if (found || name != row.name) return;
    found = true;
    f(row, member);
  });
  if (!found) refuse_name(name);
}

/// Throws SceneError for options that do not go together.
void check_together(const Options &o)
{
  if (o.paper.contact_form == ContactForm::star && o.paper.assembly == Assembly::gather)
    throw SceneError(
        "paper.contact_form: star needs its entries in the matrix; set paper.assembly to algorithm1 or sorted");
  if (o.paper.atomic_filling && o.paper.assembly != Assembly::algorithm1)
    throw SceneError(
        "paper.atomic_filling: needs paper.assembly algorithm1; set that too, or leave atomic_filling out");
}

bool sets_step(const OptionOverrides &o) { return o.time_step.value_or(0) > 0; }
bool sets_error(const OptionOverrides &o) { return o.error && !o.error->empty(); }

/// Whether time steps are chosen by an error. What the user sets goes before what the scene sets, that before the
/// level. Throws SceneError.
bool controls_error(const OptionOverrides &user, const OptionOverrides &of_scene, const Options &options,
                    const Scene &scene)
{
  for (const OptionOverrides *o : {&user, &of_scene}) {
    if (sets_step(*o) && sets_error(*o)) throw SceneError("options: give error or time_step, not both");
    if (sets_step(*o)) return false;
    if (sets_error(*o)) return true;
  }
  return scene.time_step <= 0 && !options.error.empty();
}

bool names_level(const OptionOverrides &o) { return o.accuracy.has_value(); }

/// Every option that trades accuracy for time, with its value and with origin(row, member).
template <class Origin> std::vector<ChosenOption> chosen_options(const Options &options, Origin &&origin)
{
  std::vector<ChosenOption> chosen;
  for_each_option([&](const auto &row, auto member) {
    if (!*row.trades) return;
    const std::string unit = *row.unit ? std::string(" ") + row.unit : "";
    chosen.push_back({row.name, to_text(value_of(member(options))) + unit, origin(row, member), row.trades});
  });
  return chosen;
}

/// Who chose the time step if no option sets it.
const char *origin_of_step(const Options &options, const Scene &scene)
{
  const bool own = options.accuracy == Accuracy::production || options.accuracy == Accuracy::paper;
  return scene.time_step > 0 && own ? "scene" : "level";
}

}  // namespace

Options Options::at(Accuracy level)
{
  Options o;
  for_each_option([&](const auto &row, auto member) { member(o) = row.at(level); });
  o.accuracy = level;
  return o;
}

void OptionOverrides::set(const std::string &name, const OptionValue &value)
{
  with_option(name, [&](const auto &row, auto member) { member(*this) = checked(row, value); });
}

void OptionOverrides::set_text(const std::string &name, const std::string &text)
{
  with_option(name, [&](const auto &row, auto member) {
    using T = std::decay_t<decltype(row.value)>;
    member(*this) = checked(row, parsed<T>(text));
  });
}

std::vector<std::pair<std::string, OptionValue>> OptionOverrides::values() const
{
  std::vector<std::pair<std::string, OptionValue>> all;
  for_each_option([&](const auto &row, auto member) {
    if (member(*this)) all.emplace_back(row.name, value_of(*member(*this)));
  });
  return all;
}

ResolvedOptions resolve(const OptionOverrides &user, const Scene &scene)
{
  const OptionOverrides of_scene = names_level(user) ? OptionOverrides{} : scene.options;
  const Accuracy level = user.accuracy.value_or(of_scene.accuracy.value_or(Accuracy::production));
  ResolvedOptions r{Options::at(level), {}};
  const auto chooses = [](const auto &row, auto member, const OptionOverrides &o) {
    if (!member(o)) return false;
    if constexpr (std::is_same_v<std::decay_t<decltype(row.value)>, double>)
      if (std::string("time_step") == row.name) return *member(o) > 0;   // 0 leaves the choice to the level
    return true;
  };
  for_each_option([&](const auto &row, auto member) {
    for (const OptionOverrides *o : {&of_scene, &user})
      if (chooses(row, member, *o)) member(r.options) = *member(*o);
  });
  check_together(r.options);
  if (controls_error(user, of_scene, r.options, scene)) {
    r.error = allowed_error(r.options.error, cloth_size(scene));
    r.options.time_step = 0;
  } else {
    r.options.error.clear();
    // A second solve is for the long steps that an error chooses; in short ones of a control loop one is enough.
    if (level == Accuracy::interactive && !of_scene.newton_iterations && !user.newton_iterations)
      r.options.newton_iterations = 1;
  }
  const char *origin_of_default_step = origin_of_step(r.options, scene);
  r.options.time_step = chosen_time_step(r.options, scene);
  // BDF2 goes on from a motion that such a step does not resolve, and tears cloth.
  const bool too_long = r.options.time_step > longest_step && !of_scene.integrator && !user.integrator &&
                        r.options.integrator == Integrator::bdf2;
  if (too_long) r.options.integrator = Integrator::backward_euler;
  r.chosen = chosen_options(r.options, [&](const auto &row, auto member) -> std::string {
    if (chooses(row, member, user)) return "user";
    if (chooses(row, member, of_scene)) return "scene";
    if (too_long && std::string("integrator") == row.name) return "time_step";
    return std::string("time_step") == row.name ? origin_of_default_step : "level";
  });
  for (ChosenOption &c : r.chosen)
    if (c.name == "error" && r.error > 0) c.value += ", " + number(1e3 * r.error) + " mm in 1/60 s";
  const std::string unused = r.error > 0 ? "time_step" : "error";
  r.chosen.erase(
      std::find_if(r.chosen.begin(), r.chosen.end(), [&](const ChosenOption &c) { return c.name == unused; }));
  return r;
}

ResolvedOptions resolve(const Options &options, const Scene &scene)
{
  OptionOverrides user;
  const Options level = Options::at(options.accuracy);
  for_each_option([&](const auto &row, auto member) {
    if (member(options) != member(level)) member(user) = checked(row, value_of(member(options)));
  });
  user.accuracy = options.accuracy;
  return resolve(user, scene);
}

void check_scene_options(const OptionOverrides &options)
{
  for_each_option([&](const auto &row, auto member) {
    if (row.set_by == SetBy::user && member(options))
      throw SceneError(std::string("options: '") + row.name +
                       "' can only be set by the user who runs the scene; remove it from the scene");
  });
}

const std::vector<std::string> &accuracy_levels()
{
  static const std::vector<std::string> names = word_list<Accuracy>();
  return names;
}

Accuracy accuracy_level(const std::string &name)
{
  OptionOverrides o;
  o.set("accuracy", name);
  return *o.accuracy;
}

const std::vector<OptionInfo> &option_table()
{
  static const std::vector<OptionInfo> table = [] {
    std::vector<OptionInfo> rows;
    for_each_option([&](const auto &row, auto) {
      using T = std::decay_t<decltype(row.value)>;
      OptionInfo info{row.name,
                      type_name<T>(),
                      word_list<T>(),
                      {},
                      text_of(row.range),
                      row.unit,
                      row.set_by == SetBy::user ? "user" : "scene",
                      row.trades,
                      row.help};
      for (const Word<Accuracy> &level : words<Accuracy>()) {
        const bool is_level = std::string("accuracy") == row.name;
        info.levels.emplace_back(level.text,
                                 is_level ? OptionValue(std::string(level.text)) : value_of(row.at(level.value)));
      }
      rows.push_back(std::move(info));
    });
    return rows;
  }();
  return table;
}

OptionValue option_value(const Options &options, const std::string &name)
{
  OptionValue value;
  with_option(name, [&](const auto &, auto member) { value = value_of(member(options)); });
  return value;
}

std::string to_text(const OptionValue &value)
{
  if (const auto *flag = std::get_if<bool>(&value)) return *flag ? "true" : "false";
  if (const auto *whole = std::get_if<int>(&value)) return std::to_string(*whole);
  if (const auto *real = std::get_if<double>(&value)) return number(*real);
  return std::get<std::string>(value);
}

}  // namespace cama
