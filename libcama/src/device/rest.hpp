// SPDX-License-Identifier: Apache-2.0
#pragma once
#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace cama {

/// Lets the other thread of the core work, without a call of the system: in loops that wait for another thread or a
/// device.
inline void rest()
{
#if defined(__x86_64__)
  _mm_pause();
#endif
}

}  // namespace cama
