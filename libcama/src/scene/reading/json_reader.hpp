// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cmath>
#include <functional>
#include <initializer_list>
#include <limits>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "cama/error.hpp"
#include "cama/types.hpp"

namespace cama {

using Json = nlohmann::json;

/// A JSON value and its place in the document; every error message names the place ("cloth[1].grid.size: ...").
class Field {
public:
  using Raise = void (*)(const std::string &);
  Field(const Json &value, std::string path, Raise raise) : value_(&value), path_(std::move(path)), raise_(raise) {}

  const Json &json() const { return *value_; }
  const std::string &path() const { return path_; }
  [[noreturn]] void fail(const std::string &what) const
  {
    raise_((path_.empty() ? std::string("top level") : path_) + ": " + what);
    throw Error(what);   // raise_ throws
  }

  bool has(const char *key) const { return value_->is_object() && value_->contains(key); }
  Field at(const std::string &key) const
  {
    const auto it = value_->find(key);
    if (it == value_->end()) fail("missing \"" + key + "\"");
    return {*it, path_.empty() ? key : path_ + "." + key, raise_};
  }
  Field at(std::size_t i) const { return {(*value_)[i], path_ + "[" + std::to_string(i) + "]", raise_}; }
  std::vector<Field> items() const
  {
    if (!value_->is_array()) fail(std::string("expected a list, got ") + value_->type_name());
    std::vector<Field> all;
    for (std::size_t i = 0; i < value_->size(); ++i) all.push_back(at(i));
    return all;
  }

  /// Throws for a value that is not an object and for a key that is not in `keys`. Keys that start with "$" or "_" are
  /// ignored.
  void only(std::initializer_list<const char *> keys) const
  {
    if (!value_->is_object()) fail(std::string("expected an object, got ") + value_->type_name());
    for (auto it = value_->begin(); it != value_->end(); ++it) {
      bool known = !it.key().empty() && (it.key()[0] == '$' || it.key()[0] == '_');
      for (const char *k : keys) known = known || it.key() == k;
      if (known) continue;
      std::string list;
      for (const char *k : keys) list += (list.empty() ? "" : ", ") + std::string(k);
      fail("unknown key \"" + it.key() + "\"; known keys: " + list);
    }
  }

  /// A number; the strings "inf" and "-inf" stand for infinities, which JSON does not have.
  double number() const
  {
    if (value_->is_number()) return value_->get<double>();
    if (value_->is_string() && *value_ == "inf") return std::numeric_limits<double>::infinity();
    if (value_->is_string() && *value_ == "-inf") return -std::numeric_limits<double>::infinity();
    fail(std::string("expected a number, got ") + value_->type_name());
  }
  double finite() const
  {
    const double x = number();
    if (!std::isfinite(x)) fail("expected a finite number");
    return x;
  }
  int integer() const
  {
    if (!value_->is_number_integer()) fail("expected a whole number, got " + brief());
    const auto x = value_->get<std::int64_t>();
    if (x < std::numeric_limits<int>::min() || x > std::numeric_limits<int>::max())
      fail("whole number out of range: " + brief());
    return static_cast<int>(x);
  }
  bool boolean() const
  {
    if (!value_->is_boolean()) fail("expected true or false, got " + brief());
    return value_->get<bool>();
  }
  std::string text() const
  {
    if (!value_->is_string()) fail("expected a text, got " + brief());
    return value_->get<std::string>();
  }
  std::vector<double> numbers(std::size_t count) const
  {
    if (!value_->is_array() || value_->size() != count)
      fail("expected a list of " + std::to_string(count) + " numbers, got " + brief());
    std::vector<double> all;
    for (std::size_t i = 0; i < count; ++i) all.push_back(at(i).finite());
    return all;
  }
  dvec3 vector() const
  {
    const auto v = numbers(3);
    return {v[0], v[1], v[2]};
  }

  double number(const char *key, double otherwise) const { return has(key) ? at(key).number() : otherwise; }
  double finite(const char *key, double otherwise) const { return has(key) ? at(key).finite() : otherwise; }
  double positive(const char *key, double otherwise) const
  {
    const double x = finite(key, otherwise);
    if (!(x > 0)) at(key).fail("must be greater than 0, got " + at(key).brief());
    return x;
  }
  int integer(const char *key, int otherwise) const { return has(key) ? at(key).integer() : otherwise; }
  bool boolean(const char *key, bool otherwise) const { return has(key) ? at(key).boolean() : otherwise; }
  std::string text(const char *key, const std::string &otherwise) const
  {
    return has(key) ? at(key).text() : otherwise;
  }
  dvec3 vector(const char *key, const dvec3 &otherwise) const { return has(key) ? at(key).vector() : otherwise; }

  std::string brief() const
  {
    std::string s = value_->dump(-1, ' ', false, Json::error_handler_t::replace);
    return s.size() > 60 ? s.substr(0, 57) + "..." : s;
  }

private:
  const Json *value_;
  std::string path_;
  Raise raise_;
};

/// Parses a text, in which comments are allowed. complain: called with the problem: not JSON, a number beyond the range
/// of double, a duplicate key.
Json parse_json(const std::string &text, const std::function<void(const std::string &)> &complain);

inline void raise_scene_error(const std::string &what) { throw SceneError(what); }
inline void raise_material_error(const std::string &what) { throw MaterialError(what); }

}  // namespace cama
