// SPDX-License-Identifier: Apache-2.0
#include "worlds/lockstep.hpp"

#include <algorithm>
#include <climits>
#include <exception>

namespace cama {
namespace {
constexpr int fewest_in_lane = 128;   // worlds; fewer leave the device idle
}

void Lockstep::run(Crew &crew, std::vector<Task> &tasks)
{
  const int count = static_cast<int>(tasks.size()), members = crew.size();
  while (static_cast<int>(fibers_.size()) < count) fibers_.push_back(std::make_unique<Fiber>());
  std::exception_ptr failure;
  for (int t = 0; t < count; ++t) {
    Task &task = tasks[static_cast<std::size_t>(t)];
    Fiber &fiber = *fibers_[static_cast<std::size_t>(t)];
    fiber.begin(task.work);
    task.world->fiber = &fiber;
    task.world->failure = &failure;
    task.world->waiting = task.world->ran = false;
    task.world->stage = task.world->step = 0;
    task.world->last_stage = 0;
  }
  // The host works for the worlds of one lane while the device works for those of the other.
  struct Lane {
    int begin, end;
    bool running = false, finished = false;
    std::vector<OperationQueue *> queues;
  };
  std::vector<Lane> lanes;
  const int number = count < 2 * fewest_in_lane ? 1 : 2;
  for (int k = 0; k < number; ++k) lanes.push_back({count * k / number, count * (k + 1) / number, false, false, {}});
  const auto on_device = [&](auto &&work) {
    if (failure) return false;
    try {
      work(*device_->backend);
    } catch (...) {
      failure = std::current_exception();
    }
    return !failure;
  };
  // Takes the worlds of a lane as far as they get without answers of the device, and begins what they ask.
  const auto advance = [&](Lane &lane, int k) {
    crew.run([&](int member) {  // a world always runs in the same thread
      const auto place = [&](int m) {
        return lane.begin + static_cast<int>(static_cast<long>(lane.end - lane.begin) * m / members);
      };
      for (int t = place(member); t < place(member + 1); ++t) {
        RecordingBackend &w = *tasks[static_cast<std::size_t>(t)].world;
        const bool ready = w.waiting ? w.ran || w.queue.empty() : w.stage <= w.last_stage;
        if (w.ran) w.take_answers();
        if (ready && !w.fiber->finished()) w.fiber->resume();
      }
    });
    int stage = INT_MAX;   // the first that a world is at
    lane.finished = true;
    for (int t = lane.begin; t < lane.end; ++t) {
      const RecordingBackend &w = *tasks[static_cast<std::size_t>(t)].world;
      if (w.fiber->finished()) continue;
      lane.finished = false;
      stage = std::min(stage, w.stage);
    }
    lane.queues.clear();
    for (int t = lane.begin; t < lane.end; ++t) {
      RecordingBackend &w = *tasks[static_cast<std::size_t>(t)].world;
      w.last_stage = stage;
      if ((!w.waiting && !lane.finished) || w.queue.empty()) continue;
      lane.queues.push_back(&w.queue);
      w.ran = true;
    }
    if (lane.queues.empty()) return;
    lane.running = on_device([&](Backend &device) { device.begin_run(lane.queues, crew, k); });
  };
  const auto finish = [&](Lane &lane, int k) {
    if (lane.running) on_device([&](Backend &device) { device.end_run(k); });
    lane.running = false;
  };
  for (bool left = true; left;) {
    left = false;
    for (int k = 0; k < number; ++k) {
      Lane &lane = lanes[static_cast<std::size_t>(k)];
      finish(lane, k);
      if (lane.finished) continue;
      advance(lane, k);
      left = true;
    }
  }
  for (Task &task : tasks) {
    if (task.world->ran) task.world->take_answers();
    task.world->fiber = nullptr;
    task.world->failure = nullptr;
  }
  if (failure) std::rethrow_exception(failure);
}

}  // namespace cama
