// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace cama {

struct Scene;

// enum class Accuracy { preview, interactive, ... }; and the other choices of options.def.
#define CAMA_WORD(word) word,
#define CAMA_WORD_AS(word, text) word,
#define CAMA_CHOICE(Type, words) enum class Type { words };
#include "cama/options.def"
#undef CAMA_WORD
#undef CAMA_WORD_AS

/// How to compute; what to compute is the Scene. One member for every row of options.def, with its value at the level
/// production.
struct Options {
#define CAMA_OPTION(type, name, value, ...) type name = value;
#include "cama/options.def"
  /// Options that serve the reproduction of the paper alone.
  struct Paper {
#define CAMA_PAPER_OPTION(type, name, value, ...) type name = value;
#include "cama/options.def"
  } paper;

  /// All options at an accuracy level.
  static Options at(Accuracy level);
};

/// The value of an option in text, JSON and Python. A choice is one of its words.
using OptionValue = std::variant<bool, int, double, std::string>;

/// The options that a scene or a user sets. The accuracy level gives the others.
struct OptionOverrides {
#define CAMA_OPTION(type, name, ...) std::optional<type> name;
#include "cama/options.def"
  struct Paper {
#define CAMA_PAPER_OPTION(type, name, ...) std::optional<type> name;
#include "cama/options.def"
  } paper;

  /// Sets an option by its name, "tolerance" or "paper.search". Throws SceneError if the name is unknown, or if the
  /// value has another type, is outside its range or is not one of its words.
  void set(const std::string &name, const OptionValue &value);
  /// The same from text: "1e-4", "1/200", "true", "schwarz".
  void set_text(const std::string &name, const std::string &text);
  /// Names and values of the options that are set, in the order of the table.
  std::vector<std::pair<std::string, OptionValue>> values() const;
  bool empty() const { return values().empty(); }
};

/// An option that trades accuracy for time, with its chosen value.
struct ChosenOption {
  std::string name, value;
  std::string origin;  ///< "level", "scene", "user", or "time_step", which is too long for the level's
  std::string trades;  ///< what it trades
};

/// All options of a run, and who chose those that trade accuracy for time.
struct ResolvedOptions {
  Options options;  ///< time_step is the one that the simulation takes
  std::vector<ChosenOption> chosen;
  double error = 0;  ///< m in a frame of 1/60 s that time steps are chosen by; 0: they are Options::time_step
};

/// Options of the user override those of the scene, which override those of the accuracy level. The level is the
/// user's, else the scene's, else production. A level that the user names replaces all options of the scene, but not
/// its time step. Throws SceneError if options do not go together.
ResolvedOptions resolve(const OptionOverrides &user, const Scene &scene);
/// The same for options that the user sets completely: those that differ from their level count as set by the user.
ResolvedOptions resolve(const Options &options, const Scene &scene);

/// Throws SceneError for an option that only the user who runs the scene may set.
void check_scene_options(const OptionOverrides &options);

/// The time step that a simulation takes, s: Options::time_step; if that is 0, the scene's at the levels production and
/// paper; if that is 0 too, the level's, shortened so that whole steps fill a frame. accurate and reference never take
/// a longer one than the scene's. The levels have: preview 1/120, interactive and production 1/240 (these three where
/// no error chooses), accurate 1/1200, reference 1/4800, paper 1/200. A finer mesh does not ask for shorter steps.
double chosen_time_step(const Options &options, const Scene &scene);

/// Names of the accuracy levels, from coarse to fine, then paper.
const std::vector<std::string> &accuracy_levels();
/// The level with this name. Throws SceneError, which lists the names.
Accuracy accuracy_level(const std::string &name);

/// A row of the table of options.
struct OptionInfo {
  std::string name;  ///< "tolerance", "paper.search"
  std::string type;  ///< "boolean", "integer", "number", "choice" or "text"
  std::vector<std::string> words;  ///< of a choice
  std::vector<std::pair<std::string, OptionValue>> levels;  ///< value at every accuracy level
  std::string range;  ///< "0 or more", "between 0 and 1"; empty: any
  std::string unit;
  std::string set_by;  ///< "scene": by a scene or the user; "user": by the user only
  std::string trades, help;
};
const std::vector<OptionInfo> &option_table();

/// The value of an option by its name. Throws SceneError if the name is unknown.
OptionValue option_value(const Options &options, const std::string &name);
/// "0.001", "true", "schwarz"
std::string to_text(const OptionValue &value);

}  // namespace cama
