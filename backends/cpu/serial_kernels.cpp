// SPDX-License-Identifier: Apache-2.0
// The kernels once more, without parallel loops: with one thread the start of such a loop costs more than short ones
// do.
#define CAMA_SERIAL
#include "kernels/dialect/caching.h"
#include "kernels/dialect/lanes.h"

#include "cpu_kernels.hpp"

namespace cama {
namespace kernels::serial {
#include "device/kernel_functions.inc"
}  // namespace kernels::serial

const cpu::Functions cpu::serial_kernels[] = {
#define CAMA_DOUBLE_KERNEL(name) {&cpu::trampoline<&kernels::serial::name>, nullptr, nullptr},
#define CAMA_REAL_KERNEL(name) \
  {nullptr, &cpu::trampoline<&kernels::serial::f32::name>, &cpu::trampoline<&kernels::serial::f64::name>},
#include "kernels/kernels.def"
};

}  // namespace cama
