// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>

#include "cama/device_array.hpp"
#include "turns.hpp"

namespace cama::python {

/// An array of a simulation with the turns of those who use its device.
struct LentArray {
  DeviceArray array;
  std::shared_ptr<Turns> turns;
  int worlds = 0;  ///< that the vectors are of, as many of each; 0: of one simulation

  std::vector<std::int64_t> shape() const
  {
    if (worlds == 0) return {array.size(), 3};
    return {worlds, array.size() / worlds, 3};
  }
};

/// An array of another library, which is kept until this object is gone.
class Received {
public:
  /// From a capsule of DLPack, which is used up.
  explicit Received(py::object capsule);
  /// From an address on a CUDA device, whose owner is kept.
  Received(std::uintptr_t address, std::vector<std::int64_t> shape, std::string type, py::object owner);
  ~Received();
  Received(const Received &) = delete;
  Received &operator=(const Received &) = delete;

  const std::vector<std::int64_t> &shape() const { return shape_; }
  const std::string &type() const { return type_; }
  bool dense() const { return dense_; }  ///< rows without gaps
  DeviceVectors vectors() const;  ///< of an array [..., 3]

private:
  py::object owner_;
  void *managed_ = nullptr;
  bool versioned_ = false;
  const void *data_ = nullptr;
  std::vector<std::int64_t> shape_;
  std::string type_;
  bool dense_ = true, in_order_ = true;
};

}  // namespace cama::python
