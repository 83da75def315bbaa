// SPDX-License-Identifier: Apache-2.0
#include "stages/bending.hpp"

#include "device/launch.hpp"

namespace cama {
namespace {

constexpr int few_hinges = 65536;  // for which a launch costs more than the moments of neighbours that it finds again

/// Moments for the scaled angles; they begin with the first share of them in s.moment, and end there. rates: those for
/// the rates as well.
template <class Real> void find_moments(Backend &b, System<Real> &s, int hinges, bool rates)
{
  const int cloths = s.moment_step.size() / (s.moment_iterations + 1);
  const bool in_pairs = !b.wide_workers() && hinges < few_hinges;
  Stream<Real> none, *rate = rates ? &s.scaled_rate : &none, *moment = rates ? &s.rate_moment : &none,
                     *before = rates ? &s.rate_moment_before : &none;
  if (in_pairs)
    for (int k = 0; k < (rates ? 4 : 2); ++k) s.moment_next[k].resize(hinges);
  for (int k = 0; k < s.moment_iterations;) {
    const int row = (k + 1) * cloths, first = k == 0 ? 1 : 0;
    if (in_pairs && k + 1 < s.moment_iterations) {
      auto &[next, next_before, rate_next, rate_next_before] = s.moment_next;
      CAMA_LAUNCH_REAL(Real, b, improve_moments_twice, hinges, s.hinge_coupling, s.scaled_angle, s.moment_step, row,
                       cloths, first, s.moment, s.moment_before, next, next_before, *rate, *moment, *before,
                       rates ? rate_next : none, rates ? rate_next_before : none);
      s.moment.swap(next);
      s.moment_before.swap(next_before);
      if (rates) {
        moment->swap(rate_next);
        before->swap(rate_next_before);
      }
      k += 2;
    } else {
      CAMA_LAUNCH_REAL(Real, b, improve_moments, hinges, s.hinge_coupling, s.scaled_angle, s.moment_step, row, first,
                       s.moment, s.moment_before, *rate, *moment, *before);
      s.moment.swap(s.moment_before);
      moment->swap(*before);
      ++k;
    }
  }
}

template <class Real> void scale_angles(Backend &b, System<Real> &s, int hinges, const Stream<dvec3> &position)
{
  CAMA_LAUNCH_REAL(Real, b, scale_angles, hinges, s.hinge_rest, s.hinge_coupling, s.bending_table, s.material_scale,
                   s.moment_step, position, s.hinge_factor, s.angle_scale, s.scaled_angle, s.moment);
}

}  // namespace

template <class Real> void find_plate_moments(Backend &b, System<Real> &s, int hinges, const Stream<dvec3> &position)
{
  scale_angles(b, s, hinges, position);
  find_moments(b, s, hinges, false);
}

template <class Real>
void find_angles(Backend &b, const Options &options, System<Real> &s, int hinges, const Stream<dvec3> &position)
{
  if (s.hinge_coupling.size() > 0)
    scale_angles(b, s, hinges, position);
  else
    CAMA_LAUNCH_REAL(Real, b, evaluate_hinges, hinges, s.hinge_rest, s.bending_table, s.material_scale,
                     options.arcsim_conventions ? 1 : 0, position, s.hinge_factor, s.hinge_force);
}

template <class Real> void find_rates(Backend &b, System<Real> &s, int hinges, const Damping<Real> &damping)
{
  if (s.hinge_coupling.size() > 0)
    CAMA_LAUNCH_REAL(Real, b, measure_rates, hinges, s.hinge_rest, s.hinge_factor, s.material_scale, damping.step,
                     s.moment_step, damping.velocity, s.angle_scale, s.scaled_rate, s.rate_moment);
  else
    CAMA_LAUNCH_REAL(Real, b, damp_hinges, hinges, s.hinge_rest, s.hinge_factor, s.material_scale, damping.step,
                     damping.velocity, damping.onto ? 1 : 0, damping.hinge_force);
}

template <class Real> void bend(Backend &b, System<Real> &s, int hinges, const Damping<Real> *damping)
{
  if (s.hinge_coupling.size() == 0) return;
  find_moments(b, s, hinges, damping != nullptr);
  Stream<Real> none;
  Stream<typename Types<Real>::vec3> nowhere;
  CAMA_LAUNCH_REAL(Real, b, bend_hinges, 4 * hinges, s.hinge_factor, s.angle_scale, s.moment,
                   damping ? s.rate_moment : none, s.hinge_force,
                   damping && !damping->onto ? damping->hinge_force : nowhere);
}

template <class Real>
void measure_bending(Backend &b, const Options &options, System<Real> &s, int hinges, const Stream<dvec3> &position,
                     Stream<double> &energy)
{
  if (s.hinge_coupling.size() == 0) {
    CAMA_LAUNCH_REAL(Real, b, measure_hinges, hinges, s.hinge_rest, s.bending_table, options.arcsim_conventions ? 1 : 0,
                     position, energy);
    return;
  }
  CAMA_LAUNCH_REAL(Real, b, measure_angles, hinges, s.hinge_rest, s.hinge_coupling, s.bending_table, s.moment_step,
                   position, s.scaled_angle, s.moment);
  find_moments(b, s, hinges, false);
  CAMA_LAUNCH_REAL(Real, b, measure_bending, hinges, s.scaled_angle, s.moment, energy);
}

#define CAMA_BENDING(Real)                                                                              \
  template void find_plate_moments(Backend &, System<Real> &, int, const Stream<dvec3> &);              \
  template void find_angles(Backend &, const Options &, System<Real> &, int, const Stream<dvec3> &);    \
  template void find_rates(Backend &, System<Real> &, int, const Damping<Real> &);                      \
  template void bend(Backend &, System<Real> &, int, const Damping<Real> *);                            \
  template void measure_bending(Backend &, const Options &, System<Real> &, int, const Stream<dvec3> &, \
                                Stream<double> &);
CAMA_BENDING(double)
CAMA_BENDING(float)
#undef CAMA_BENDING

}  // namespace cama
