// SPDX-License-Identifier: Apache-2.0
#include "world_runner.hpp"

#include <algorithm>
#include <iterator>
#include <utility>
#include <vector>

#include "cama/error.hpp"
#include "check.hpp"
#include "interpreter.hpp"

namespace cama {
namespace {

constexpr int most_lanes = 8;

/// Each lane is a stream in which one launch runs at a time.
class Runner final : public WorldRunner {
public:
  Runner(cudaStream_t queue, const Interpreter &interpreter) : queue_(queue), interpreter_(interpreter)
  {
    for (Lane &lane : lane_)
      cama::check(cudaStreamCreateWithFlags(&lane.stream, cudaStreamNonBlocking), "cudaStreamCreate");
    cama::check(cudaEventCreateWithFlags(&before_, cudaEventDisableTiming), "cudaEventCreate");
  }
  ~Runner() override
  {
    for (const Lane &lane : lane_) cudaStreamDestroy(lane.stream);
    cudaEventDestroy(before_);
  }

  void follow(int worlds) override
  {
    worlds_ = worlds;
    cama::check(cudaEventRecord(before_, queue_), "cudaEventRecord");
    for (Lane &lane : lane_) lane.follows = false;
  }

  bool suits(const OperationQueue &queue) const override { return interpreter_.suits(queue, worlds_); }

  void begin(const std::vector<OperationQueue *> &queues) override
  {
    for (std::size_t first = 0; first < queues.size(); first += most_worlds) {
      const std::size_t count = std::min<std::size_t>(queues.size() - first, most_worlds);
      int blocks = 1;
      for (std::size_t i = 0; i < count; ++i)
        blocks = std::max(blocks, interpreter_.blocks_for(*queues[first + i], worlds_));
      Lane &lane = *std::min_element(std::begin(lane_), std::end(lane_),
                                     [](const Lane &a, const Lane &b) { return a.running < b.running; });
      Batch batch;
      for (std::size_t i = 0; i < count; ++i) {
        OperationQueue &queue = *queues[first + i];
        if (!queue.room) queue.room = std::make_shared<ProgramRoom>(queue_);
        ProgramRoom &room = room_of(queue);
        batch.world[i] = room.write(queue, blocks, interpreter_);
        if (room.take_grown()) follow(worlds_);
        room.lane = static_cast<int>(&lane - lane_);
        ++lane.running;
      }
      if (!std::exchange(lane.follows, true))
        cama::check(cudaStreamWaitEvent(lane.stream, before_, 0), "cudaStreamWaitEvent");
      interpreter_.launch(batch, static_cast<int>(count), blocks, lane.stream);
      ++launches_;
    }
  }

  bool ended(OperationQueue &queue) override
  {
    ProgramRoom &room = room_of(queue);
    if (!room.ended()) return false;
    --lane_[room.lane].running;
    queue.downloaded = room.downloads();
    if (room.take_overflow()) throw ListOverflow();
    return true;
  }

  void check() override
  {
    for (const Lane &lane : lane_) {
      if (lane.running == 0) continue;
      const cudaError_t status = cudaStreamQuery(lane.stream);
      if (status == cudaErrorNotReady)
        cudaGetLastError();  // not an error
      else
        cama::check(status, "recorded operations");
    }
  }
  void wait() noexcept override
  {
    for (Lane &lane : lane_) {
      cudaStreamSynchronize(lane.stream);
      lane.running = 0;
    }
  }
  long launches() const override { return launches_; }

private:
  struct Lane {
    cudaStream_t stream = nullptr;
    int running = 0;  // worlds
    bool follows = false;  // what the queue did last
  };

  static ProgramRoom &room_of(const OperationQueue &queue) { return *static_cast<ProgramRoom *>(queue.room.get()); }

  cudaStream_t queue_;
  const Interpreter interpreter_;
  int worlds_ = 1;  // that run at once
  long launches_ = 0;
  cudaEvent_t before_ = nullptr;
  Lane lane_[most_lanes];
};

}  // namespace

std::unique_ptr<WorldRunner> make_world_runner(int device, cudaStream_t queue, int (*team_bytes)(const KernelKey &))
{
  const Interpreter interpreter(device, team_bytes);
  return interpreter.usable() ? std::make_unique<Runner>(queue, interpreter) : nullptr;
}

}  // namespace cama
