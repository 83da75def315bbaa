// SPDX-License-Identifier: Apache-2.0
#include "worlds/world_server.hpp"

#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <utility>

#include "cama/error.hpp"
#include "device/rest.hpp"

namespace cama {
namespace {

constexpr int most_at_once = 16;   // worlds that begin in one launch
constexpr int looks_between_checks = 1024;  // of the device, when no world is answered

/// Of the device: what all worlds meet.
class Failure {
public:
  void set(const std::exception_ptr &what)
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!what_) what_ = what;
    is_set_ = true;
  }
  /// The first that was set.
  std::exception_ptr get()
  {
    if (!is_set_) return nullptr;
    const std::lock_guard<std::mutex> lock(mutex_);
    return what_;
  }

private:
  std::mutex mutex_;
  std::exception_ptr what_;
  std::atomic<bool> is_set_{false};
};

/// What one thread does for its worlds: it takes each as far as it gets and begins what it asks for.
class Service {
public:
  Service(WorldRunner *runner, int all_worlds, Failure &failure)
      : runner_(runner), all_worlds_(all_worlds), of_all_(failure)
  {}

  void add(RecordingBackend &world) { worlds_.push_back({&world, At::host}); }

  /// Until all worlds have ended.
  void run()
  {
    left_ = static_cast<int>(worlds_.size());
    if (runner_) attempt([&] { runner_->follow(all_worlds_); });
    for (int looks = 0; left_ > 0;) {
      const bool moved = look();
      begin_gathered();
      looks = moved ? 0 : looks + 1;
      if (moved) continue;
      rest();
      if (runner_ && looks % looks_between_checks == 0) attempt([&] { runner_->check(); });
    }
  }

private:
  enum class At { host, gathered, device, end };
  struct World {
    RecordingBackend *backend;
    At at;
  };

  template <class Work> void attempt(Work &&work)
  {
    if (failure_) return;
    try {
      work();
    } catch (...) {
      of_all_.set(std::current_exception());
      fail();
    }
  }

  void fail()
  {
    failure_ = of_all_.get();
    gathered_.clear();
    if (runner_) runner_->wait();
  }

  /// Takes all worlds that need not wait further. Returns whether there is one.
  bool look()
  {
    if (!failure_ && of_all_.get()) fail();
    bool moved = false;
    for (World &world : worlds_) {
      if (world.at == At::end) continue;
      if (failure_) {
        world.backend->failure = failure_;
      } else if (world.at == At::gathered) {
        continue;
      } else if (world.at == At::device) {
        if (!answered(*world.backend)) continue;
        --running_;
      }
      advance(world);
      moved = true;
    }
    return moved;
  }

  bool answered(RecordingBackend &world)
  {
    bool ended = false;
    try {
      ended = runner_->ended(world.queue);
    } catch (const ListOverflow &) {
      world.failure = std::current_exception();
      ended = true;
    }
    if (ended) world.take_answers();
    return ended;
  }

  /// To where the world needs an answer.
  void advance(World &world)
  {
    RecordingBackend &w = *world.backend;
    if (failure_) w.take_answers();   // there are none, only what is released
    if (!w.fiber->finished()) w.fiber->resume();
    if (failure_) w.take_answers();
    world.at = At::host;
    if (w.queue.empty()) {
      if (!w.fiber->finished()) return;
      world.at = At::end;
      --left_;
    } else if (runner_ && runner_->suits(w.queue)) {
      world.at = At::gathered;
      gathered_.push_back(&world);
    } else {
      run_now(w);
    }
  }

  void run_now(RecordingBackend &world)
  {
    attempt([&] {
      try {
        world.run_now();
      } catch (const ListOverflow &) {
        world.failure = std::current_exception();
      }
    });
    if (runner_) attempt([&] { runner_->follow(all_worlds_); });
  }

  /// In few launches: not before half as many worlds are gathered as are on the device.
  void begin_gathered()
  {
    if (gathered_.empty() || static_cast<int>(gathered_.size()) < std::min(most_at_once, running_ / 2)) return;
    bool allocated = false;
    std::vector<OperationQueue *> queues;
    for (World *world : gathered_) {
      queues.push_back(&world->backend->queue);
      allocated |= std::exchange(world->backend->allocated, false);
      world->at = At::device;
    }
    running_ += static_cast<int>(gathered_.size());
    gathered_.clear();
    attempt([&] {
      if (allocated) runner_->follow(all_worlds_);
      runner_->begin(queues);
    });
  }

  WorldRunner *runner_;
  const int all_worlds_;
  Failure &of_all_;
  std::exception_ptr failure_;  // of the device, when this thread knows it
  std::vector<World> worlds_;
  std::vector<World *> gathered_;
  int running_ = 0, left_ = 0;  // worlds on the device; worlds that have not ended
};

}  // namespace

long WorldServer::launches() const
{
  long sum = device_->backend->launches();
  for (const auto &runner : runners_)
    if (runner) sum += runner->launches();
  return sum;
}

void WorldServer::run(Crew &crew, std::vector<Task> &tasks)
{
  const OnDevice here(*device_->backend);
  const int count = static_cast<int>(tasks.size()), members = crew.size();
  while (static_cast<int>(fibers_.size()) < count) fibers_.push_back(std::make_unique<Fiber>());
  while (static_cast<int>(runners_.size()) < members) runners_.push_back(device_->backend->make_runner());
  for (int t = 0; t < count; ++t) {
    Task &task = tasks[static_cast<std::size_t>(t)];
    Fiber &fiber = *fibers_[static_cast<std::size_t>(t)];
    fiber.begin(task.work);
    task.world->fiber = &fiber;
  }
  Failure failure;
  crew.run([&](int member) {
    const OnDevice on(*device_->backend);
    Service service(runners_[static_cast<std::size_t>(member)].get(), count, failure);
    const auto place = [&](int of) { return static_cast<int>(static_cast<long>(count) * of / members); };
    for (int t = place(member); t < place(member + 1); ++t) service.add(*tasks[static_cast<std::size_t>(t)].world);
    service.run();
  });
  for (Task &task : tasks) {
    task.world->fiber = nullptr;
    task.world->failure = nullptr;
  }
  if (const std::exception_ptr what = failure.get()) std::rethrow_exception(what);
}

}  // namespace cama
