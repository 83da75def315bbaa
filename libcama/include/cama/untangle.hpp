// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "cama/scene.hpp"

namespace cama {

struct UntangleOptions {
  int max_rounds = 400;
  double gap = 0;  ///< distance aimed at between what was moved and everything else, m; 0: a tenth of the smallest
                   ///< contact thickness
};

struct UntangleReport {
  bool clean = false;  ///< no intersections, and every gap around what was moved is positive
  int before = 0, after = 0;  ///< intersections
  int rounds = 0;
  int moved = 0;  ///< cloth vertices that were moved; all others keep every bit
  double largest_move = 0;  ///< m
  double smallest_gap = 0;  ///< around what was moved, m; at most the gap aimed at; 0 if not clean
};

/// Moves cloth vertices of the start so that nothing intersects: cloth inside closed obstacles goes to their surface, a
/// contour is pushed back over its smaller side, and shrunk (Volino and Magnenat-Thalmann 2006) where neither side is
/// clearly smaller. Obstacles and pins stay. Cloth without material space takes the moved start as its rest state;
/// Options::intersections "untangle" keeps the old one. If something is left, the scene gets the positions with the
/// fewest intersections. Deterministic. Throws as Scene::validate.
UntangleReport untangle(Scene &scene, const UntangleOptions &options = {});

}  // namespace cama
