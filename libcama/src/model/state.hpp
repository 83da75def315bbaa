// SPDX-License-Identifier: Apache-2.0
// All data that lives longer than a stage, in rooms. Names of streams follow the paper's Figure 4;
// docs/developer/architecture.md has the table. A stage declares the rooms that it accesses (access.hpp) and cannot
// access others.
#pragma once
#include <type_traits>

#include "cama/options.hpp"
#include "cama/report.hpp"
#include "model/clock.hpp"
#include "model/contact_state.hpp"
#include "model/element_state.hpp"
#include "model/exemptions.hpp"
#include "model/mesh_state.hpp"
#include "model/reaction_state.hpp"
#include "model/rigid_body.hpp"
#include "model/search_state.hpp"
#include "model/system_state.hpp"

namespace cama {

template <class T> struct IsStream : std::false_type {};
template <class T> struct IsStream<Stream<T>> : std::true_type {};

struct State {
  explicit State(Backend &device) : backend(&device) {}

  Backend *backend;
  bool wait_for_stages = false;  // wait after every stage, so that stage times measure work
  Options options;
  StepReport report;
  Clock time;
  MeshState mesh;
  ElementState elements;
  ContactState contact;
  Exemptions exemptions;
  BoundsState bounds;
  TreeState *trees = nullptr;  // owned by the search by trees; null with fronts
  FrontState *fronts = nullptr;  // owned by the search by fronts; null with trees
  SystemState system;
  ReactionState reactions;
  RigidState rigid;

  /// Calls f(name, life, value) for every stream, and for every number that stages pass to each other.
  template <class F> void visit(F &&f)
  {
    time.visit(f);
    mesh.visit(f);
    elements.visit(f);
    contact.visit(f);
    exemptions.visit(Life::scene, f);
    bounds.visit(f);
    if (trees) trees->visit(f);
    if (fronts) fronts->visit(f);
    system.visit(f);
    reactions.visit(f);
    rigid.visit(f);
  }
  /// Calls f(name, stream) for every stream.
  template <class F> void visit_streams(F &&f)
  {
    visit([&](const char *name, Life, auto &value) {
      if constexpr (IsStream<std::decay_t<decltype(value)>>::value) f(name, value);
    });
  }
};

}  // namespace cama
