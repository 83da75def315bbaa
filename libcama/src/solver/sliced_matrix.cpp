// SPDX-License-Identifier: Apache-2.0
#include "solver/sliced_matrix.hpp"

namespace cama {

int key_bits(int rows)
{
  int bits = 31;
  for (; rows > 0; rows >>= 1) ++bits;
  return bits;
}

void RowOrder::number(const SolverRooms &state)
{
  Backend &b = *state.backend;
  const int vertices = state.mesh.cloth_vertices;
  Stream<int> flag(b, vertices), at(b, vertices + 1);
  place.resize(vertices);
  CAMA_LAUNCH(b, free_flags, vertices, state.mesh.fixed, flag);
  b.scan(flag.buffer(), at.buffer(), vertices);
  size = at.at(vertices);
  order.resize(size);
  CAMA_LAUNCH(b, number_free, vertices, flag, at, place, order);
}

void RowOrder::sort_by_length(Backend &b, const Stream<int> &row)
{
  Stream<key64> key(b, size);
  CAMA_LAUNCH(b, length_keys, size, order, row, key);
  b.sort(key.buffer(), order.buffer(), size, 12 + key_bits(size / ROW_WINDOW) - 31);
  CAMA_LAUNCH(b, invert_order, size, order, place);
}

template <class S>
template <class Real>
void SlicedMatrix<S>::make_pattern(const SolverRooms &state, const RowOrder &rows, const BlockMatrix<Real> &matrix)
{
  Backend &b = *state.backend;
  const int slices = ceil_divide(rows.size, SLICE_ROWS);
  Stream<key64> key(b, rows.size);
  row.resize(SLICE_ROWS * slices);
  row.fill_zero();
  place.resize(rows.size);
  CAMA_LAUNCH(b, place_keys, rows.size, rows.order, matrix.row, key, row);
  b.sort(key.buffer(), row.buffer(), rows.size, 12 + key_bits(rows.size / TEAM_ROWS) - 31);
  CAMA_LAUNCH(b, invert_order, rows.size, row, place);
  width_.resize(slices);
  start.resize(slices + 1);
  CAMA_LAUNCH(b, slice_widths, slices, rows.size, row, rows.order, matrix.row, matrix.column, state.mesh.cloth_vertices,
              rows.place, width_);
  b.scan(width_.buffer(), start.buffer(), slices);
  const long long entries = static_cast<long long>(SLICE_ROWS) * start.at(slices);
  column.resize(entries);
  source_.resize(entries);
  value.resize(9 * entries);
  CAMA_LAUNCH(b, fill_slices, SLICE_ROWS * slices, rows.size, row, rows.order, matrix.row, matrix.column,
              state.mesh.cloth_vertices, rows.place, start, column, source_);
}

template <class S>
template <class Real>
void SlicedMatrix<S>::fill(const SolverRooms &state, const RowOrder &rows, const BlockMatrix<Real> &matrix)
{
  Backend &b = *state.backend;
  const int terms = terms_beside(state);
  {
    const SideBySide side_by_side(b);
    CAMA_LAUNCH_REAL(S, b, fill_slice_values, source_.size(), source_, sizeof(Real) == 8 ? 1 : 0,
                     as<double, Real>(matrix.block), as<float, Real>(matrix.block), value);
    if (terms) {
      term_nodes.resize(terms);
      term_value.resize(9ll * terms);
      CAMA_LAUNCH_REAL(Real, b, pack_terms, terms, state.system.template of<Real>().term, state.mesh.cloth_vertices,
                       rows.place, sizeof(S) == 8 ? 1 : 0, term_nodes, as<double, S>(term_value),
                       as<float, S>(term_value));
    }
  }
  if (terms == 0) return;
  entry_weight.resize(state.system.term_incidence.entry.size());
  CAMA_LAUNCH_REAL(S, b, pack_weights, state.mesh.cloth_vertices, state.system.term_incidence.row,
                   state.system.term_incidence.entry, term_value, entry_weight);
}

template class SlicedMatrix<double>;
template class SlicedMatrix<float>;
#define CAMA_SLICED(S, Real)                                                                                           \
  template void SlicedMatrix<S>::make_pattern<Real>(const SolverRooms &, const RowOrder &, const BlockMatrix<Real> &); \
  template void SlicedMatrix<S>::fill<Real>(const SolverRooms &, const RowOrder &, const BlockMatrix<Real> &);
CAMA_SLICED(double, double)
CAMA_SLICED(double, float)
CAMA_SLICED(float, double)
CAMA_SLICED(float, float)
#undef CAMA_SLICED

}  // namespace cama
