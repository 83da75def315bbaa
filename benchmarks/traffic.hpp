// SPDX-License-Identifier: Apache-2.0
// The least number of bytes that a step has to move. docs/reference/performance.md holds the same formulas as a table.
#pragma once
#include <map>
#include <optional>
#include <string>

#include "cama/simulation.hpp"

namespace cama::benchmark {

/// The quantities that the bytes of a solve depend on.
struct SolveShape {
  double rows = 0, blocks = 0;      ///< of the matrix, 3x3 blocks
  double iterations = 0;
  double terms = 0, entries = 0;    ///< rank-one terms outside of the matrix, and their vertices
  std::string precision;            ///< double, mixed or single
  std::string preconditioner;       ///< none, jacobi, block_jacobi or schwarz
};

/// Bytes of an iteration of the conjugate gradient method with three kernels: product, update of x, r and z, update of
/// p.
double solve_bytes(const SolveShape &shape);

/// Bytes of each stage of the last step by its nested name, with sums for stages made of stages; stages without a
/// formula are absent.
std::map<std::string, double> step_bytes(const Simulation &simulation);

/// "stage" or "stage/part" for each of a step's timings, "step" for the whole.
std::string nested_name(const StageTime &time, std::string &outer);

}  // namespace cama::benchmark
