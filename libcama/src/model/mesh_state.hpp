// SPDX-License-Identifier: Apache-2.0
// Room of the state: vertices and what they connect.
#pragma once
#include <string>
#include <vector>

#include "cama/stream.hpp"
#include "device/kernels.hpp"
#include "model/clock.hpp"

namespace cama {

/// Vertices of cloth, then of obstacles, with their positions and connections.
struct MeshState {
  int cloth_vertices = 0, vertices = 0;
  int triangles = 0, hinges = 0;  // of cloth
  int faces = 0, edges = 0;  // of cloth and obstacles
  int pin_changes = 0;  // number of times that vertices were pinned or released
  int motion_changes = 0;  // number of times that static obstacles began to move
  Stream<dvec3> position, velocity;  // [vertices] m, m/s at the start of the step
  Stream<dvec3> position_next, velocity_next;  // [vertices] at the end of the step
  // [vertices] with BDF2: at the start of the previous step; of a vertex that penetration handling moved since, the
  // state from which it would have come to the present one
  Stream<dvec3> position_before, velocity_before;
  Stream<dvec3> position_base, velocity_base;  // [vertices] with BDF2: x*, v*
  // [cloth vertices] m/s, with BDF2 in a step with contacts, else empty: by what contact stopped abruptly
  Stream<dvec3> abrupt_change;
  Stream<dvec3> rest_position;  // [vertices] obstacles before their motion, if any moves rigidly
  Stream<double> inverse_mass;  // [vertices] 1/kg; 0: prescribed; with contact
  Stream<int> fixed;  // [vertices] 1: prescribed
  Stream<kernels::face_nodes> face;  // cloth, then obstacles; with contact
  Stream<kernels::edge_nodes> edge;
  Stream<kernels::edge_nodes> edge_wing;  // [edges] the vertices beside the edge in its faces, -1 where it has none
  std::vector<std::string> object_name;  // "cloth 'shirt'": cloths, then obstacles
  std::vector<int> object_first;  // their first vertices
  std::vector<char> object_static;  // 1: an obstacle that never moves

  /// Index of the object that a vertex belongs to: cloths, then obstacles.
  int object_of(int vertex) const;
  /// "cloth 'shirt', vertex 12": a vertex in the numbering of its own object.
  std::string describe(int vertex) const;
  /// The positions at which the first solve of the step is linearised.
  const Stream<dvec3> &linearised_position(const Clock &time) const
  {
    return time.predicted ? position_next : base_position(time);
  }
  /// x*, v* of this step.
  const Stream<dvec3> &base_position(const Clock &time) const { return time.multistep ? position_base : position; }
  const Stream<dvec3> &base_velocity(const Clock &time) const { return time.multistep ? velocity_base : velocity; }

  template <class F> void visit(F &&f)
  {
    f("position", Life::run, position);
    f("velocity", Life::run, velocity);
    f("position_next", Life::step, position_next);
    f("velocity_next", Life::step, velocity_next);
    f("position_before", Life::run, position_before);
    f("velocity_before", Life::run, velocity_before);
    f("position_base", Life::step, position_base);
    f("velocity_base", Life::step, velocity_base);
    f("abrupt_change", Life::step, abrupt_change);
    f("rest_position", Life::scene, rest_position);
    f("inverse_mass", Life::scene, inverse_mass);
    f("fixed", Life::scene, fixed);
    f("face", Life::scene, face);
    f("edge", Life::scene, edge);
    f("edge_wing", Life::scene, edge_wing);
  }
};

}  // namespace cama
