// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace cama {

/// A text file that is compiled into the library (cmake/EmbedText.cmake).
struct EmbeddedText {
  const char *name;
  const char *text;
};

extern const EmbeddedText embedded_fabrics[];   ///< materials/*.json; ended by {nullptr, nullptr}
extern const EmbeddedText embedded_kernels[];      ///< libcama/kernels/, where OpenCL is built in
extern const EmbeddedText embedded_primitives[];   ///< backends/opencl/primitives.cl, where OpenCL is built in

}  // namespace cama
