// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace cama {

/// Chooses how many threads compute while other programs use the CPUs too. Every loop ends when its last thread does:
/// one thread that waits for a CPU, for milliseconds, holds up all others. So there are no more threads than CPUs that
/// are free; now and then one more is tried.
class ThreadGovernor {
public:
  explicit ThreadGovernor(int most) : most_(most), threads_(most) {}
  int most() const { return most_; }
  int threads() const { return threads_; }
  /// What happened since the last call. elapsed, s; waited: for how long threads were ready to run without a CPU, s,
  /// summed over them.
  void observe(double elapsed, double waited);

private:
  int most_, threads_;
  double now_ = 0, next_trial_ = 0;   // s
  double patience_ = first_patience;  // until the next trial, s
  bool trying_ = false;               // one more than before

  static constexpr double first_patience = 0.25, last_patience = 8;
  static constexpr double crowded = 0.15;  // CPUs that threads lack: more is a busy neighbour
};

/// How long this thread has been ready to run without a CPU, s; 0 where the system does not say.
double waited_for_cpu();

/// CPUs that the control group of this process may use: 1.5 for 150 ms in every 100 ms; infinity without a quota.
/// cgroup: /proc/self/cgroup; root: /sys/fs/cgroup.
double cpu_quota(const char *cgroup = "/proc/self/cgroup", const char *root = "/sys/fs/cgroup");

}  // namespace cama
