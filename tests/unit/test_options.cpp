// SPDX-License-Identifier: Apache-2.0
// The table of options: levels, texts, ranges, and whose values hold. Expected values are those of
// docs/guide/accuracy-levels.md and of tests/shared_scenes/options.json, which the Python tests read too.
#include <fstream>
#include <set>

#include <nlohmann/json.hpp>

#include "../catch.hpp"
#include "cama/error.hpp"
#include "cama/scene.hpp"
#include "cama/simulation.hpp"

using namespace cama;

namespace {

nlohmann::json json_of(const OptionValue &value)
{
  nlohmann::json j;
  std::visit([&](const auto &v) { j = v; }, value);
  return j;
}

void check_values(const Options &options, const nlohmann::json &expected)
{
  REQUIRE(expected.size() >= 3);
  for (const auto &[name, value] : expected.items()) {
    INFO(name);
    CHECK(json_of(option_value(options, name)) == value);
  }
}

}  // namespace

TEST_CASE("a scene file's options come out the same in C++ and Python", "[options]")
{
  const std::filesystem::path file = std::filesystem::path(CAMA_SOURCE_DIR) / "tests/shared_scenes/options.json";
  const nlohmann::json expected = nlohmann::json::parse(std::ifstream(file)).at("_expected");
  const Scene scene = Scene::load(file);
  const Simulation simulation(scene);
  check_values(simulation.options(), expected.at("scene"));
  CHECK(simulation.time_step() == 0.0025);  // two fill the frame of 5 ms: one would be longer than 1/240 s
  for (const ChosenOption &o : simulation.chosen_options()) {
    INFO(o.name);
    if (expected.at("origins").contains(o.name)) CHECK(o.origin == expected.at("origins").at(o.name));
  }
  OptionOverrides user;
  user.tolerance = 0.25;
  check_values(Simulation(scene, user).options(), expected.at("with tolerance 0.25 of the user"));
  user = {};
  user.accuracy = Accuracy::paper;
  check_values(resolve(user, scene).options, expected.at("with accuracy paper of the user"));
  CHECK(resolve(user, scene).options.time_step == 0.005);
  CHECK(Scene::parse(scene.save(), ".").options.values() == scene.options.values());
}

TEST_CASE("options by name and text", "[options]")
{
  OptionOverrides o;
  o.set_text("time_step", "1/200");
  o.set_text("tolerance", "1e-4");
  o.set_text("commit", "false");
  o.set_text("max_iterations", "12");
  o.set_text("precision", "double");
  o.set_text("paper.assembly", "algorithm1");
  CHECK(*o.time_step == 1.0 / 200);
  CHECK(*o.tolerance == 1e-4);
  CHECK(*o.commit == false);
  CHECK(*o.max_iterations == 12);
  CHECK(*o.precision == Precision::full);
  CHECK(*o.paper.assembly == Assembly::algorithm1);
  CHECK(o.values().size() == 6);
  struct Bad {
    const char *name, *text, *said;
  };
  for (const Bad &bad : {Bad{"tolerence", "1", "did you mean 'tolerance'?"}, Bad{"search", "tree", "'paper.search'"},
                         Bad{"colour", "1", "there are backend, device"}, Bad{"tolerance", "2", "between 0 and 1"},
                         Bad{"tolerance", "small", "'small' is not a number"}, Bad{"tolerance", "nan", "finite"},
                         Bad{"max_iterations", "1.5", "not a whole number"}, Bad{"max_iterations", "0", "1 or more"},
                         Bad{"commit", "perhaps", "true or false"}, Bad{"time_step", "1/0", "not a number"},
                         Bad{"integrator", "rk4", "backward_euler or bdf2"}}) {
    INFO(bad.name << "=" << bad.text);
    CHECK(contains(thrown<SceneError>([&] { o.set_text(bad.name, bad.text); }), bad.said));
  }
  CHECK(contains(thrown<SceneError>([&] { o.set("max_iterations", true); }), "whole number"));
  CHECK(o.values().size() == 6);  // no value was set partly
}

TEST_CASE("options that do not go together, and those of the user alone", "[options]")
{
  const Scene scene;
  OptionOverrides o;
  o.paper.contact_form = ContactForm::star;
  CHECK(contains(thrown<SceneError>([&] { resolve(o, scene); }), "paper.assembly"));
  o.paper.assembly = Assembly::sorted;
  resolve(o, scene);
  o.paper.atomic_filling = true;
  CHECK(contains(thrown<SceneError>([&] { resolve(o, scene); }), "paper.atomic_filling"));
  OptionOverrides pinch;
  pinch.pinch = Pinch::release;
  CHECK(contains(thrown<SceneError>([&] { check_scene_options(pinch); }), "'pinch' can only be set by the user"));
  CHECK_THROWS_AS(Scene::parse(R"({"options": {"backend": "cpu"}})", "."), SceneError);
}

TEST_CASE("the table is whole", "[options]")
{
  std::set<std::string> names;
  for (const OptionInfo &row : option_table()) {
    INFO(row.name);
    CHECK(names.insert(row.name).second);
    CHECK(row.levels.size() == accuracy_levels().size());
    CHECK(row.help.size() > 20);
    CHECK(row.help.back() == '.');
    CHECK((row.type == "choice") == !row.words.empty());
    for (const auto &[level, value] : row.levels) {  // the option accepts every value
      OptionOverrides o;
      o.set(row.name, value);
      CHECK(o.values().size() == 1);
    }
  }
  std::set<std::string> fields;
  for (const ReportInfo &row : report_table()) CHECK(fields.insert(row.name).second);
  std::size_t visited = 0;
  visit(StepReport{}, [&](const char *name, auto) { visited += fields.count(name); });
  CHECK(visited == fields.size());
}

TEST_CASE("pieces of a step add up as the table of the report says", "[options]")
{
  StepReport sum, piece;
  sum.impacts = 3;
  sum.newton_residual = 0.5;
  sum.contacts = 7;
  sum.substeps = 0;
  piece.impacts = 4;
  piece.newton_residual = 0.25;
  piece.contacts = 9;
  sum.add(piece);
  CHECK(sum.impacts == 7);
  CHECK(sum.newton_residual == 0.5);
  CHECK(sum.contacts == 9);
  CHECK(sum.substeps == 1);
}
