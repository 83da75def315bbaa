// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>

/// The structures of DLPack 1.0, by which array libraries hand memory to each other: https://dmlc.github.io/dlpack/
namespace cama::python::dlpack {

constexpr std::int32_t host = 1, cuda = 2;              // kinds of devices
constexpr std::uint8_t floating = 2;                    // kind of numbers
constexpr std::uint32_t major_version = 1, minor_version = 0;
constexpr std::uint64_t read_only = 1, is_copy = 2;     // flags
constexpr const char *name = "dltensor", *used_name = "used_dltensor";  // of a capsule, and once it was taken
constexpr const char *versioned_name = "dltensor_versioned", *used_versioned_name = "used_dltensor_versioned";

struct Device {
  std::int32_t kind;
  std::int32_t index;
};
struct Type {
  std::uint8_t kind;
  std::uint8_t bits;
  std::uint16_t lanes;
};
struct Tensor {
  void *data;
  Device device;
  std::int32_t dimensions;
  Type type;
  std::int64_t *shape;
  std::int64_t *strides;  // in elements; null: rows without gaps
  std::uint64_t byte_offset;
};
/// Before version 1.0.
struct Managed {
  Tensor tensor;
  void *context;
  void (*deleter)(Managed *);
};
struct ManagedVersioned {
  std::uint32_t major, minor;
  void *context;
  void (*deleter)(ManagedVersioned *);
  std::uint64_t flags;
  Tensor tensor;
};

}  // namespace cama::python::dlpack
