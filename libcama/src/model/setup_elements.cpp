// SPDX-License-Identifier: Apache-2.0
#include "model/setup_parts.hpp"

#include <algorithm>

#include "model/features.hpp"

namespace cama {

template <class Real> void set_up_materials(State &state, System<Real> &s, const Scene &scene)
{
  Backend &b = *state.backend;
  using T = Types<Real>;
  std::vector<typename T::stretching_stiffness> table;
  std::vector<typename T::bending_stiffness> bending;
  std::vector<int> start;
  std::vector<Real> scale;
  const auto push = [&](const std::array<double, 4> &row) {
    typename T::stretching_stiffness k;
    for (int m = 0; m < 4; ++m) k.k[m] = static_cast<Real>(row[m]);
    table.push_back(k);
  };
  for (std::size_t c = 0; c < scene.cloths.size(); ++c) {
    const Material &material = scene.cloths[c].material;
    std::size_t same = 0;
    while (same < c && scene.cloths[same].material.stretching != material.stretching) ++same;
    if (same < c) {
      start.push_back(start[same]);
    } else if (material.has_table()) {
      start.push_back(static_cast<int>(table.size()));
      for (const auto &row : stretching_table(material)) push(row);
    } else {
      start.push_back(-1 - static_cast<int>(table.size()));
      push(material.stretching[0]);
    }
    typename T::bending_stiffness k;
    for (int m = 0; m < 15; ++m) k.k[m] = static_cast<Real>(material.bending[m / 5][m % 5]);
    bending.push_back(k);
    scale.push_back(static_cast<Real>(state.time.step * (state.time.step + material.damping)));
    state.elements.damping.push_back(material.damping);
  }
  state.time.implicit_step = state.system.scaled_step = state.time.step;
  s.stretching_table = Stream<typename T::stretching_stiffness>(b, table);
  if (has_strain_limit(scene)) {
    std::vector<typename T::strain_limit> limit;
    for (const Cloth &c : scene.cloths) {
      const double stretch = 1 + c.material.strain_limit;
      limit.push_back(
          {static_cast<Real>((stretch * stretch - 1) / 2), static_cast<Real>(c.material.limit_stiffening - 1)});
    }
    s.strain_limit = Stream<typename T::strain_limit>(b, limit);
  }
  s.stretching_start = Stream<int>(b, start);
  if (state.mesh.hinges > 0) s.bending_table = Stream<typename T::bending_stiffness>(b, bending);
  s.material_scale = Stream<Real>(b, scale);
}

template <class Real> void set_up_elements(State &state, System<Real> &s, const Scene &scene, const Topology &t)
{
  using T = Types<Real>;
  Backend &b = *state.backend;
  std::vector<typename T::triangle_rest> triangles;
  std::vector<typename T::hinge_rest> hinges;
  std::vector<kernels::element_nodes> triangle_nodes, hinge_nodes;
  for (const RestTriangle &r : t.triangle) {
    typename T::triangle_rest e{};
    std::copy(r.node.begin(), r.node.end(), e.node);
    e.material = r.material;
    for (int k = 0; k < 4; ++k) e.d[k] = static_cast<Real>(r.d[k]);
    e.area = static_cast<Real>(r.area);
    triangles.push_back(e);
    triangle_nodes.push_back({{r.node[0], r.node[1], r.node[2], -1}});
  }
  for (const RestHinge &r : t.hinge) {
    typename T::hinge_rest e{};
    std::copy(r.node.begin(), r.node.end(), e.node);
    e.material = r.material;
    e.rest_angle = static_cast<Real>(r.rest_angle);
    e.length = static_cast<Real>(r.length);
    e.area = static_cast<Real>(r.area);
    for (int k = 0; k < 2; ++k) e.direction[k] = static_cast<Real>(r.direction[k]);
    hinges.push_back(e);
    hinge_nodes.push_back({{r.node[0], r.node[1], r.node[2], r.node[3]}});
  }
  const auto incidence = [&](Incidence &list, const Stream<kernels::element_nodes> &nodes, int n) {
    Stream<int> count(b, state.mesh.cloth_vertices);
    list.reset(b, state.mesh.cloth_vertices);
    list.build(b, nodes, n, count);
  };
  s.triangle_rest = Stream<typename T::triangle_rest>(b, triangles);
  s.triangle_factor = Stream<typename T::triangle_factor>(b, state.mesh.triangles);
  s.triangle_force = Stream<typename T::vec3>(b, 3 * state.mesh.triangles);
  state.elements.triangle_nodes = Stream<kernels::element_nodes>(b, triangle_nodes);
  incidence(state.elements.triangle_incidence, state.elements.triangle_nodes, state.mesh.triangles);
  if (state.mesh.hinges == 0) return;
  s.hinge_rest = Stream<typename T::hinge_rest>(b, hinges);
  s.hinge_factor = Stream<typename T::hinge_factor>(b, state.mesh.hinges);
  s.hinge_force = Stream<typename T::vec3>(b, 4 * state.mesh.hinges);
  if (state.options.bending == Bending::plate && !state.options.arcsim_conventions) set_up_plate(state, s, scene, t);
  state.elements.hinge_nodes = Stream<kernels::element_nodes>(b, hinge_nodes);
  incidence(state.elements.hinge_incidence, state.elements.hinge_nodes, state.mesh.hinges);
}

template void set_up_materials<double>(State &, System<double> &, const Scene &);
template void set_up_materials<float>(State &, System<float> &, const Scene &);
template void set_up_elements<double>(State &, System<double> &, const Scene &, const Topology &);
template void set_up_elements<float>(State &, System<float> &, const Scene &, const Topology &);

}  // namespace cama
