// SPDX-License-Identifier: Apache-2.0
#include "worlds/lockstep.hpp"

#include <algorithm>
#include <climits>

namespace cama {

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
  const auto each = [&](int member, auto &&work) {  // a world always runs in the same thread
    const auto end = static_cast<int>(static_cast<long>(count) * (member + 1) / members);
    for (auto t = static_cast<int>(static_cast<long>(count) * member / members); t < end; ++t)
      work(*tasks[static_cast<std::size_t>(t)].world);
  };
  std::vector<OperationQueue *> queues;
  for (bool all = false; !all;) {
    crew.run([&](int member) {
      each(member, [](RecordingBackend &w) {
        const bool ready = w.waiting ? w.ran || w.queue.empty() : w.stage <= w.last_stage;
        if (w.ran) w.end_run();
        if (ready && !w.fiber->finished()) w.fiber->resume();
      });
    });
    int stage = INT_MAX;   // the first that a world is at
    all = true;
    for (const Task &task : tasks) {
      if (task.world->fiber->finished()) continue;
      all = false;
      stage = std::min(stage, task.world->stage);
    }
    queues.clear();
    for (const Task &task : tasks) {
      RecordingBackend &w = *task.world;
      w.last_stage = stage;
      if ((!w.waiting && !all) || w.queue.empty()) continue;
      queues.push_back(&w.queue);
      w.ran = true;
    }
    if (queues.empty()) continue;
    if (!failure) {
      try {
        device_->backend->run(queues, crew);
      } catch (...) {
        failure = std::current_exception();
      }
    }
  }
  for (Task &task : tasks) {
    if (task.world->ran) task.world->end_run();
    task.world->fiber = nullptr;
    task.world->failure = nullptr;
  }
  if (failure) std::rethrow_exception(failure);
}

}  // namespace cama
