// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cstdint>
#include <limits>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "cama/mesh.hpp"

namespace cama {

/// Rows of the linear system in blocks, and blocks in blocks: what the Schwarz preconditioner keeps for several steps.
struct Matching {
  struct Level {
    std::vector<int> parent;   ///< [nodes] block of each row, or of each block of the level below, ascending
    std::vector<int> start;    ///< [blocks + 1] first node
  };
  int step = 0;                ///< in which the matching was made
  int terms = 0;               ///< contacts and stitches of that step
  int first_iterations = 0, last_iterations = 0;   ///< of the longest solve of that step, of the last step
  std::vector<int> order;      ///< [rows] free vertices; empty: no matching
  std::vector<Level> levels;
};

/// All data that later steps depend on besides scene and options: a simulation that continues from it takes the same
/// steps, bit by bit and on every backend, as the simulation that it was taken from.
struct Checkpoint {
  std::uint64_t scene = 0;                                    ///< hash of its meshes and masses
  int step = 0;                                               ///< number of steps taken
  double time_step = 0;                                       ///< s
  std::map<std::string, double> numbers;  ///< numbers kept from step to step: time and start_time, s, start_step, ...
  /// [all vertices] vectors kept likewise: position, m, velocity, m/s, ...; plastic_curvature, 1/m, of the triangles of
  /// cloth
  std::map<std::string, std::vector<dvec3>> vectors;
  double released = -std::numeric_limits<double>::infinity();  ///< s; pins that end by then have been released
  /// What a driver has set, by name; empty: nothing. Rows of numbers: pins (vertex, from, to, start and end, s), freed
  /// (vertex that the scene pins), attached (vertex, three vertices of an obstacle, weights, offset), poses (obstacle,
  /// time, translation, quaternion, scale), vertices.N (start, end, positions of obstacle N at both), force (N, of
  /// cloth vertices), gravity, m/s^2, wind, m/s, pressure, Pa, of cloths, gas (amount, J, and ambient pressure, Pa).
  std::map<std::string, std::vector<double>> driving;
  std::vector<std::pair<int, int>> tangled;  ///< vertices that may pass each other until they separate
  std::vector<std::pair<int, int>> let_go;  ///< vertex, object that it may pass until it separates
  /// Friction of the contacts of the last step, by kind (0: vertex and face, 1: two edges) and the numbers of the two,
  /// ascending: N on the side of the first.
  std::vector<std::array<int, 3>> friction_pair;
  std::vector<dvec3> friction_force;
  Matching matching;
};

}  // namespace cama
