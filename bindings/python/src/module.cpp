// SPDX-License-Identifier: Apache-2.0
#include "bindings.hpp"
#include "cama/backend.hpp"

PYBIND11_MODULE(_core, m)
{
  namespace py = pybind11;
  m.doc() = "Compiled part of cama; use the package, not this module.";
  cama::python::bind_errors(m);
  cama::python::bind_scene(m);
  cama::python::bind_arrays(m);
  cama::python::bind_simulation(m);
  cama::python::bind_worlds(m);
  cama::python::bind_geometry(m);

  m.attr("__version__") = CAMA_VERSION;
  m.attr("compiler") = CAMA_COMPILER;
  m.def("list_backends", [] {
    py::list rows;
    for (const cama::BackendInfo &b : cama::list_backends()) {
      py::dict row;
      row["name"] = b.name;
      row["available"] = b.available;
      row["devices"] = b.devices;
      row["note"] = b.note;
      rows.append(row);
    }
    return rows;
  });
}
