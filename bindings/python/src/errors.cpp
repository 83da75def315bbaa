// SPDX-License-Identifier: Apache-2.0
#include "cama/error.hpp"

#include "bindings.hpp"

namespace cama::python {
namespace {

constexpr std::size_t longest = 4000;  // bytes of a text: it may quote a line of a damaged file

/// Binds an exception. Its text may quote a file in any encoding: bytes that are not UTF-8 are replaced.
template <class Exception>
py::object bind_error(py::module_ &module, const char *name, py::handle base, const char *text)
{
  static PyObject *type = nullptr;  // one for each class
  py::exception<Exception> made(module, name, base);
  made.attr("__module__") = "cama";
  made.attr("__doc__") = text;
  type = made.inc_ref().ptr();
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const Exception &problem) {
      std::string what = problem.what();
      if (what.size() > longest) what.replace(longest / 2, what.size() - longest, " ... ");
      PyObject *decoded = PyUnicode_DecodeUTF8(what.data(), static_cast<py::ssize_t>(what.size()), "replace");
      if (!decoded) return;  // Python's own error is set
      PyErr_SetObject(type, decoded);
      Py_DECREF(decoded);
    }
  });
  return std::move(made);
}

}  // namespace

/// Base classes first: translators are tried in reverse order of registration.
void bind_errors(py::module_ &m)
{
  const py::object error =
      bind_error<Error>(m, "Error", PyExc_Exception, "Base class of all exceptions that cama raises.");
  bind_error<SceneError>(m, "SceneError", error,
                         "A scene, option or parameter that cannot be simulated; the message names the field.");
  bind_error<MeshError>(m, "MeshError", error,
                        "A mesh with an invalid element; the message names the object and the element.");
  bind_error<MaterialError>(m, "MaterialError", error,
                            "A material with a value outside its physical range; the message names the field.");
  bind_error<FileError>(m, "FileError", error, "A file that is missing, unreadable or not of the stated format.");
  const py::object backend = bind_error<BackendError>(
      m, "BackendError", error, "A backend or device that is not available, or a call to it that failed.");
  bind_error<MemoryError>(m, "DeviceMemoryError", backend, "A device that ran out of memory.");
  bind_error<SolverError>(m, "SolverError", error,
                          "A step that could not be computed: the solver broke down or a value is not finite.");
  bind_error<CollisionError>(m, "CollisionError", error,
                             "A start with intersections, or cloth that is pinched without a way out.");
}

}  // namespace cama::python
