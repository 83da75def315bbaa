# SPDX-License-Identifier: Apache-2.0
# cama_flags: how the library and everything that calls kernels inline is compiled. Strict floating point gives the same bits
# from every backend; mixing flags would mix bits and memory layouts.
add_library(cama_flags INTERFACE)
target_compile_options(cama_flags INTERFACE -Wall -Wextra -fno-math-errno -fno-trapping-math)
if(NOT CAMA_FAST_MATH)
  target_compile_options(cama_flags INTERFACE -ffp-contract=off)
endif()
# Eigen's own vectors multiply and add in one rounding where the CPU can; the coupling of hinges is computed with Eigen.
target_compile_definitions(cama_flags INTERFACE EIGEN_DONT_VECTORIZE)
if(CAMA_NATIVE)
  target_compile_options(cama_flags INTERFACE -march=native)
endif()
if(CAMA_SANITIZE)
  target_compile_options(cama_flags INTERFACE -fsanitize=address,undefined -fno-omit-frame-pointer)
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")   # GCC bug 110027: such frames are not aligned for vectors of 64 bytes
    target_compile_options(cama_flags INTERFACE --param=asan-use-after-return=0)
  endif()
endif()
