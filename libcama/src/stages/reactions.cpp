// SPDX-License-Identifier: Apache-2.0
#include "stages/reactions.hpp"

#include "device/launch.hpp"
#include "stages/linear_solve.hpp"

namespace cama {

template <class Real> void SolveReactions<Real>::measure(const Rooms &state, Impulses &impulses)
{
  Backend &b = *state.backend;
  System<Real> &s = state.system.template of<Real>();
  const int vertices = state.mesh.vertices, rows = state.mesh.cloth_vertices, terms = state.system.terms,
            form = static_cast<int>(state.options.paper.contact_form),
            newton = state.options.newton_iterations > 1 ? 1 : 0,
            in_matrix = state.options.paper.assembly == Assembly::gather ? 0 : 1;
  count_.resize(vertices);
  terms_.reset(b, vertices);
  terms_.rebuild(b, state.system.term_nodes, terms, count_);
  if (!newton && state.system.gas.gas.size() > 0)  // the force after the solve, as the matrix has that of the elements
    multiply_gas<Real>(b, state.system, s.solution, -1 / state.time.implicit_step, Stream<int>(), s.force);
  CAMA_LAUNCH_REAL(Real, b, solve_reactions, vertices, rows, state.contact.contacts, newton, in_matrix, form,
                   static_cast<Real>(state.time.implicit_step), terms_.row, terms_.entry, s.term, s.hold, s.matrix.row,
                   s.matrix.column, s.matrix.block, s.mass, s.force, state.mesh.fixed,
                   state.mesh.base_velocity(state.time), state.mesh.velocity_next, s.solution, state.mesh.position,
                   state.contact.vertex_contact, impulses.linear, impulses.angular);
  if (state.contact.contacts && state.contact.remainder.size())
    CAMA_LAUNCH_REAL(Real, b, add_abrupt_reactions, vertices, rows, state.contact.contacts, 1.0, terms_.row,
                     terms_.entry, s.term, state.contact.remainder, state.mesh.fixed, state.mesh.position,
                     state.contact.vertex_contact, impulses.linear, impulses.angular);
}

template <class Real> void SolveReactions<Real>::run_on(const Rooms &state)
{
  Backend &b = *state.backend;
  const System<Real> &s = state.system.template of<Real>();
  ReactionState &r = state.reactions;
  const int vertices = state.mesh.vertices, rows = state.mesh.cloth_vertices,
            form = static_cast<int>(state.options.paper.contact_form),
            newton = state.options.newton_iterations > 1 ? 1 : 0;
  measure(state, r.piece);
  r.contact.resize(state.contact.contacts);
  r.contact_time = state.time.implicit_step;
  // The contact's impulses are those of a force over the implicit step, in which the time step is longer.
  const int stopped = state.mesh.abrupt_change.size() > 0 ? 1 : 0;
  const double share = state.time.implicit_step / state.time.step;
  CAMA_LAUNCH_REAL(Real, b, contact_impulses, state.contact.contacts, newton, form, stopped, share * share, s.term,
                   s.hold, state.contact.abrupt, state.mesh.velocity_next, s.solution, r.contact);
  if (state.contact.contacts && state.contact.remainder.size())
    CAMA_LAUNCH(b, add_impulses, state.contact.contacts, 1.0, state.contact.remainder, r.contact);
  r.carry_on(state.time.memory);
  b.copy(r.solved_velocity.buffer(), state.mesh.velocity_next.buffer(), r.solved_velocity.bytes());
  if (!stopped) return;
  CAMA_LAUNCH_REAL(Real, b, add_abrupt_reactions, vertices, rows, state.contact.contacts, share, terms_.row,
                   terms_.entry, s.term, state.contact.abrupt, state.mesh.fixed, state.mesh.position,
                   state.contact.vertex_contact, r.piece.linear, r.piece.angular);
  CAMA_LAUNCH(b, add_impulses, rows, share - 1, state.mesh.abrupt_change, r.solved_velocity);
}

template class SolveReactions<double>;
template class SolveReactions<float>;

void ImpactReactions::add_remainders(const Rooms &state)
{
  Backend &b = *state.backend;
  const MeshState &mesh = state.mesh;
  Impulses &piece = state.reactions.piece;
  const int rows = mesh.cloth_vertices;
  const PairList *lists[2] = {&state.contact.vertex_face, &state.contact.edge_edge};
  CAMA_LAUNCH(b, add_pushes, mesh.vertices, state.time.step, mesh.fixed, state.reactions.push.linear,
              state.reactions.push.angular, piece.linear, piece.angular);
  remainder_.resize(rows);
  nearest_.resize(rows);
  surface_.resize(rows);
  nodes_.resize(rows);
  count_.resize(mesh.vertices);
  CAMA_LAUNCH(b, momentum_remainders, rows, state.time.step, mesh.fixed, mesh.inverse_mass,
              state.reactions.solved_velocity, mesh.velocity, state.reactions.push.linear, remainder_, nearest_,
              surface_);
  for (int kind = 0; kind < 2; ++kind)
    CAMA_LAUNCH(b, nearest_partners, lists[kind]->pairs.size(), kind, rows, lists[kind]->pairs, mesh.face, mesh.edge,
                mesh.position, state.contact.vertex_contact, remainder_, nearest_);
  for (int kind = 0; kind < 2; ++kind)
    CAMA_LAUNCH(b, nearest_surfaces, lists[kind]->pairs.size(), kind, rows, lists[kind]->pairs, mesh.face, mesh.edge,
                mesh.position, state.contact.vertex_contact, remainder_, nearest_, surface_);
  CAMA_LAUNCH(b, remainder_nodes, rows, mesh.vertices, surface_, nodes_);
  takers_.reset(b, mesh.vertices);
  takers_.build(b, nodes_, rows, count_);
  CAMA_LAUNCH(b, add_remainders, mesh.vertices, takers_.row, takers_.entry, remainder_, mesh.position, piece.linear,
              piece.angular);
}

void ImpactReactions::run_on(const Rooms &state)
{
  if (state.report.impact_passes > 0 || state.report.truncated > 0) add_remainders(state);
  const MeshState &mesh = state.mesh;
  if (mesh.abrupt_change.size() > 0)  // FinishStep has swapped velocity and velocity_next
    CAMA_LAUNCH(*state.backend, add_forgotten, mesh.cloth_vertices, state.time.implicit_step / state.time.step,
                mesh.fixed, mesh.inverse_mass, mesh.position, mesh.velocity_next, state.reactions.solved_velocity,
                mesh.velocity, mesh.velocity_before, mesh.abrupt_change, state.reactions.smooth_next.linear,
                state.reactions.smooth_next.angular);
  state.reactions.accept_piece();
}

}  // namespace cama
