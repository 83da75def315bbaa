// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "cama/scene.hpp"

namespace cama {

struct UntangleOptions {
  int max_rounds = 400;
  /// Desired distance between moved cloth and everything else, m; 0: a tenth of the smallest contact thickness.
  double gap = 0;
};

struct UntangleReport {
  bool clean = false;  ///< no intersections, and every gap around moved cloth is positive
  int before = 0, after = 0;  ///< intersections
  int rounds = 0;
  int moved = 0;  ///< cloth vertices that were moved; all others keep every bit
  double largest_move = 0;  ///< m
  double smallest_gap = 0;  ///< around moved cloth, m; at most the desired one; 0 if not clean
};

/// Moves cloth vertices of the start so that nothing intersects: cloth inside closed obstacles moves to their surface,
/// the smaller side of an intersection contour is pushed back through it, and the contour is shrunk (Volino and
/// Magnenat-Thalmann 2006) where neither side is clearly smaller. Obstacles and pins do not move. Cloth without
/// material space takes the moved start as its rest state; Options::intersections = untangle keeps the old one. If
/// intersections remain, the scene gets the positions with the fewest. Deterministic. Throws as Scene::validate.
UntangleReport untangle(Scene &scene, const UntangleOptions &options = {});

}  // namespace cama
