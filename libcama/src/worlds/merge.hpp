// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "device/operations.hpp"

namespace cama {

/// Merges queues into batches: each queue's operations keep their order, and equal operations of several queues run
/// together as far as the orders allow. The plan refers to the queues' slots.
Plan merge(const std::vector<const OperationQueue *> &queues);

}  // namespace cama
