// SPDX-License-Identifier: Apache-2.0
// Catch2 version 2 or 3 under one name, and what every test needs: the test data, and the text of exceptions.
#pragma once
#if __has_include(<catch2/catch_all.hpp>)
#include <catch2/catch_all.hpp>
using Catch::Approx;
#else
#include <catch2/catch.hpp>
#endif

#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string>

#ifndef CAMA_SOURCE_DIR
#define CAMA_SOURCE_DIR "."
#endif

/// How often a test of this program lacked a file of test data, a backend or a strict build; the main function then
/// returns 77, which ctest counts as skipped.
inline int skipped = 0;

/// A file of the shared test data (CAMA_TEST_DATA, else ../shared/data beside the sources), or nothing, which is
/// reported and counted.
inline std::optional<std::filesystem::path> test_data(const std::string &name)
{
  const char *folder = std::getenv("CAMA_TEST_DATA");
  const std::filesystem::path path =
      (folder ? std::filesystem::path(folder) : std::filesystem::path(CAMA_SOURCE_DIR) / ".." / "shared" / "data") /
      name;
  if (std::filesystem::exists(path)) return path;
  ++skipped;
  WARN("SKIPPED: no test data " << path.string());
  return std::nullopt;
}

inline bool contains(const std::string &text, const std::string &part) { return text.find(part) != std::string::npos; }

/// The text of the exception that `run` throws; fails if it throws none or one that is not an E.
template <class E, class Run> std::string thrown(Run run)
{
  try {
    run();
  } catch (const E &e) {
    return e.what();
  } catch (const std::exception &e) {
    FAIL_CHECK("another exception: " << e.what());
    return e.what();
  }
  FAIL_CHECK("nothing was thrown");
  return "";
}
