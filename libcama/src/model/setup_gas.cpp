// SPDX-License-Identifier: Apache-2.0
#include "model/setup_parts.hpp"

#include <algorithm>

namespace cama {

template <class Real> void set_up_gas(State &state, System<Real> &s, const Scene &scene, const Topology &t)
{
  constexpr int part_size = 8 * GAS_TEAM;
  constexpr double least_share = 1e-3;  // of the volume that the pressure is given at
  Backend &b = *state.backend;
  EnclosedGas &room = state.system.gas;
  std::vector<kernels::gas> gases;
  std::vector<kernels::gas_part> triangle_part, vertex_part;
  std::vector<int> gas_of(static_cast<std::size_t>(t.cloth_vertices), -1);
  const auto divide = [&](int first, int end, std::vector<kernels::gas_part> &parts, int &at, int &count) {
    at = static_cast<int>(parts.size());
    for (; first < end; first += part_size)
      parts.push_back({static_cast<int>(gases.size()), first, std::min(end, first + part_size)});
    count = static_cast<int>(parts.size()) - at;
  };
  int triangle = 0;
  for (std::size_t c = 0; c < scene.cloths.size(); ++c) {
    const Cloth &cloth = scene.cloths[c];
    const int first_triangle = triangle;
    triangle += static_cast<int>(cloth.mesh.face.size());
    if (!cloth.gas) continue;
    const auto [first, end] = t.cloth_range[c];
    const double volume = cloth.gas->volume > 0 ? cloth.gas->volume : cloth.enclosed_volume();
    kernels::gas g{};
    g.cloth = static_cast<int>(c);
    g.first_vertex = first;
    divide(first_triangle, triangle, triangle_part, g.triangle_part, g.triangle_parts);
    divide(first, end, vertex_part, g.vertex_part, g.vertex_parts);
    g.amount = (cloth.gas->ambient + cloth.gas->pressure) * volume;
    g.ambient = cloth.gas->ambient;
    g.least_volume = least_share * volume;
    std::fill(gas_of.begin() + first, gas_of.begin() + end, static_cast<int>(gases.size()));
    gases.push_back(g);
  }
  room.gas = Stream<kernels::gas>(b, gases);
  room.triangle_part = Stream<kernels::gas_part>(b, triangle_part);
  room.vertex_part = Stream<kernels::gas_part>(b, vertex_part);
  room.volume = Stream<double>(b, static_cast<int>(triangle_part.size()));
  room.product = Stream<double>(b, static_cast<int>(vertex_part.size()));
  room.state = Stream<kernels::gas_state>(b, static_cast<int>(gases.size()));
  room.gas_of = Stream<int>(b, gas_of);
  s.gas_gradient = Stream<typename Types<Real>::vec3>(b, t.cloth_vertices);
}

template void set_up_gas<double>(State &, System<double> &, const Scene &, const Topology &);
template void set_up_gas<float>(State &, System<float> &, const Scene &, const Topology &);

}  // namespace cama
