// SPDX-License-Identifier: Apache-2.0
#include "device/operations.hpp"

namespace cama {
namespace {

void launch(Backend &backend, const Operation &what, const Slot *slots)
{
  Argument arguments[max_kernel_arguments];
  const int count = what.slots - 1;
  for (int i = 0; i < count; ++i) {
    const Slot &slot = slots[i + 1];
    Argument &a = arguments[i];
    a.is_buffer = (what.buffers >> i & 1) != 0;
    if (a.is_buffer) {
      a.buffer = from_slot<Buffer>(slot);
    } else {
      a.scalar = &slot;
      a.size = (what.wide >> i & 1) != 0 ? 8 : 4;
    }
  }
  backend.launch(what.kernel, from_slot<int>(slots[0]), arguments, count);
}

void run_one(Backend &backend, const Operation &what, const Slot *slots)
{
  const auto bytes = static_cast<std::size_t>(slots[0]);
  switch (what.kind) {
  case OperationKind::launch: return launch(backend, what, slots);
  case OperationKind::scan:
    return backend.scan(from_slot<Buffer>(slots[1]), from_slot<Buffer>(slots[2]), from_slot<int>(slots[0]));
  case OperationKind::sort:
    return backend.sort(from_slot<Buffer>(slots[1]), from_slot<Buffer>(slots[2]), from_slot<int>(slots[0]), what.extra);
  case OperationKind::copy: return backend.copy(from_slot<Buffer>(slots[1]), from_slot<Buffer>(slots[2]), bytes);
  case OperationKind::fill:
    return backend.fill(from_slot<Buffer>(slots[1]), from_slot<unsigned char>(slots[2]), bytes);
  case OperationKind::upload:
    return backend.upload(from_slot<Buffer>(slots[1]), from_slot<const void *>(slots[2]), bytes);
  case OperationKind::download:
    return backend.download(from_slot<void *>(slots[1]), from_slot<Buffer>(slots[2]), bytes, slots[3]);
  case OperationKind::release: return backend.release(from_slot<Buffer>(slots[0]));
  case OperationKind::repeat: return;
  }
}

}  // namespace

void Backend::run(const Plan &plan)
{
  for (const Plan::Run &run : plan.order) {
    const Plan::Batch &batch = plan.batches[static_cast<std::size_t>(run.batch)];
    for (int w = 0; w < run.worlds; ++w) run_one(*this, batch.what, plan.slots(batch, w));
  }
}

}  // namespace cama
