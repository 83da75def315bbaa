// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>
#include <vector>

#include "cama/backend.hpp"
#include "cama/types.hpp"

namespace cama {

struct Loan;

/// Vectors on a device, as they were when they were asked for: nothing writes to them afterwards. Copies of this object
/// share the memory, which lives until the last of them is gone, also beyond the simulation.
class DeviceArray {
public:
  DeviceArray(std::shared_ptr<Loan> loan, int size) : loan_(std::move(loan)), size_(size) {}

  void *data() const;  ///< address of `size` times three doubles
  int size() const { return size_; }
  DeviceMemory memory() const;
  // Both use the backend of the simulation: not while another thread uses it.
  DeviceArray copy() const;  ///< memory of its own on the device, which the caller may write to
  std::vector<dvec3> download() const;

private:
  std::shared_ptr<Loan> loan_;
  int size_ = 0;
};

/// Vectors of another library on the device of a simulation, row by row without gaps. All work on them is done, or
/// comes first in the backend's queue.
struct DeviceVectors {
  const void *data = nullptr;
  int size = 0;
  bool single = false;  ///< of floats, not doubles
  bool in_order =
      true;  ///< what writes them is done, or comes first in the backend's queue; else the device is waited for
};

}  // namespace cama
