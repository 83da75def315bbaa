// SPDX-License-Identifier: Apache-2.0
#include "stages/matrix_assembly.hpp"

#include "cama/error.hpp"
#include "device/launch.hpp"

namespace cama {

static_assert(static_cast<int>(ContactForm::rank_one) == FORM_RANK_ONE &&
              static_cast<int>(ContactForm::star) == FORM_STAR);

template <class Real>
AssembleMatrix<Real>::AssembleMatrix(Backend &b)
    : count_(b), space_(b), cursor_(b), index_(b), source_start_(b), source_(b), key_(b), entry_(b), head_(b), place_(b)
{}

template <class Real> void AssembleMatrix<Real>::find_pattern(const Rooms &state, bool with_terms)
{
  Backend &b = *state.backend;
  BlockMatrix<Real> &m = state.system.template of<Real>().matrix;
  const int rows = state.mesh.cloth_vertices, terms = with_terms ? state.system.terms : 0;
  if (16 * (static_cast<long long>(state.mesh.triangles) + state.mesh.hinges + terms) >
      0x7fffffff)  // each element has 16 numbers of sources
    throw MemoryError("the matrix: more than 2^27 triangles, hinges and contacts; lower the resolution");
  count_.resize(rows);
  space_.resize(rows + 1);
  cursor_.resize(rows);
  m.row.resize(rows + 1);
  // Space counting, lines 2-5. Every row starts with its diagonal.
  CAMA_LAUNCH(b, set_int, rows, 0, 1, count_);
  const auto count = [&](int n, const Stream<kernels::element_nodes> &nodes, const Stream<int> &split) {
    CAMA_LAUNCH(b, count_entries, n, nodes, split, rows, count_);
  };
  count(state.mesh.triangles, state.elements.triangle_nodes, all_couple_);
  count(state.mesh.hinges, state.elements.hinge_nodes, all_couple_);
  count(terms, state.system.term_nodes, state.system.term_split);
  b.scan(count_.buffer(), space_.buffer(), rows);
  index_.resize(space_.at(rows));
  source_.resize(index_.size());
  // Filling indices, lines 7-9.
  CAMA_LAUNCH(b, fill_diagonal, rows, space_, cursor_, index_);
  const auto fill = [&](int n, int first, const Stream<kernels::element_nodes> &nodes, const Stream<int> &split) {
    CAMA_LAUNCH(b, fill_entries, n, first, nodes, split, rows, space_, cursor_, index_);
  };
  fill(state.mesh.triangles, 0, state.elements.triangle_nodes, all_couple_);
  fill(state.mesh.hinges, state.mesh.triangles, state.elements.hinge_nodes, all_couple_);
  fill(terms, state.mesh.triangles + state.mesh.hinges, state.system.term_nodes, state.system.term_split);
  // Removing duplications, lines 11-13; data reduction, lines 15-16.
  if (b.wide_workers())
    CAMA_LAUNCH(b, sort_indices, rows, space_, index_);
  else
    CAMA_LAUNCH_TEAMS(void, b, sort_indices_by_teams, SORT_TEAM, rows, space_, index_);
  CAMA_LAUNCH(b, count_columns, rows, space_, index_, count_);
  b.scan(count_.buffer(), m.row.buffer(), rows);
  m.column.resize(m.row.at(rows));
  source_start_.resize(m.column.size() + 1);
  CAMA_LAUNCH(b, list_columns, rows, space_, index_, m.row, m.column, source_start_, source_);
  m.block.resize(m.column.size());
}

template <class Real> void AssembleMatrix<Real>::scatter(const Rooms &state)
{
  Backend &b = *state.backend;
  System<Real> &s = state.system.template of<Real>();
  BlockMatrix<Real> &m = s.matrix;
  const int rows = state.mesh.cloth_vertices;
  CAMA_LAUNCH_REAL(Real, b, set_mass_rows, rows, m.row, m.column, s.mass, m.block);
  CAMA_LAUNCH_REAL(Real, b, scatter_triangles, state.mesh.triangles, state.elements.triangle_nodes, s.triangle_factor,
                   rows, m.row, m.column, m.block);
  CAMA_LAUNCH_REAL(Real, b, scatter_hinges, state.mesh.hinges, state.elements.hinge_nodes, s.hinge_factor, rows, m.row,
                   m.column, m.block);
  CAMA_LAUNCH_REAL(Real, b, scatter_terms, state.system.terms, state.system.term_nodes, state.system.term_split, s.term,
                   static_cast<int>(state.options.paper.contact_form), rows, m.row, m.column, m.block);
}

template <class Real> void AssembleMatrix<Real>::sorted(const Rooms &state)
{
  Backend &b = *state.backend;
  System<Real> &s = state.system.template of<Real>();
  BlockMatrix<Real> &m = s.matrix;
  const int rows = state.mesh.cloth_vertices, elements = state.mesh.triangles + state.mesh.hinges + state.system.terms;
  key_.resize(16ll * elements + rows);
  const int n = key_.size();
  entry_.resize(n);
  head_.resize(n);
  place_.resize(n + 1);
  const auto collect = [&](int count, const Stream<kernels::element_nodes> &nodes, const Stream<int> &split,
                           int first) {
    CAMA_LAUNCH_REAL(Real, b, collect_entries, count, nodes, split, rows, first, key_, entry_);
  };
  collect(state.mesh.triangles, state.elements.triangle_nodes, all_couple_, 0);
  collect(state.mesh.hinges, state.elements.hinge_nodes, all_couple_, state.mesh.triangles);
  collect(state.system.terms, state.system.term_nodes, state.system.term_split,
          state.mesh.triangles + state.mesh.hinges);
  CAMA_LAUNCH_REAL(Real, b, collect_diagonal, rows, 16 * elements, key_, entry_);
  b.sort(key_.buffer(), entry_.buffer(), n, 62);
  CAMA_LAUNCH_REAL(Real, b, mark_heads, n, key_, rows, head_);
  b.scan(head_.buffer(), place_.buffer(), n);
  const int total = place_.at(n);
  m.row.resize(rows + 1);
  m.column.resize(total);
  m.block.resize(total);
  CAMA_LAUNCH_REAL(Real, b, reduce_sorted, n, key_, entry_, place_, total, rows, s.mass, state.mesh.triangles,
                   s.triangle_factor, state.mesh.hinges, s.hinge_factor, s.term,
                   static_cast<int>(state.options.paper.contact_form), m.row, m.column, m.block);
}

template <class Real> void AssembleMatrix<Real>::fill(const Rooms &state)
{
  const Options &options = state.options;
  if (options.paper.contact_form == ContactForm::star && state.system.terms) {
    // Sides of terms: the star couples across sides only; vertex-face terms split after one node, edge-edge terms after
    // two.
    state.system.term_split.resize(state.system.terms);
    CAMA_LAUNCH(*state.backend, set_int, state.elements.stitches, state.contact.contacts, 0, state.system.term_split);
    CAMA_LAUNCH(*state.backend, contact_splits, state.contact.contacts, state.contact.contact, state.system.term_split);
  }
  if (options.paper.assembly == Assembly::sorted) {
    sorted(state);
  } else if (options.paper.assembly == Assembly::algorithm1) {
    find_pattern(state, true);
    if (options.paper.atomic_filling) return scatter(state);
    System<Real> &s = state.system.template of<Real>();
    CAMA_LAUNCH_REAL(Real, *state.backend, gather_blocks_and_terms, s.matrix.block.size(), source_start_, source_,
                     s.mass, state.mesh.triangles, s.triangle_factor, state.mesh.hinges, s.hinge_factor, s.term,
                     static_cast<int>(options.paper.contact_form), s.matrix.block);
  } else {
    System<Real> &s = state.system.template of<Real>();
    if (!pattern_ready_) {
      find_pattern(state, false);
      for (Stream<int> *list : {&count_, &space_, &cursor_}) *list = Stream<int>(*state.backend);
      index_ = Stream<key64>(*state.backend);
      pattern_ready_ = true;
    }
    CAMA_LAUNCH_REAL(Real, *state.backend, gather_blocks, s.matrix.block.size(), source_start_, source_, s.mass,
                     state.mesh.triangles, s.triangle_factor, s.hinge_factor, s.matrix.block);
  }
}

template <class Real> void AssembleMatrix<Real>::run_on(const Rooms &state)
{
  fill(state);
  System<Real> &s = state.system.template of<Real>();
  if (s.drag.size())
    CAMA_LAUNCH_REAL(Real, *state.backend, add_to_diagonal, state.mesh.cloth_vertices, s.matrix.row, s.matrix.column,
                     s.drag, s.matrix.block);
}

template class AssembleMatrix<double>;
template class AssembleMatrix<float>;

}  // namespace cama
