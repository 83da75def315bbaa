// SPDX-License-Identifier: Apache-2.0
#include "model/system_state.hpp"

#include <type_traits>

namespace cama {

void SystemState::scale_materials(double h, const std::vector<double> &damping)
{
  if (h == scaled_step) return;
  const auto scale = [&](auto &system) {
    using Real = typename std::decay_t<decltype(system.material_scale)>::value_type;
    std::vector<Real> values;
    for (double c : damping) values.push_back(static_cast<Real>(h * (h + c)));
    system.material_scale.assign(values);
  };
  if (f64)
    scale(*f64);
  else
    scale(*f32);
  scaled_step = h;
}

std::vector<double> SystemState::masses() const
{
  if (f64) return f64->mass.download();
  const std::vector<float> single = f32->mass.download();
  return {single.begin(), single.end()};
}

}  // namespace cama
