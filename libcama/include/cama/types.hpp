// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "../../kernels/lang.h"

namespace cama {
namespace kernels {
#include "../../kernels/dvec3.h"
}
using kernels::dvec3;
}  // namespace cama
