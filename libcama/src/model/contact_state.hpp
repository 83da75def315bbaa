// SPDX-License-Identifier: Apache-2.0
// Room of the state: candidate pairs, contacts and impacts.
#pragma once
#include "cama/scene.hpp"
#include "cama/stream.hpp"
#include "device/kernels.hpp"
#include "model/life.hpp"

namespace cama {

/// Candidate pairs of one kind.
struct PairList {
  Stream<kernels::pair> pairs;
  Stream<kernels::fvec3> direction;  // [pairs] a direction that separates the sides, from B to A
  // [pairs] lower bound of the distance along `direction` until the prediction, m; 0: unknown; below 0: an impact of
  // this step
  Stream<float> gap_bound;

  template <class F> void visit(const char *const (&name)[3], F &&f)
  {
    f(name[0], Life::step, pairs);
    f(name[1], Life::step, direction);
    f(name[2], Life::step, gap_bound);
  }
};

/// Friction of contacts at the end of a step, with friction and several solves a step; else without a backend.
struct KeptFriction {
  Stream<key64> key;  // [contacts] features of each contact, ascending
  Stream<dvec3> force;  // [contacts] N on side A

  void set_up(Backend &backend)
  {
    key = Stream<key64>(backend);
    force = Stream<dvec3>(backend);
  }
  void resize(int size)
  {
    key.resize(size);
    force.resize(size);
  }
  void swap(KeptFriction &other) noexcept
  {
    key.swap(other.key);
    force.swap(other.force);
  }
  void copy_from(const KeptFriction &other)
  {
    if (!other.key.backend()) return;
    if (!key.backend()) set_up(*other.key.backend());
    key.copy_from(other.key);
    force.copy_from(other.force);
  }
  void forget() noexcept
  {
    if (key.backend()) resize(0);
  }
};

/// Pairs that may touch, contacts and impacts.
struct ContactState {
  Contact settings;  // of the scene
  bool friction = false;  // some contact has friction
  double largest_thickness = 0;  // largest contact thickness of any vertex, m
  Stream<kernels::vertex_contact> vertex_contact;
  PairList vertex_face, edge_edge;
  int contacts = 0;
  Stream<kernels::contact> contact;
  Stream<dvec3> abrupt;  // [contacts] N s on side A, with BDF2: the part of the impulse that stopped motion abruptly
  // [contacts] N s on side A, with forces and several solves: by which the equation that the last solve has solved
  // differs from the forces of contacts at its solution; else empty
  Stream<dvec3> remainder;
  Stream<kernels::impact> impact;
  KeptFriction kept, kept_next;  // of the last step, of this one

  /// Removes all contacts and candidates.
  void forget() noexcept;

  template <class F> void visit(F &&f)
  {
    f("vertex_contact", Life::scene, vertex_contact);
    vertex_face.visit({"vertex_face.pairs", "vertex_face.direction", "vertex_face.gap_bound"}, f);
    edge_edge.visit({"edge_edge.pairs", "edge_edge.direction", "edge_edge.gap_bound"}, f);
    f("contacts", Life::step, contacts);
    f("contact", Life::step, contact);
    f("abrupt", Life::step, abrupt);
    f("remainder", Life::step, remainder);
    f("impact", Life::step, impact);
    f("kept.key", Life::step, kept.key);  // a checkpoint holds it by pairs
    f("kept.force", Life::step, kept.force);
    f("kept_next.key", Life::step, kept_next.key);
    f("kept_next.force", Life::step, kept_next.force);
  }
};

}  // namespace cama
