// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <type_traits>

#include "device/ceil_divide.hpp"
#include "device/launch.hpp"
#include "model/access.hpp"

namespace cama {

/// The rooms of the state that the linear solvers access.
using SolverRooms = Access<const Options, const StepReport, const Clock, const MeshState, SystemState>;

/// Number of terms that act beside the matrix; other kinds of assembly add them to the matrix, with a new pattern every
/// step.
inline int terms_beside(const SolverRooms &state)
{
  return state.options.paper.assembly == Assembly::gather ? state.system.terms : 0;
}

/// Parts of vertices that enclosed gas adds to the product with the matrix.
inline int gas_parts(const SolverRooms &state) { return state.system.gas.vertex_part.size(); }

/// A stream in the precision of the forces as an argument of type Number, or null if its numbers have the other type.
template <class Number, class Real, class T> Components<Number> as(const Stream<T> &stream)
{
  if constexpr (std::is_same_v<Number, Real>)
    return components<Number>(stream);
  else
    return nothing<Number>();
}

/// Bits of keys with rows up to `rows`.
int key_bits(int rows);

/// The rows of a linear system: free vertices, in some order.
struct RowOrder {
  explicit RowOrder(Backend &b) : order(b), place(b) {}
  /// Orders free vertices by number.
  void number(const SolverRooms &state);
  /// Sorts rows by length within windows, which keeps slices full. row: of the matrix.
  void sort_by_length(Backend &backend, const Stream<int> &row);

  int size = 0;
  Stream<int> order;  // [size] vertex
  Stream<int> place;  // [cloth vertices] row; -1: fixed
};

/// The matrix on these rows, in slices of SLICE_ROWS so that neighbours read neighbours (sliced ELLPACK), and the terms
/// beside it.
template <class S> class SlicedMatrix {
public:
  explicit SlicedMatrix(Backend &b)
      : start(b), row(b), place(b), column(b), value(b), term_nodes(b), term_value(b), entry_weight(b), width_(b),
        source_(b)
  {}
  template <class Real>
  void make_pattern(const SolverRooms &state, const RowOrder &rows, const BlockMatrix<Real> &matrix);
  template <class Real> void fill(const SolverRooms &state, const RowOrder &rows, const BlockMatrix<Real> &matrix);

  Stream<int> start;  // [slices + 1] first entry of a lane
  Stream<int> row, place;  // row of each place in the slices [SLICE_ROWS slices], place of each row [rows]
  Stream<int> column;
  Stream<S> value;
  Stream<kernels::element_nodes> term_nodes;  // [terms] rows
  Stream<S> term_value;  // [9 terms]
  Stream<S> entry_weight;  // weights of the entries of the terms' incidence lists

private:
  Stream<int> width_, source_;
};

}  // namespace cama
