// SPDX-License-Identifier: Apache-2.0
// Rooms of the state by which candidate pairs are searched for: bounds of vertices, and trees or fronts.
#pragma once
#include "cama/stream.hpp"
#include "device/kernels.hpp"
#include "model/life.hpp"

namespace cama {

/// Where vertices may be during the step, by which candidate pairs are searched for.
struct BoundsState {
  // [vertices] the end of the motion that bounds are for: the ballistic one, or what the solve has led to
  Stream<dvec3> predicted;
  Stream<int> query_vertices;  // vertices that are tested against faces: all but those that define planes
  Stream<double> margin;  // [vertices] by which boxes are inflated, m
  Stream<double> short_motion;  // [vertices] length of a motion that hardly passes other features, m
  double spacing = 0;  // mean distance of the cloth's vertices (root of their areas), m
  Stream<double> uncertain;  // [1] how far gravity moves a free vertex in the step, m
  Stream<dvec3> bounds;  // [2] of the scene
  // [2] if obstacles are at rest, the bounds when their boxes were made, which boxes are relative to
  Stream<dvec3> origin;
  Stream<kernels::box> vertex_box;
  const Stream<dvec3> &box_origin() const { return origin.size() ? origin : bounds; }

  template <class F> void visit(F &&f)
  {
    f("predicted", Life::step, predicted);
    f("query_vertices", Life::scene, query_vertices);
    f("margin", Life::scene, margin);
    f("bounds", Life::step, bounds);
    f("origin", Life::step, origin);
    f("vertex_box", Life::step, vertex_box);
    f("short_motion", Life::scene, short_motion);
    f("uncertain", Life::step, uncertain);
  }
};

/// Faces and edges of some objects along the Morton curve, under trees with eight children to a node.
struct FeatureTrees {
  Stream<int> face_order, edge_order;  // leaf to primitive
  Stream<kernels::bvh8_node> face_bvh, edge_bvh;

  template <class F> void visit(const char *const (&name)[4], F &&f)
  {
    f(name[0], Life::step, face_order);
    f(name[1], Life::step, edge_order);
    f(name[2], Life::step, face_bvh);
    f(name[3], Life::step, edge_bvh);
  }
};

/// The room of TreeSearch.
struct TreeState {
  FeatureTrees cloth, moving, resting;  // of the cloth, of moving obstacles, of static ones

  template <class F> void visit(F &&f)
  {
    cloth.visit({"trees.cloth.face_order", "trees.cloth.edge_order", "trees.cloth.face_bvh", "trees.cloth.edge_bvh"},
                f);
    moving.visit(
        {"trees.moving.face_order", "trees.moving.edge_order", "trees.moving.face_bvh", "trees.moving.edge_bvh"}, f);
    resting.visit(
        {"trees.resting.face_order", "trees.resting.edge_order", "trees.resting.face_bvh", "trees.resting.edge_bvh"},
        f);
  }
};

/// The room of FrontSearch.
struct FrontState {
  Stream<kernels::box> face_box, edge_box;
  Stream<kernels::box> face_tree, obstacle_tree;  // binary trees of the cloth and of the obstacles
  Stream<int> face_order, obstacle_order;  // leaf to face
  Stream<kernels::face_features> face_features;
  Stream<kernels::pair> front, self_front;  // of cloth with obstacles, of cloth with itself: pairs of nodes
  Stream<kernels::pair> triangle_pairs;  // of the last search or localized update
  Stream<kernels::pair> orphan_vertex_face, orphan_edge_edge;  // feature pairs of adjacent triangles

  template <class F> void visit(F &&f)
  {
    f("face_box", Life::step, face_box);
    f("edge_box", Life::step, edge_box);
    f("face_tree", Life::step, face_tree);
    f("obstacle_tree", Life::step, obstacle_tree);
    f("face_order", Life::step, face_order);
    f("obstacle_order", Life::step, obstacle_order);
    f("face_features", Life::scene, face_features);
    f("front", Life::step, front);
    f("self_front", Life::step, self_front);
    f("triangle_pairs", Life::step, triangle_pairs);
    f("orphan_vertex_face", Life::scene, orphan_vertex_face);
    f("orphan_edge_edge", Life::scene, orphan_edge_edge);
  }
};

}  // namespace cama
