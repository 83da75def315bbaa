// SPDX-License-Identifier: Apache-2.0
// Everything that backends include from the library besides its public headers.
#pragma once
#include "device/crew.hpp"
#include "device/embedded_text.hpp"
#include "device/fnv.hpp"
#include "device/host_threads.hpp"
#include "device/kernels.hpp"
#include "device/operations.hpp"
#include "device/rest.hpp"
