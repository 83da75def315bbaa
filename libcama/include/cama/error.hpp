// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <stdexcept>
#include <string>

namespace cama {

/// Root of every exception that this library throws.
class Error : public std::runtime_error {
public:
  using std::runtime_error::runtime_error;
};

/// A scene, option or parameter that cannot be simulated; the text names the field.
class SceneError : public Error {
  using Error::Error;
};
/// A mesh with a bad element; the text names the object and the element.
class MeshError : public Error {
  using Error::Error;
};
/// A material with a value outside its physical range.
class MaterialError : public Error {
  using Error::Error;
};
/// A file that is missing, unreadable or not of the stated format.
class FileError : public Error {
  using Error::Error;
};
/// A backend or device that is not there, or a call to it that failed.
class BackendError : public Error {
  using Error::Error;
};
/// A device that ran out of memory.
class MemoryError : public BackendError {
  using BackendError::BackendError;
};
/// A step that could not be computed: the solver broke down or a value is not finite.
class SolverError : public Error {
  using Error::Error;
};
/// A collision state that cannot be resolved: an intersecting start, or a pinch without a way out.
class CollisionError : public Error {
  using Error::Error;
};

}  // namespace cama
