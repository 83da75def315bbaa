// SPDX-License-Identifier: Apache-2.0
// A scene with every stage and stream, and the outcome of its run.
#pragma once
#include <algorithm>
#include <string>

#include "../meshes.hpp"
#include "../precision.hpp"
#include "cama/simulation.hpp"

namespace everything_scene {

inline cama::Options with(const std::string &precision, int threads, cama::Assembly assembly = cama::Assembly::gather,
                          const std::string &backend = "cpu")
{
  cama::Options o;
  o.backend = backend;
  o.precision = precision_of(precision);
  o.threads = threads;
  o.paper.assembly = assembly;
  o.forces = true;
  return o;
}

/// Sheets on a moving ball with a moving pin, a stitch, wind, a measured fabric that yields, and a balloon: every stage
/// and stream.
inline cama::Scene everything(int cells)
{
  cama::Scene s = meshes::pile(cells);
  s.cloths[0].material.stretching[3][0] *= 1.5;  // a measured table
  s.cloths[0].material.damping = 0.002;
  s.cloths[0].material.mass_damping = 0.5;
  s.cloths[0].material.yield_curvature = 5;
  s.cloths[0].material.hardening = 0.1;
  s.cloths.push_back(meshes::cloth(meshes::sphere(8, 6, 0.05, {0.4, 0, 0}), meshes::cotton(), "balloon"));
  s.cloths[2].gas = cama::Gas{2000, 0, 1e5};
  s.wind = cama::Wind{{1, 0.5, 0}, 1.2, 0.1};
  cama::Pin pin;
  pin.vertices = {0};
  pin.motion.velocity = {0, -0.2, 0.1};
  s.pins.push_back(pin);
  const int corner = (cells + 1) * (cells + 1) - 1;
  s.stitches.push_back({0, corner, 1, corner, corner - 1, 0.25, 50});
  return s;
}

/// Without plastic bending, which the paper's mode does not have.
inline cama::Scene elastic(cama::Scene s)
{
  s.cloths[0].material.yield_curvature = 0;
  return s;
}

struct Outcome {
  std::uint64_t hash;
  int contacts, impacts;
};

inline Outcome simulate(const cama::Scene &scene, const cama::Options &options, int steps)
{
  cama::Simulation simulation(scene, options);
  Outcome o{0, 0, 0};
  for (int i = 0; i < steps; ++i) {
    simulation.step();
    o.contacts = std::max(o.contacts, simulation.report().contacts);
    o.impacts = std::max(o.impacts, simulation.report().impacts);
  }
  o.hash = simulation.state_hash();
  return o;
}

}  // namespace everything_scene
