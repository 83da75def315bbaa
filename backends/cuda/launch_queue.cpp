// SPDX-License-Identifier: Apache-2.0
#include "launch_queue.hpp"

#include <algorithm>
#include <stdexcept>

#include "check.hpp"

namespace cama {
namespace {

constexpr unsigned int mark_of_beside = 16;  // bytes of dynamic memory: see launched_beside in lang.h
constexpr int max_held = 12;  // launches of a batch: the device works on it while the host holds the next
constexpr int first_held = 4;  // of the first batch after the host has waited
constexpr int max_held_threads = 65536;  // of a launch that does not end a batch
constexpr std::size_t usual_launches = 256;  // of a list at most
constexpr std::size_t max_freed_later = std::size_t(1) << 20;  // bytes of a buffer that waits for a batch

}  // namespace

LaunchQueue::LaunchQueue(bool begins_early) : begins_early_(begins_early)
{
  for (cudaStream_t *stream : {&stream_, &side_})
    check(cudaStreamCreateWithFlags(stream, cudaStreamNonBlocking), "cudaStreamCreate");
  for (cudaEvent_t *event : {&forked_, &met_})
    check(cudaEventCreateWithFlags(event, cudaEventDisableTiming), "cudaEventCreate");
  // So that no list grows in a step: there is no launch, or release, without its place.
  held_.launches.reserve(usual_launches);
  held_.slots.reserve(usual_launches * (max_kernel_arguments + 1));
  freed_later_.reserve(usual_launches * max_kernel_arguments);
}

LaunchQueue::~LaunchQueue()
{
  stop();
  for (const cudaEvent_t event : {forked_, met_}) cudaEventDestroy(event);
  for (const cudaStream_t stream : {stream_, side_}) cudaStreamDestroy(stream);
}

void LaunchQueue::stop() noexcept
{
  give_up_held();
  for (const cudaStream_t stream : {side_, stream_}) cudaStreamSynchronize(stream);
}

/// The launch may begin while the one before it ends, but not behind several at once: which of them have ended by then
/// is not known. Hands over what is held if that is enough; a long launch leaves the host time for the next.
void LaunchQueue::launch(const void *function, const char *name, int blocks, int threads, const Slot *arguments,
                         int count)
{
  const bool early = begins_early_ && !after_several_;
  const unsigned int shared = side_by_side_ && beside_ > 0 ? mark_of_beside : 0;
  const int first = static_cast<int>(held_.slots.size());
  held_.slots.insert(held_.slots.end(), arguments, arguments + count);
  held_.launches.push_back({function, name, static_cast<unsigned int>(blocks), static_cast<unsigned int>(threads),
                            shared, early, first, count});
  after_several_ = false;
  if (side_by_side_) ++beside_;
  if (repeats_) return;
  if (!batches_ || static_cast<long long>(blocks) * threads > max_held_threads ||
      (held_.size() >= (idle_ ? first_held : max_held) && !side_by_side_))
    hand_over();
}

void LaunchQueue::free(void *memory, std::size_t bytes) noexcept
{
  if (held_.size() > 0 && bytes <= max_freed_later && freed_later_.size() < freed_later_.capacity())
    return freed_later_.push_back(memory);
  hand_over_or_note();
  cudaFreeAsync(memory, stream_);  // the pool keeps the memory
}

void LaunchQueue::end_batches() noexcept
{
  batches_ = false;
  hand_over_or_note();
}

void LaunchQueue::hand_over()
{
  if (repeats_) throw std::logic_error("work that is repeated only launches kernels");
  run_held(1, false);
}

void LaunchQueue::end_side_by_side()
{
  side_by_side_ = false;
  after_several_ |= beside_ > 1;
  beside_ = 0;
}

void LaunchQueue::fork()
{
  hand_over();
  check(cudaEventRecord(forked_, stream_), "cudaEventRecord");
}

void LaunchQueue::begin_aside()
{
  hand_over();
  check(cudaStreamWaitEvent(side_, forked_), "cudaStreamWaitEvent");
  std::swap(stream_, side_);
  after_several_ = true;
}

void LaunchQueue::end_aside() noexcept
{
  hand_over_or_note();
  std::swap(stream_, side_);
  after_several_ = apart_ = true;
}

void LaunchQueue::meet() noexcept
{
  hand_over_or_note();
  if (!std::exchange(apart_, false)) return;
  if (cudaEventRecord(met_, side_) != cudaSuccess || cudaStreamWaitEvent(stream_, met_) != cudaSuccess)
    cudaStreamSynchronize(side_);  // the device is lost, or at least the order is kept
  after_several_ = true;
}

void LaunchQueue::begin_repetition()
{
  hand_over();
  repeats_ = true;
}

void LaunchQueue::run_repetition(int times)
{
  repeats_ = false;
  run_held(times, true);
}

void LaunchQueue::give_up_repetition() noexcept
{
  repeats_ = false;
  give_up_held();
}

/// Launches what is held, and frees what was released behind it.
void LaunchQueue::run_held(int times, bool returns)
{
  if (failure_) {
    give_up_held();
    std::rethrow_exception(std::exchange(failure_, nullptr));
  }
  if (held_.size() == 0) return;
  idle_ = false;
  try {
    graphs_.run(held_, times, returns, stream_);
  } catch (...) {
    give_up_held();
    throw;
  }
  clear_held();
}

void LaunchQueue::hand_over_or_note() noexcept
{
  try {
    run_held(1, false);
  } catch (...) {
    failure_ = std::current_exception();
  }
}

void LaunchQueue::clear_held() noexcept
{
  held_.clear();
  for (void *memory : freed_later_) cudaFreeAsync(memory, stream_);
  freed_later_.clear();
}

void LaunchQueue::give_up_held() noexcept
{
  clear_held();
  after_several_ = true;  // what the next launch is behind is not known
}

}  // namespace cama
