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

/// Pairs of features that are exempt from contact, given by their vertices: both sides of a seam; and, if the user's
/// policy allows it, tangled cloth and cloth that an obstacle released, until they separate. Symmetric pairs (vertex,
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
  /// Removes the pairs that have separated: those of tangled cloth one by one, those of cloth released by one object
  /// all together, so that no vertex is held on the wrong side while its neighbours are caught. Returns whether there
  /// were any. `face`: of the whole scene.
  bool forget_separated(const std::vector<dvec3> &position, const std::vector<Triangle> &face, int cloth_vertices);
  /// Copies the lists to the device.
  void upload();
  /// Called at the start of a step, whose state `restore` returns to. Uploads lists that a failed step left outdated.
  void begin_step();
  /// Called after a step that failed: the pairs are those of its start again.
  void restore() noexcept;

  /// The temporary pairs, for returning to them after several steps.
  using Kept = std::pair<Pairs, Pairs>;
  Kept kept() const { return {tangled_, released_}; }
  void keep(Kept &kept) noexcept;

  bool any() const { return !seam_.empty() || !tangled_.empty() || !released_.empty(); }
  int temporary() const { return static_cast<int>(tangled_.size() + released_.size()); }

  Stream<int> row, entry;  // [vertices + 1], [sum] sorted: vertices, and vertices + object, that the vertex may pass
  Stream<int> object;  // [vertices] cloth index, or cloths + obstacle index

  /// Calls f(name, life, stream) for every stream. They are Life::scene, since restore() handles failing steps.
  template <class Life, class F> void visit(Life life, F &&f)
  {
    f("exemptions.row", life, row);
    f("exemptions.entry", life, entry);
    f("exemptions.object", life, object);
  }

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
