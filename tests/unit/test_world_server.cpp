// SPDX-License-Identifier: Apache-2.0
// Worlds that share a device, on one that answers late and in another order than it was asked: every world gets its own
// answers, memory that one releases serves another, and a failure reaches who has to know it.
#include "../catch.hpp"

#include <atomic>
#include <climits>
#include <cstdlib>
#include <cstring>
#include <iterator>
#include <map>
#include <memory>
#include <numeric>
#include <set>
#include <vector>

#include "cama/error.hpp"
#include "cama/stream.hpp"
#include "worlds/world_server.hpp"

using namespace cama;

namespace {

thread_local bool in_runner = false;  // which leaves releases to the server

/// Memory of the host; scans, and no kernels.
class LateDevice final : public Backend {
public:
  explicit LateDevice(bool with_runners = true, bool with_addresses = false)
      : with_runners_(with_runners), with_addresses_(with_addresses)
  {}

  std::string_view name() const override { return "late"; }
  std::string device() const override { return "host"; }
  bool wide_workers() const override { return false; }
  int workers() const override { return 1; }

  Buffer allocate(std::size_t bytes) override
  {
    if (allocated_ + bytes > limit) throw MemoryError("full");
    ++allocations;
    allocated_ += bytes;
    Buffer buffer = std::aligned_alloc(256, (bytes + 255) / 256 * 256);
    live.emplace(buffer, bytes);
    return buffer;
  }
  void release(Buffer buffer) noexcept override
  {
    if (in_runner) return;
    const auto found = live.find(buffer);
    if (found == live.end()) {
      released_twice = true;
      return;
    }
    allocated_ -= found->second;
    live.erase(found);
    std::free(buffer);
  }
  void upload(Buffer to, const void *from, std::size_t bytes) override { std::memcpy(to, from, bytes); }
  void download(void *to, Buffer from, std::size_t bytes, std::size_t offset) override
  {
    std::memcpy(to, static_cast<const char *>(from) + offset, bytes);
  }
  void copy(Buffer to, Buffer from, std::size_t bytes) override { std::memmove(to, from, bytes); }
  void fill(Buffer buffer, unsigned char byte, std::size_t bytes) override { std::memset(buffer, byte, bytes); }
  void launch(const KernelKey &, int, const Argument *, int) override { throw BackendError("no kernels"); }
  void scan(Buffer from, Buffer to, int n) override
  {
    long long sum = 0;
    for (int i = 0; i < n; ++i) {
      static_cast<int *>(to)[i] = static_cast<int>(sum);
      sum += static_cast<const int *>(from)[i];
    }
    if (sum > INT_MAX) throw ListOverflow();
    static_cast<int *>(to)[n] = static_cast<int>(sum);
  }
  void sort(Buffer, Buffer, int, int) override { throw BackendError("no sort"); }
  void synchronize() override {}
  std::unique_ptr<WorldRunner> make_runner() override;
  DeviceMemory memory() const override
  {
    return {with_addresses_ ? DeviceMemory::Kind::host : DeviceMemory::Kind::opaque, 0, 0};
  }

  std::size_t limit = std::size_t(1) << 40;
  int fails_at = INT_MAX;  // number of the beginning that fails, of all runners
  std::atomic<int> beginnings{0}, begun{0};
  int allocations = 0;
  bool released_twice = false;
  std::map<Buffer, std::size_t> live;

private:
  const bool with_runners_, with_addresses_;
};

/// Does a queue when it has been looked at for the first, second, ... or fifth time.
class LateRunner final : public WorldRunner {
public:
  explicit LateRunner(LateDevice &device) : device_(device) {}
  void follow(int) override {}
  bool suits(const OperationQueue &) const override { return true; }
  void begin(const std::vector<OperationQueue *> &queues) override
  {
    if (++device_.beginnings >= device_.fails_at) throw BackendError("lost");
    for (const OperationQueue *queue : queues) looks_[queue] = 1 + 7 * device_.begun++ % 5;
  }
  bool ended(OperationQueue &queue) override
  {
    int &looks = looks_.at(&queue);
    if (--looks > 0) return false;
    looks_.erase(&queue);
    in_runner = true;
    struct End {
      ~End() { in_runner = false; }
    } end;
    run_in_order(device_, queue);
    return true;
  }
  void check() override {}
  void wait() noexcept override { looks_.clear(); }
  long launches() const override { return 0; }

private:
  LateDevice &device_;
  std::map<const OperationQueue *, int> looks_;
};

std::unique_ptr<WorldRunner> LateDevice::make_runner()
{
  return with_runners_ ? std::make_unique<LateRunner>(*this) : nullptr;
}

/// Whether the device sums up n numbers as the host does.
bool sums_up(Backend &world, int n, int first)
{
  std::vector<int> values(static_cast<std::size_t>(n)), expected{0};
  std::iota(values.begin(), values.end(), first);
  std::partial_sum(values.begin(), values.end(), std::back_inserter(expected));
  Stream<int> from(world), to(world);
  from.assign(values);
  to.resize(n + 1);
  world.scan(from.buffer(), to.buffer(), n);
  return to.download() == expected;
}

/// A server, its device and its worlds.
struct Served {
  explicit Served(int worlds, bool with_runners = true)
  {
    auto owned = std::make_unique<LateDevice>(with_runners);
    device = owned.get();
    server = std::make_unique<WorldServer>(std::move(owned));
    for (int w = 0; w < worlds; ++w) world.push_back(server->make_world());
  }
  /// work(world, its number)
  template <class Work> void run(int threads, Work &&work)
  {
    Crew crew(threads);
    std::vector<WorldServer::Task> tasks;
    for (std::size_t w = 0; w < world.size(); ++w)
      tasks.push_back({world[w].get(), [&work, own = world[w].get(), w] { work(*own, static_cast<int>(w)); }});
    server->run(crew, tasks);
  }
  LateDevice *device;
  std::unique_ptr<WorldServer> server;
  std::vector<std::unique_ptr<RecordingBackend>> world;
};

constexpr int count = 40;

bool fibers_here()
{
  if (!Fiber::supported()) WARN("SKIPPED: this system has no fibers");
  return Fiber::supported();
}

}  // namespace

TEST_CASE("worlds get their own answers, in whatever order the device answers", "[world_server]")
{
  if (!fibers_here()) return;
  for (const bool with_runners : {true, false})
    for (const int threads : {1, 3}) {
      INFO(threads << " threads" << (with_runners ? "" : ", one world after the other"));
      Served served(count, with_runners);
      std::vector<int> right(count, 0), rounds(count);
      for (int w = 0; w < count; ++w) rounds[static_cast<std::size_t>(w)] = 1 + w % 7;
      served.run(threads, [&](Backend &world, int w) {
        const auto own = static_cast<std::size_t>(w);
        for (int r = 0; r < rounds[own]; ++r) right[own] += sums_up(world, 50 + 37 * ((5 * w + r) % 4), w + r);
      });
      CHECK(right == rounds);
      served.world.clear();
      CHECK_FALSE(served.device->released_twice);
      const int streams = 2 * std::accumulate(rounds.begin(), rounds.end(), 0);
      if (with_runners) CHECK(served.device->allocations < streams);
    }
}

TEST_CASE("worlds begin again after they have ended", "[world_server]")
{
  if (!fibers_here()) return;
  Served served(count);
  for (int turn = 0; turn < 3; ++turn) {
    std::atomic<int> right{0};
    served.run(2, [&](Backend &world, int w) { right += sums_up(world, 10 + w, turn); });
    CHECK(right == count);
  }
}

TEST_CASE("a list that is too long is the failure of its world alone", "[world_server]")
{
  if (!fibers_here()) return;
  for (const bool with_runners : {true, false}) {
    Served served(count, with_runners);
    std::atomic<int> right{0}, overflows{0};
    served.run(2, [&](Backend &world, int w) {
      try {
        if (w % 10 == 3) sums_up(world, 100, INT_MAX / 10);
      } catch (const ListOverflow &) {
        ++overflows;
      }
      right += sums_up(world, 20, w);
    });
    CHECK(overflows == 4);
    CHECK(right == count);
  }
}

TEST_CASE("a lost device ends the work of all worlds, and the call", "[world_server]")
{
  if (!fibers_here()) return;
  for (const int threads : {1, 3}) {
    Served served(count);
    served.device->fails_at = 4;
    std::atomic<int> done{0}, met{0};
    CHECK_THROWS_AS(served.run(threads,
                               [&](Backend &world, int w) {
                                 try {
                                   for (int r = 0; r < 5; ++r) sums_up(world, 20 + w, r);
                                   ++done;
                                 } catch (const BackendError &) {
                                   ++met;
                                 }
                               }),
                    BackendError);
    CHECK(met > 0);
    CHECK(done + met == count);
    served.device->fails_at = INT_MAX;
    std::atomic<int> right{0};
    served.run(threads, [&](Backend &world, int w) { right += sums_up(world, 20, w); });
    CHECK(right == count);
  }
}

TEST_CASE("a shared device keeps what is released, as long as there is room", "[world_server]")
{
  const std::size_t big = std::size_t(8) << 20, small = std::size_t(1) << 16, wanted = std::size_t(1) << 20;
  auto owned = std::make_unique<LateDevice>();
  LateDevice &device = *owned;
  {
    SharedDevice shared(std::move(owned));
    const Buffer kept = shared.allocate(big).buffer, passing = shared.allocate(small).buffer;
    shared.release(passing, small);
    CHECK(device.live.size() == 2);
    const SharedDevice::Allocation again = shared.allocate(small);
    CHECK(again.buffer == passing);
    CHECK_FALSE(again.fresh);
    shared.release(again.buffer, small);
    device.limit = big + wanted;  // too little while the small one is kept
    const SharedDevice::Allocation last = shared.allocate(wanted);
    CHECK(last.fresh);
    CHECK(device.live.size() == 2);
    CHECK_THROWS_AS(shared.allocate(small), MemoryError);
    shared.release(last.buffer, wanted);  // an eighth of 9 MiB at most is kept
    CHECK(device.live.size() == 2);
    shared.release(kept, big);
    CHECK(device.live.size() == 1);
  }
}

TEST_CASE("small buffers of a world are pieces of few where a buffer is an address", "[world_server]")
{
  constexpr int buffers = 300, turns = 20;
  for (const bool with_addresses : {true, false}) {
    INFO((with_addresses ? "addresses" : "handles"));
    auto owned = std::make_unique<LateDevice>(true, with_addresses);
    LateDevice &device = *owned;
    {
      const auto shared = std::make_shared<SharedDevice>(std::move(owned));
      RecordingBackend world(shared);
      std::vector<Stream<int>> own;
      for (int i = 0; i < buffers; ++i) {
        own.emplace_back(world, 1 + 37 * i % 4000);
        own.back().assign(std::vector<int>(static_cast<std::size_t>(1 + 37 * i % 4000), i));
      }
      const std::size_t peak = world.peak_bytes();
      for (int turn = 0; turn < turns; ++turn) {  // what is released serves again
        own[7] = Stream<int>(world);
        own[7].assign(std::vector<int>(1 + 37 * 7, 7));
      }
      CHECK(world.peak_bytes() == peak);
      for (int i = 0; i < buffers; ++i) {
        const std::vector<int> expected(static_cast<std::size_t>(1 + 37 * i % 4000), i);
        REQUIRE(own[static_cast<std::size_t>(i)].download() == expected);
        if (with_addresses)
          CHECK(reinterpret_cast<std::uintptr_t>(own[static_cast<std::size_t>(i)].buffer()) % 256 == 0);
      }
      if (with_addresses)
        CHECK(device.allocations < 15);
      else
        CHECK(device.allocations >= buffers);
    }
  }
}

TEST_CASE("rooms of buffers are few, and at most an eighth larger than asked for", "[world_server]")
{
  CHECK(SharedDevice::room_for(0) == 64);
  CHECK(SharedDevice::room_for(64) == 64);
  CHECK(SharedDevice::room_for(65) == 128);
  CHECK(SharedDevice::room_for(1023) == 1024);
  CHECK(SharedDevice::room_for(1025) == 1152);
  std::set<std::size_t> rooms;
  for (std::size_t bytes = 512; bytes < 1 << 20; bytes += 61) {
    const std::size_t room = SharedDevice::room_for(bytes);
    rooms.insert(room);
    REQUIRE(room >= bytes);
    REQUIRE(8 * room <= 9 * bytes + 8 * 64);
  }
  CHECK(rooms.size() <= 8 * 11 + 1);
}
