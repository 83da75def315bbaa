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

/// How to compute; what to compute is the Scene. The rows of options.def: their values at the level production, what they do.
struct Options {
#define CAMA_OPTION(type, name, value, ...) type name = value;
#include "cama/options.def"
  /// Options that serve the reproduction of the paper alone.
  struct Paper {
#define CAMA_PAPER_OPTION(type, name, value, ...) type name = value;
#include "cama/options.def"
  } paper;

  /// All options as an accuracy level has them.
  static Options at(Accuracy level);
};

/// The value of an option as texts, JSON and Python have it. Choices are their words.
using OptionValue = std::variant<bool, int, double, std::string>;

/// Some options: what a scene or a user says. What nobody says is the accuracy level's.
struct OptionOverrides {
#define CAMA_OPTION(type, name, ...) std::optional<type> name;
#include "cama/options.def"
  struct Paper {
#define CAMA_PAPER_OPTION(type, name, ...) std::optional<type> name;
#include "cama/options.def"
  } paper;

  /// Sets an option by its name, "tolerance" or "paper.search". Throws SceneError for a name that is not known, a value of another
  /// type, outside its range or not among its words.
  void set(const std::string &name, const OptionValue &value);
  /// The same from text: "1e-4", "1/200", "true", "schwarz".
  void set_text(const std::string &name, const std::string &text);
  /// Names and values of those that are set, in the order of the table.
  std::vector<std::pair<std::string, OptionValue>> values() const;
  bool empty() const { return values().empty(); }
};

/// An option that trades accuracy for time, as it was chosen.
struct ChosenOption {
  std::string name, value;
  std::string origin;   ///< "level", "scene" or "user"
  std::string trades;   ///< what for what
};

/// Every option of a run, and who chose those that trade accuracy for time.
struct ResolvedOptions {
  Options options;      ///< time_step is the one that is taken
  std::vector<ChosenOption> chosen;
};

/// Level < scene < user. The level is the user's, else the scene's, else production. A level that the user names sets aside all
/// options of the scene; its time step counts as before. Throws SceneError where options do not go together.
ResolvedOptions resolve(const OptionOverrides &user, const Scene &scene);
/// The same for options that are all the user's: what differs from their level is his.
ResolvedOptions resolve(const Options &options, const Scene &scene);

/// Throws SceneError for an option that a scene may not set: it belongs to whoever runs the scene.
void check_scene_options(const OptionOverrides &options);

/// The time step that a simulation takes, s: Options::time_step; where it is 0, the scene's at the levels production and paper;
/// where that is 0 too, the level's, shortened so that whole steps fill a frame. accurate and reference never take a longer one than
/// the scene's. preview 1/120, interactive 1/240, paper 1/200; production sqrt(edge / 1.5e5 m/s^2), 1/960 at most and 1/2880 at least,
/// with the mean length of the cloth's edges; accurate a fifth and reference a twentieth of that.
double chosen_time_step(const Options &options, const Scene &scene);

/// Names of the accuracy levels, coarse to fine, then paper.
const std::vector<std::string> &accuracy_levels();
/// The level of a name. Throws SceneError that lists the names.
Accuracy accuracy_level(const std::string &name);

/// A row of the table of options.
struct OptionInfo {
  std::string name;                                           ///< "tolerance", "paper.search"
  std::string type;                                           ///< "boolean", "integer", "number", "choice" or "text"
  std::vector<std::string> words;                             ///< of a choice
  std::vector<std::pair<std::string, OptionValue>> levels;    ///< value at every accuracy level
  std::string range;                                          ///< "0 or more", "between 0 and 1"; empty: any
  std::string unit;
  std::string set_by;                                         ///< "scene": by a scene or the user; "user": by the user alone
  std::string trades, help;
};
const std::vector<OptionInfo> &option_table();

/// The value of an option by its name. Throws SceneError for a name that is not known.
OptionValue option_value(const Options &options, const std::string &name);
/// "0.001", "true", "schwarz"
std::string to_text(const OptionValue &value);

}  // namespace cama
