// SPDX-License-Identifier: Apache-2.0
#pragma once
// The kernel dialect lies beside these headers once installed, and beside the library in the source tree.
#if __has_include("kernels/lang.h")
#include "kernels/lang.h"
namespace cama::kernels {
#include "kernels/dvec3.h"
}
#else
#include "../../kernels/lang.h"
namespace cama::kernels {
#include "../../kernels/dvec3.h"
}
#endif

namespace cama {
using kernels::dvec3;
}
