// SPDX-License-Identifier: Apache-2.0
// How many threads compute beside other programs, and what a container allows.
#include "../catch.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>

#include "backends/cpu/thread_governor.hpp"

using namespace cama;

namespace {

/// A machine whose CPUs are shared evenly by all threads that are ready to run.
struct Machine {
  double cpus;
  int busy;   // threads of other programs

  double waited(int threads, double elapsed) const
  {
    const double share = std::min(1.0, cpus / (threads + busy));
    return threads * (1 - share) * elapsed;
  }
};

/// Mean number of threads over so many seconds.
double run(ThreadGovernor &governor, const Machine &machine, double seconds)
{
  double sum = 0;
  const double look = 0.02;
  const int looks = static_cast<int>(seconds / look);
  for (int i = 0; i < looks; ++i) {
    sum += governor.threads();
    governor.observe(look, machine.waited(governor.threads(), look));
  }
  return sum / looks;
}

}  // namespace

TEST_CASE("threads make room for other programs and come back", "[threads]")
{
  ThreadGovernor two(2);
  CHECK(run(two, {2, 0}, 1) == 2);
  run(two, {2, 1}, 1);
  CHECK(run(two, {2, 1}, 20) < 1.02);   // trials of one look now and then
  run(two, {2, 0}, 8.1);                // until the next trial, at most
  CHECK(run(two, {2, 0}, 5) == 2);
  CHECK(run(two, {2, 2}, 20) < 1.02);

  ThreadGovernor many(16);
  run(many, {16, 1}, 2);
  CHECK(std::round(run(many, {16, 1}, 20)) == 15);
  run(many, {16, 10}, 2);
  CHECK(std::round(run(many, {16, 10}, 20)) == 6);
  run(many, {16, 0}, 20);
  CHECK(many.threads() == 16);

  ThreadGovernor one(1);
  CHECK(run(one, {2, 4}, 5) == 1);
}

TEST_CASE("a thread that sleeps does not wait for a CPU", "[threads]")
{
  const double before = waited_for_cpu();
  CHECK(before >= 0);
  CHECK(waited_for_cpu() - before < 1);
}

TEST_CASE("the quota of a control group and of those above it", "[threads]")
{
  namespace fs = std::filesystem;
  const fs::path root = fs::temp_directory_path() / "cama_test_cgroup";
  fs::remove_all(root);
  const auto write = [&](const fs::path &file, const std::string &text) {
    fs::create_directories((root / file).parent_path());
    std::ofstream(root / file) << text;
  };
  const auto quota = [&] { return cpu_quota((root / "self").c_str(), root.c_str()); };
  CHECK(std::isinf(quota()));   // no such file
  write("self", "0::/a/b\n");
  CHECK(std::isinf(quota()));
  write("a/b/cpu.max", "max 100000\n");
  CHECK(std::isinf(quota()));
  write("a/cpu.max", "350000 100000\n");
  CHECK(quota() == 3.5);
  write("a/b/cpu.max", "50000 100000\n");
  CHECK(quota() == 0.5);
  write("self", "0::/outside/of/the/container\n");
  CHECK(std::isinf(quota()));
  write("cpu.max", "200000 100000\n");
  CHECK(quota() == 2);
  write("self", "5:cpuset:/x\n3:cpu,cpuacct:/c\n");   // version 1
  write("cpu/c/cpu.cfs_quota_us", "-1\n");
  write("cpu/c/cpu.cfs_period_us", "100000\n");
  CHECK(std::isinf(quota()));
  write("cpu/c/cpu.cfs_quota_us", "150000\n");
  CHECK(quota() == 1.5);
  for (const char *nonsense : {"", "x", "100 0", "-5 100000", "1e400 100000"}) {
    write("self", "0::/\n");
    write("cpu.max", nonsense);
    CHECK_FALSE(quota() <= 0);
  }
  fs::remove_all(root);
}
