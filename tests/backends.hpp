// SPDX-License-Identifier: Apache-2.0
// The backends that tests run on: those with a device on this machine. An absent one is reported, and fails the test if
// the environment variable CAMA_REQUIRE_BACKENDS ("cpu,opencl") names it.
#pragma once
#include <cstdlib>
#include <string>
#include <vector>

#include "cama/backend.hpp"
#include "catch.hpp"

inline bool backend_required(const std::string &name)
{
  const char *list = std::getenv("CAMA_REQUIRE_BACKENDS");
  return list && contains("," + std::string(list) + ",", "," + name + ",");
}

inline bool backend_here(const std::string &name)
{
  for (const cama::BackendInfo &info : cama::list_backends())
    if (info.name == name) {
      if (info.available) return true;
      if (backend_required(name))
        FAIL("backend " << name << " is required (CAMA_REQUIRE_BACKENDS) and not there: " << info.note);
      WARN("SKIPPED on backend " << name << ": " << info.note);
      return false;
    }
  FAIL("backend " << name << " is not listed");
  return false;
}

inline std::vector<std::string> backends_here()
{
  std::vector<std::string> names;
  for (const cama::BackendInfo &info : cama::list_backends())
    if (backend_here(info.name)) names.push_back(info.name);
  return names;
}
