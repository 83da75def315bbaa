// SPDX-License-Identifier: Apache-2.0
#include "thread_governor.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <limits>
#include <string>

#if defined(__linux__)
#include <fcntl.h>
#include <unistd.h>
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

std::string first_line(const std::filesystem::path &file)
{
  std::string line;
  std::ifstream stream(file);
  std::getline(stream, line);
  return line;
}

/// Of one control group: cpu.max of version 2, cpu.cfs_* of version 1. The numbers are not read by streams: those fail
/// where a static and a shared standard library meet in one process.
double quota_of(const std::filesystem::path &group)
{
  std::string text = first_line(group / "cpu.max");
  if (text.empty()) text = first_line(group / "cpu.cfs_quota_us") + " " + first_line(group / "cpu.cfs_period_us");
  double quota = 0, period = 0;
  if (std::sscanf(text.c_str(), "%lf %lf", &quota, &period) != 2) return without_quota;   // "max 100000"
  return quota > 0 && period > 0 && quota < without_quota ? quota / period : without_quota;
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
