// SPDX-License-Identifier: Apache-2.0
#include "start/start_policy.hpp"

#include "cama/error.hpp"
#include "cama/intersections.hpp"
#include "exact/exact_audit.hpp"
#include "start/start_check.hpp"

namespace cama {
namespace {

std::string counted(std::size_t count)
{
  return std::to_string(count) + (count == 1 ? " intersection" : " intersections");
}

/// "triangle 3 of cloth 'a' reaches into obstacle 'ball'"
std::string describe(const Intrusion &i, const Topology &t)
{
  const bool plane = t.shape[static_cast<std::size_t>(i.vertex)] == ObstacleShape::plane;
  const int vertex = plane ? i.feature : t.face[static_cast<std::size_t>(i.feature)][0];
  return (plane ? "vertex " : "triangle ") + std::to_string(i.feature) + " of " + t.owner(vertex) +
         (plane ? " is below " : " reaches into ") + t.owner(i.vertex);
}

/// Throws CollisionError for cloth in exact spheres and capsules or below planes, which cannot be untangled.
void check_exact_start(const Topology &t)
{
  const std::vector<Intrusion> inside = intrusions(t.position, t);
  if (inside.empty()) return;
  throw CollisionError("the scene starts with " + counted(inside.size()) +
                       " with exact obstacles; the first: " + describe(inside.front(), t) +
                       " (numbers over all objects); move the objects apart, or set the option intersections to "
                       "\"exempt\" (starts as it is)");
}

}  // namespace

UntangleReport treat_start(const Scene &scene, StartPolicy policy, Topology &t)
{
  UntangleReport untangled;
  if (policy == StartPolicy::exempt || !scene.has_contact()) return untangled;
  const bool untangles = policy == StartPolicy::untangle;
  bool clean = untangles;
  if (untangles && !forbidden_intersections(t.position, t, scene.contact.self).empty()) {
    untangled = untangle(scene, t);
    clean = untangled.clean;
  }
  if (clean) {
    check_exact_start(t);
    return untangled;
  }
  const std::vector<ObjectIntersections> found = by_objects(scene, t, t.position);
  if (found.empty() && !untangles) {
    check_exact_start(t);
    return untangled;
  }
  const std::string history = !untangles ? ""
                                         : "untangling took " + std::to_string(untangled.rounds) + " rounds from " +
                                               std::to_string(untangled.before) + " intersections to " +
                                               std::to_string(untangled.after) + "; ";
  throw CollisionError("the scene starts with intersections: " + history +
                       (found.empty() ? "parts that touch" : cama::describe(found)) +
                       "; move the objects apart, see them with `cama check SCENE --mesh intersections.ply`, or set "
                       "the option intersections to " +
                       (untangles ? "" : "\"untangle\" (moves the cloth) or ") + "\"exempt\" (starts as it is)");
}

void check_positions(const std::vector<dvec3> &position, const Topology &t, bool self)
{
  const std::vector<Intersection> found = forbidden_intersections(position, t, self);
  const std::vector<Intrusion> inside = intrusions(position, t);
  if (found.empty() && inside.empty()) return;
  std::string first;
  if (found.empty()) {
    first = describe(inside.front(), t);
  } else {
    const auto [edge, face] = found.front();
    first = "the edge of vertices " + std::to_string(edge[0]) + " and " + std::to_string(edge[1]) + " of " +
            t.owner(edge[0]) + " crosses triangle " + std::to_string(face) + " of " +
            t.owner(t.face[static_cast<std::size_t>(face)][0]);
  }
  throw CollisionError("positions: have " + counted(found.size() + inside.size()) + "; the first: " + first +
                       " (numbers over all objects); the state is unchanged. Give positions without intersections, "
                       "or make the simulation with the option intersections set to \"exempt\"");
}

}  // namespace cama
