// SPDX-License-Identifier: Apache-2.0
#include "scene/reading/json_reader.hpp"

#include <algorithm>
#include <set>

namespace cama {

Json parse_json(const std::string &text, const std::function<void(const std::string &)> &complain)
{
  constexpr int deepest = 64;   // lists and objects within each other; a scene has 10
  std::vector<std::set<std::string>> keys;   // keys of the objects that are open
  const auto watch = [&](int depth, Json::parse_event_t event, Json &value) {
    if (depth > deepest)
      complain("lists or objects are nested more than " + std::to_string(deepest) + " deep; is a bracket missing?");
    if (event == Json::parse_event_t::object_start)
      keys.emplace_back();
    else if (event == Json::parse_event_t::object_end)
      keys.pop_back();
    else if (event == Json::parse_event_t::key && !keys.back().insert(value.get<std::string>()).second)
      complain("the key \"" + value.get<std::string>() + "\" appears twice in one object; remove one of them");
    return true;
  };
  try {
    return Json::parse(text, watch, true, true);
  } catch (const Json::exception &e) {
    std::string what = e.what();   // it quotes the text, which may be in any encoding
    std::replace_if(what.begin(), what.end(), [](char c) { return static_cast<unsigned char>(c) >= 0x80; }, '?');
    complain("not JSON in UTF-8: " + what);
    throw;   // complain throws
  }
}

}  // namespace cama
