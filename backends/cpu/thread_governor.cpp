// SPDX-License-Identifier: Apache-2.0
#include "thread_governor.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <string>

#if defined(__linux__)
#include <fcntl.h>
#include <unistd.h>

#include <cstdio>
#endif

namespace cama {

void ThreadGovernor::observe(double elapsed, double waited)
{
  now_ += elapsed;
  const double lacking = elapsed > 0 ? waited / elapsed : 0;
  if (lacking > crowded && threads_ > 1) {
    if (trying_) patience_ = std::min(2 * patience_, last_patience);
    threads_ = std::max(1, threads_ - std::max(1, static_cast<int>(std::lround(lacking))));
    trying_ = false;
    next_trial_ = now_ + patience_;
    return;
  }
  if (trying_) {   // it went well
    trying_ = false;
    patience_ = first_patience;
  }
  if (threads_ < most_ && now_ >= next_trial_ && lacking <= crowded) {
    ++threads_;
    trying_ = true;
  }
}

#if defined(__linux__)
namespace {

/// The scheduler's statistics of one thread.
class Statistics {
public:
  Statistics() : file_(open("/proc/thread-self/schedstat", O_RDONLY | O_CLOEXEC)) {}
  ~Statistics()
  {
    if (file_ >= 0) close(file_);
  }
  double waited() const
  {
    char text[96];
    const ssize_t size = file_ >= 0 ? pread(file_, text, sizeof text - 1, 0) : 0;
    if (size <= 0) return 0;
    text[size] = 0;
    unsigned long long ran, waited;   // ns
    return std::sscanf(text, "%llu %llu", &ran, &waited) == 2 ? 1e-9 * static_cast<double>(waited) : 0;
  }

private:
  int file_;
};

}  // namespace

double waited_for_cpu()
{
  static thread_local Statistics own;
  return own.waited();
}
#else
double waited_for_cpu() { return 0; }
#endif

namespace {

constexpr double without_quota = std::numeric_limits<double>::infinity();

/// Of one control group: cpu.max of version 2, cpu.cfs_* of version 1.
double quota_of(const std::filesystem::path &group)
{
  std::string quota;
  double period = 0;
  if (!(std::ifstream(group / "cpu.max") >> quota >> period)) {
    std::ifstream(group / "cpu.cfs_quota_us") >> quota;
    std::ifstream(group / "cpu.cfs_period_us") >> period;
  }
  if (quota.empty() || quota == "max" || quota[0] == '-' || !(period > 0)) return without_quota;
  char *end;
  const double time = std::strtod(quota.c_str(), &end);
  return *end == 0 && time > 0 ? time / period : without_quota;
}

}  // namespace

double cpu_quota(const char *cgroup, const char *root)
{
  namespace fs = std::filesystem;
  double least = without_quota;
  std::ifstream file(cgroup);
  for (std::string line; std::getline(file, line);) {   // hierarchy:controllers:path
    const std::size_t first = line.find(':'), second = line.find(':', first + 1);
    if (second == std::string::npos) continue;
    const std::string controllers = "," + line.substr(first + 1, second - first - 1) + ",";
    if (controllers != ",," && controllers.find(",cpu,") == std::string::npos) continue;
    const fs::path top = controllers == ",," ? fs::path(root) : fs::path(root) / "cpu";
    // Every group above limits too. In a container the path may be that outside: then only the top is there.
    for (fs::path path = fs::path(line.substr(second + 1)).relative_path();; path = path.parent_path()) {
      least = std::min(least, quota_of(top / path));
      if (path.empty()) break;
    }
  }
  return least;
}

}  // namespace cama
