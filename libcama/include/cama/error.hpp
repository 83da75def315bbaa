// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <stdexcept>
#include <string>

namespace cama {

/// Base class of every exception of this library.
class Error : public std::runtime_error {
public:
  using std::runtime_error::runtime_error;
};

/// A scene, option or parameter that cannot be simulated; the message names the field.
class SceneError : public Error {
  using Error::Error;
};
/// A mesh with an invalid element; the message names the object and the element.
class MeshError : public Error {
  using Error::Error;
};
/// A material with a value outside its physical range; the message names the field.
class MaterialError : public Error {
  using Error::Error;
};
/// A file that is missing, unreadable or not of the stated format.
class FileError : public Error {
  using Error::Error;
};
/// A backend or device that is not available, or a call to it that failed.
class BackendError : public Error {
  using Error::Error;
};
/// A device that ran out of memory.
class MemoryError : public BackendError {
  using BackendError::BackendError;
};
/// A list with more entries than an index can count. A step that needs one is taken in pieces, as after a SolverError.
class ListOverflow : public MemoryError {
public:
  /// size: what is known of it.
  explicit ListOverflow(const std::string &size = {})
      : MemoryError("a list of this scene exceeds 2^31 entries" + size +
                    "; lower the resolution or the contact thickness")
  {}
};
/// A step that could not be computed: the solver broke down or a value is not finite.
class SolverError : public Error {
  using Error::Error;
};
/// A collision state that cannot be resolved: a start with intersections, or cloth that is pinched without a way out.
class CollisionError : public Error {
  using Error::Error;
};

}  // namespace cama
