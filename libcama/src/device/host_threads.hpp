// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <omp.h>

namespace cama {

/// Sets the number of OpenMP threads of the calling thread while this object exists, and restores it afterwards.
class HostThreads {
public:
  explicit HostThreads(int threads) : before_(omp_get_max_threads()) { omp_set_num_threads(threads); }
  ~HostThreads() { omp_set_num_threads(before_); }
  HostThreads(const HostThreads &) = delete;
  HostThreads &operator=(const HostThreads &) = delete;

private:
  int before_;
};

}  // namespace cama
