// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "run/pipeline.hpp"

namespace cama {

/// The matrix of Equation 1 in BCSR: by gathering into the static elastic pattern (terms remain rank-one operators), by
/// the paper's Algorithm 1, or by collecting, sorting and reducing all entries.
template <class Real>
class AssembleMatrix final
    : public StageOn<const Options, const MeshState, const ElementState, const ContactState, SystemState> {
public:
  explicit AssembleMatrix(Backend &backend);
  std::string_view name() const override { return "matrix assembly"; }
  void run_on(const Rooms &state) override;
  /// Whether it neither reads contacts and stitches nor waits for the device.
  bool independent(const Options &options) const
  {
    return pattern_ready_ && options.paper.assembly == Assembly::gather &&
           options.paper.contact_form != ContactForm::star;
  }

private:
  void fill(const Rooms &state);
  void find_pattern(const Rooms &state, bool with_terms);  ///< finds also the sources of every block
  void scatter(const Rooms &state);
  void sorted(const Rooms &state);

  bool pattern_ready_ = false;
  const Stream<int> all_couple_;  // empty: all nodes of a triangle, or of a hinge, couple
  Stream<int> count_, space_, cursor_;
  Stream<key64> index_;
  Stream<int> source_start_, source_;  // sources of every block
  Stream<key64> key_;
  Stream<int> entry_, head_, place_;
};

extern template class AssembleMatrix<double>;
extern template class AssembleMatrix<float>;

}  // namespace cama
