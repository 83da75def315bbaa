// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>

#include "run/pipeline.hpp"

namespace cama {

/// Takes one step of a pipeline; time, report and state are then those after it. After a SolverError or a ListOverflow,
/// since shorter motions have fewer candidates, the step is undone and taken in two halves, failing halves again in
/// halves, at most Options::max_divisions times; if that fails too, it throws SolverError or MemoryError. After any
/// exception the state is that before the step. finish: called when the step is complete; its exceptions count as
/// exceptions of the step.
void take_step(State &state, Pipeline &step, const std::function<void()> &finish);

}  // namespace cama
