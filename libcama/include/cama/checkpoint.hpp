// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

#include "cama/mesh.hpp"

namespace cama {

/// Rows of the linear system in blocks, blocks in blocks: what the Schwarz preconditioner keeps for several steps.
struct Matching {
  struct Level {
    std::vector<int> parent;   ///< [nodes] block of each row, or of each block of the level below, ascending
    std::vector<int> start;    ///< [blocks + 1] first node
  };
  int step = 0;                ///< when it was made
  int terms = 0;               ///< contacts and stitches then
  int first_iterations = 0, last_iterations = 0;   ///< of the longest solve of that step, of the last step
  std::vector<int> order;      ///< [rows] free vertices; empty: no matching
  std::vector<Level> levels;
};

/// All that later steps depend on beside scene and options: a simulation that continues from it takes the same steps,
/// bit by bit, on every backend, as the one it is of.
struct Checkpoint {
  std::uint64_t scene = 0;                    ///< of meshes and masses; see Simulation::scene_key
  int step = 0;                               ///< steps done
  double time = 0, time_step = 0;             ///< s
  int start_step = 0;                         ///< time = start_time + (step - start_step) time_step
  double start_time = 0;                      ///< s
  std::vector<dvec3> positions, velocities;   ///< [all vertices] m, m/s
  std::vector<dvec3> positions_before, velocities_before;  ///< a step before, where BDF2 goes on from there; else empty
  double released = -std::numeric_limits<double>::infinity();  ///< s; pins whose end is not later have let go
  std::vector<std::pair<int, int>> tangled;  ///< vertices that may pass each other until they separate
  std::vector<std::pair<int, int>> let_go;  ///< vertex, object that it may pass until it separates
  Matching matching;
};

}  // namespace cama
