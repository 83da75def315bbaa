// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cuda_runtime.h>

#include <cstddef>

#include "plan_tables.hpp"

namespace cama {

/// Memory that only grows, of the device or page-locked of the host.
class GrowingMemory {
public:
  explicit GrowingMemory(bool on_host) : on_host_(on_host) {}
  ~GrowingMemory();
  GrowingMemory(const GrowingMemory &) = delete;
  GrowingMemory &operator=(const GrowingMemory &) = delete;
  /// The contents are lost if it has to grow.
  unsigned char *get(std::size_t bytes);

private:
  const bool on_host_;
  unsigned char *memory_ = nullptr;
  std::size_t bytes_ = 0;
};

/// Runs the batches of a plan, each in one launch, a row of blocks for each world.
class PlanRunner {
public:
  /// most_blocks: along a row; overflow: on the device, set by a scan whose total is beyond 2^31 - 1.
  PlanRunner(cudaStream_t queue, int most_blocks, int *overflow);
  ~PlanRunner();
  PlanRunner(const PlanRunner &) = delete;
  PlanRunner &operator=(const PlanRunner &) = delete;

  /// Runs all but the releases, and calls release(buffer) for these. launches: is added to. Returns whether there were
  /// downloads: then it has waited.
  template <class Release> bool run(const Plan &plan, long &launches, const Release &release)
  {
    PlanTables tables(plan);
    prepare(tables);
    for (const Plan::Run &run : plan.order) {
      const Plan::Batch &batch = plan.batches[static_cast<std::size_t>(run.batch)];
      if (batch.what.kind == OperationKind::release)
        for (int w = 0; w < run.worlds; ++w) release(from_slot<Buffer>(*plan.slots(batch, w)));
      else
        launches += launch(batch.what, tables.table(run.batch), run.worlds);
    }
    return finish(tables);
  }

private:
  void prepare(PlanTables &tables);
  int launch(const Operation &what, const PlanTables::Table &table, int worlds);
  void launch_kernel(const Operation &what, const PlanTables::Table &table, const Slot *slots, int worlds);
  void sort(const Operation &what, const PlanTables::Table &table, const Slot *slots, int worlds);
  bool finish(const PlanTables &tables);

  cudaStream_t queue_;
  const int most_blocks_;
  int *overflow_;
  cudaEvent_t copied_ = nullptr;  // the block on the host may be written again
  GrowingMemory block_{true}, downloaded_{true}, device_{false}, gathered_{false}, scratch_{false}, sorted_{false};
};

}  // namespace cama
