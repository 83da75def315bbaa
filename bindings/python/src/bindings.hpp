// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <array>
#include <memory>
#include <utility>
#include <vector>

#include "cama/mesh.hpp"
#include "cama/untangle.hpp"

/// The private module cama._core, which cama/*.py wraps. Shape, type and finiteness of arrays are checked in Python.
namespace cama::python {

namespace py = pybind11;
using Doubles = py::array_t<double, py::array::c_style>;
using Ints = py::array_t<int, py::array::c_style>;

void bind_errors(py::module_ &module);
void bind_scene(py::module_ &module);
void bind_arrays(py::module_ &module);
void bind_simulation(py::module_ &module);
void bind_worlds(py::module_ &module);
void bind_geometry(py::module_ &module);

py::dict to_dict(const UntangleReport &report);

static_assert(sizeof(dvec3) == 3 * sizeof(double) && sizeof(Triangle) == 3 * sizeof(int));

/// Array [rows, columns] that owns the vector's memory: no copy.
template <class Scalar, class T> py::array_t<Scalar> to_array(std::vector<T> values)
{
  constexpr py::ssize_t columns = sizeof(T) / sizeof(Scalar);
  auto *owned = new std::vector<T>(std::move(values));
  py::capsule owner(owned, [](void *p) { delete static_cast<std::vector<T> *>(p); });
  std::vector<py::ssize_t> shape{static_cast<py::ssize_t>(owned->size())};
  if (columns > 1) shape.push_back(columns);
  return py::array_t<Scalar>(shape, reinterpret_cast<Scalar *>(owned->data()), owner);
}

/// Rows of a checked array as values of type T.
template <class T, class Scalar> std::vector<T> to_vector(const py::array_t<Scalar, py::array::c_style> &array)
{
  static_assert(sizeof(T) % sizeof(Scalar) == 0);
  const T *first = reinterpret_cast<const T *>(array.data());
  return std::vector<T>(first, first + array.size() / static_cast<py::ssize_t>(sizeof(T) / sizeof(Scalar)));
}

inline std::array<double, 3> to_tuple(const dvec3 &v) { return {v.x, v.y, v.z}; }
inline dvec3 to_vec(const std::array<double, 3> &v) { return dvec3{v[0], v[1], v[2]}; }

/// A dvec3 member as a Python tuple of three floats.
template <class Class, class Owner> void vector_property(Class &bound, const char *name, dvec3 Owner::*member)
{
  bound.def_property(
      name, [member](const Owner &o) { return py::tuple(py::cast(to_tuple(o.*member))); },
      [member](Owner &o, const std::array<double, 3> &v) { o.*member = to_vec(v); });
}

}  // namespace cama::python
