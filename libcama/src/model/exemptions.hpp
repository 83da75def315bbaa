// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <algorithm>
#include <set>
#include <utility>
#include <vector>

#include "cama/geometry.hpp"
#include "cama/stream.hpp"
#include "model/topology.hpp"

namespace cama {

/// Pairs of features that contact passes over, named by their vertices: both sides of a seam; and, where the user's
/// policy allows it, tangled cloth and cloth that an obstacle let go of, until they separate. Symmetric pairs (vertex,
/// vertex), or (vertex, object).
class Exemptions {
public:
  using Pairs = std::set<std::pair<int, int>>;

  void set_up(Backend &backend, const Topology &topology);
  /// Vertices of intersecting cloth may pass each other; those that intersect an obstacle may pass the whole of it.
  void add_tangle(const std::vector<Intersection> &found, const Topology &topology);
  /// A cloth vertex may pass an object.
  void let_go(int vertex, int object) { released_.insert({vertex, object}); }
  void let_pass(int a, int b) { tangled_.insert({std::min(a, b), std::max(a, b)}); }
  /// Forgets the pairs that have come apart: of tangled cloth each by itself, of released cloth all that one object let
  /// go of together, so that none is held on the wrong side while its neighbours are caught. True if any did. `face`:
  /// of the whole scene.
  bool forget_separated(const std::vector<dvec3> &position, const std::vector<Triangle> &face, int cloth_vertices);
  /// Brings the lists to the device.
  void upload();
  /// At the start of a step: what `restore` comes back to. Brings lists to the device that a failed step left behind.
  void begin_step();
  /// After a step that failed: the pairs are those of its start.
  void restore() noexcept;

  /// The temporary pairs, to come back to over more than one step.
  using Kept = std::pair<Pairs, Pairs>;
  Kept kept() const { return {tangled_, released_}; }
  void keep(Kept &kept) noexcept;

  bool any() const { return !seam_.empty() || !tangled_.empty() || !released_.empty(); }
  int temporary() const { return static_cast<int>(tangled_.size() + released_.size()); }

  Stream<int> row, entry;  // [vertices + 1], [sum] sorted: vertices, and vertices + object, that the vertex may pass
  Stream<int> object;  // [vertices] cloth index, or cloths + obstacle index

private:
  Pairs seam_, tangled_, released_;
  Pairs tangled_before_, released_before_;
  bool marked_ = false;  // there is something to restore
  bool stale_ = false;  // the device's lists are not those of the host
  std::vector<int> object_;
};

/// Vertices that stitches join, with their neighbours along the seam.
std::set<std::pair<int, int>> seam_pairs(const Scene &scene, const Topology &topology);

/// Do edge and face of an intersection belong to both sides of a seam?
bool at_seam(const Topology &topology, const Intersection &found);

}  // namespace cama
