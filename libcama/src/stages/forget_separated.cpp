// SPDX-License-Identifier: Apache-2.0
#include "stages/forget_separated.hpp"

namespace cama {
void ForgetSeparated::run_on(const Rooms &state)
{
  if (state.exemptions.temporary() == 0) return;
  if (face_.empty()) {
    std::vector<Triangle> faces;
    for (const kernels::face_nodes &f : state.mesh.face.download()) faces.push_back({f.node[0], f.node[1], f.node[2]});
    face_.swap(faces);
  }
  if (state.exemptions.forget_separated(state.mesh.position.download(), face_, state.mesh.cloth_vertices))
    state.exemptions.upload();
  state.report.exempt = state.exemptions.temporary();
}

}  // namespace cama
