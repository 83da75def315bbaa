// SPDX-License-Identifier: Apache-2.0
#include "run/measurements.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "device/launch.hpp"
#include "stages/bending.hpp"
#include "stages/element_forces.hpp"
#include "stages/plastic_bending.hpp"

namespace cama {
namespace {

double sum(const std::vector<double> &values)
{
  double total = 0;
  for (double v : values) total += v;
  return total;
}

struct TriangleMeasure {
  double energy, strain;
};

template <class Real> TriangleMeasure measure_triangles(State &s)
{
  Stream<double> energy(*s.backend, s.mesh.triangles), strain(*s.backend, s.mesh.triangles);
  System<Real> &y = s.system.of<Real>();
  CAMA_LAUNCH_REAL(Real, *s.backend, measure_triangles, s.mesh.triangles, y.triangle_rest, y.stretching_table,
                   y.stretching_start, s.mesh.position, energy, strain);
  if (y.strain_limit.size())
    CAMA_LAUNCH_REAL(Real, *s.backend, measure_limits, s.mesh.triangles, y.triangle_rest, y.stretching_table,
                     y.stretching_start, y.strain_limit, s.mesh.position, energy);
  const std::vector<double> strains = strain.download();
  return {sum(energy.download()), *std::max_element(strains.begin(), strains.end())};
}

template <class Real> double measure_hinges(State &s)
{
  if (s.mesh.hinges == 0) return 0;
  Stream<double> energy(*s.backend, s.mesh.hinges);
  if (s.elements.plastic_curvature.size() > 0)
    set_rest_angles(*s.backend, s.system.of<Real>(), s.elements.plastic_curvature);
  measure_bending(*s.backend, s.options, s.system.of<Real>(), s.mesh.hinges, s.mesh.position, energy);
  return sum(energy.download());
}

/// The work that gas does while it expands at constant temperature from this volume to `end`, against the pressure
/// outside.
double expansion_work(const kernels::gas &g, double volume, double end)
{
  const double filled = std::max(volume, g.least_volume), lacking = filled - volume;  // on the tangent below
  const double absolute = g.amount / filled;
  return g.amount * std::log(end / filled) - g.ambient * (end - volume) +
         lacking * (absolute + 0.5 * lacking * absolute / filled);
}

double gas_energy(State &s)
{
  EnclosedGas &gas = s.system.gas;
  if (gas.gas.size() == 0) return 0;
  find_gas(*s.backend, gas, s.elements.triangle_nodes, s.mesh.position, s.time.step);
  const auto gases = gas.gas.download();
  const auto state = gas.state.download();
  double total = 0;
  for (std::size_t i = 0; i < gases.size(); ++i)
    total += expansion_work(gases[i], state[i].volume, gases[i].ambient > 0 ? gases[i].amount / gases[i].ambient : 1);
  return total;
}

template <class Real> Energy measure(State &s)
{
  Stream<double> mass(*s.backend, s.system.masses()), kinetic(*s.backend, s.mesh.cloth_vertices),
      potential(*s.backend, s.mesh.cloth_vertices);
  CAMA_LAUNCH(*s.backend, measure_vertices, s.mesh.cloth_vertices, mass, s.mesh.position, s.mesh.velocity,
              s.elements.gravity, kinetic, potential);
  Energy e;
  e.kinetic = sum(kinetic.download());
  e.gravity = sum(potential.download());
  e.stretching = measure_triangles<Real>(s).energy;
  e.bending = measure_hinges<Real>(s);
  e.gas = gas_energy(s);
  return e;
}

bool is_single(const State &s) { return s.system.f32 != nullptr; }

}  // namespace

Energy measure_energy(State &s) { return is_single(s) ? measure<float>(s) : measure<double>(s); }

std::vector<GasState> measure_gas(State &s)
{
  std::vector<GasState> result;
  EnclosedGas &gas = s.system.gas;
  if (gas.gas.size() == 0) return result;
  find_gas(*s.backend, gas, s.elements.triangle_nodes, s.mesh.position, s.time.step);
  const auto gases = gas.gas.download();
  const auto state = gas.state.download();
  for (std::size_t i = 0; i < gases.size(); ++i)
    result.push_back({gases[i].cloth, state[i].volume, state[i].pressure, gases[i].amount, gases[i].ambient});
  return result;
}

double measure_strain(State &s)
{
  return is_single(s) ? measure_triangles<float>(s).strain : measure_triangles<double>(s).strain;
}

double measure_gap(State &s)
{
  double smallest = std::numeric_limits<double>::infinity();
  const PairList *lists[2] = {&s.contact.vertex_face, &s.contact.edge_edge};
  for (int kind = 0; kind < 2; ++kind) {
    const int n = lists[kind]->pairs.size();
    if (n == 0) continue;
    Stream<double> distance(*s.backend, n);
    CAMA_LAUNCH(*s.backend, measure_pairs, n, kind, lists[kind]->pairs, s.mesh.face, s.mesh.edge, s.mesh.position,
                s.contact.vertex_contact, distance);
    for (double d : distance.download()) smallest = std::min(smallest, d);
  }
  return smallest;
}

}  // namespace cama
