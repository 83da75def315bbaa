// SPDX-License-Identifier: Apache-2.0
#include "model/features.hpp"

#include <algorithm>

namespace cama {

bool has_wind(const Scene &scene) { return scene.wind && (scene.wind->density != 0 || scene.wind->drag != 0); }

bool has_damping(const Scene &scene)
{
  return std::any_of(scene.cloths.begin(), scene.cloths.end(), [](const Cloth &c) { return c.material.damping != 0; });
}

bool has_mass_damping(const Scene &scene)
{
  return std::any_of(scene.cloths.begin(), scene.cloths.end(),
                     [](const Cloth &c) { return c.material.mass_damping != 0; });
}

bool has_yield(const Scene &scene)
{
  return std::any_of(scene.cloths.begin(), scene.cloths.end(),
                     [](const Cloth &c) { return c.material.yield_curvature > 0; });
}

bool has_gas(const Scene &scene)
{
  return std::any_of(scene.cloths.begin(), scene.cloths.end(), [](const Cloth &c) { return c.gas.has_value(); });
}

bool has_strain_limit(const Scene &scene)
{
  return std::any_of(scene.cloths.begin(), scene.cloths.end(),
                     [](const Cloth &c) { return c.material.strain_limit > 0; });
}

bool has_friction(const Scene &scene)
{
  const std::size_t cloths = scene.cloths.size();
  for (std::size_t object = scene.contact.self ? 0 : cloths; object < cloths + scene.obstacles.size(); ++object) {
    const ContactProperties p = scene.contact_properties(object);
    if (p.friction > 0 || p.static_friction > 0) return true;
  }
  return false;
}

}  // namespace cama
