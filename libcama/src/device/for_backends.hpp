// SPDX-License-Identifier: Apache-2.0
// What backends take from the library beside its public headers, and all that they take.
#pragma once
#include "device/embedded_text.hpp"
#include "device/fnv.hpp"
#include "device/host_threads.hpp"
#include "device/kernels.hpp"
