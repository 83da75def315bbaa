// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>

#include "run/pipeline.hpp"

namespace cama {

/// One step of a pipeline: time, report and state are those after it. A SolverError takes the step back and does it in
/// two halves, and halves of those that fail, down to 1/16; what helps not is thrown. After any exception the state is
/// that of before. finish: called when the step has been taken; its exceptions are the step's.
void take_step(State &state, Pipeline &step, const std::function<void()> &finish);

}  // namespace cama
