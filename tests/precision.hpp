// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>

#include "cama/options.hpp"

/// "double", "mixed" or "single"
inline cama::Precision precision_of(const std::string &word)
{
  cama::OptionOverrides o;
  o.set("precision", word);
  return *o.precision;
}
