// SPDX-License-Identifier: Apache-2.0
#pragma once
// Two headers of the kernel dialect, which are installed with this one.
#include "kernels/dialect/lang.h"

namespace cama::kernels {
#include "kernels/dialect/dvec3.h"
}

namespace cama {
using kernels::dvec3;
}
