// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>
#include <cstdint>

namespace cama {

/// FNV-1a over bytes; `hash`: that of the preceding bytes.
inline std::uint64_t fnv1a(const void *bytes, std::size_t count, std::uint64_t hash = 14695981039346656037ull)
{
  const auto *byte = static_cast<const unsigned char *>(bytes);
  for (std::size_t k = 0; k < count; ++k) hash = (hash ^ byte[k]) * 1099511628211ull;
  return hash;
}

}  // namespace cama
