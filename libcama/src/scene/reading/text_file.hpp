// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include "cama/error.hpp"

namespace cama {

/// Reads the whole file. Throws FileError, which names it.
inline std::string read_text(const std::filesystem::path &file)
{
  if (!std::filesystem::exists(file)) throw FileError(file.string() + ": no such file");
  if (std::filesystem::is_directory(file)) throw FileError(file.string() + ": is a folder, expected a file");
  std::ifstream in(file, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  if (!in) throw FileError(file.string() + ": cannot be read");
  return text.str();
}

}  // namespace cama
