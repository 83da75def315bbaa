// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

namespace cama {

/// Anderson mixing for g(x) = 0: steps along g, corrected by what the steps before have told of how g changes with x.
/// Where g is affine, it converges as GMRES does (Walker and Ni 2011). Elsewhere newer steps tell more than older ones:
/// these correct only what the newer ones leave.
class AndersonMixing {
public:
  void begin();
  /// The next x, from this one and g there.
  std::vector<double> next(const std::vector<double> &x, const std::vector<double> &g);

private:
  struct Change {
    std::vector<double> x, g;
  };
  std::vector<Change> changes_;  // the oldest first
  std::vector<double> x_before_, g_before_;
};

}  // namespace cama
