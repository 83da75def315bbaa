// SPDX-License-Identifier: Apache-2.0
#include "model/setup.hpp"

#include <algorithm>
#include <cstdio>

#include "model/setup_parts.hpp"

namespace cama {
namespace {

/// In single precision a vertex's mass is lost beside h^2 k, and with it the motion: from a ratio of 2e10 on, cloth was
/// seen to stretch. Throws MaterialError.
void refuse_stiffness_beyond_single(const State &state, const Scene &scene, const Topology &t)
{
  constexpr double largest = 8e9;
  const double step = std::max(state.time.step, state.time.longest);
  for (std::size_t c = 0; c < scene.cloths.size(); ++c) {
    const Material &material = scene.cloths[c].material;
    double stiffness = 0;
    for (const auto &row : material.stretching)
      stiffness = std::max(stiffness, *std::max_element(row.begin(), row.end()));
    const auto first = t.mass.begin() + t.cloth_range[c].first,
               lightest = std::min_element(first, t.mass.begin() + t.cloth_range[c].second);
    if (step * (step + material.damping) * stiffness <= largest * *lightest) continue;
    char text[160];
    std::snprintf(text, sizeof text,
                  "%.3g N/m with steps of %.3g s and vertex %d of %.3g kg is beyond single precision; use "
                  "precision mixed or double, or shorter steps",
                  stiffness, step, static_cast<int>(lightest - first), *lightest);
    throw MaterialError("cloth '" + scene.cloths[c].name + "': stiffness of " + text);
  }
}

std::vector<kernels::stitch> stitches_of(const Scene &scene, const Topology &t)
{
  std::vector<kernels::stitch> stitches;
  for (const Stitch &s : scene.stitches) {
    const int a = t.cloth_range[s.cloth_a].first, b = t.cloth_range[s.cloth_b].first;
    stitches.push_back({{a + s.vertex_a, b + s.vertex_b, b + s.vertex_c}, s.ratio, s.stiffness, s.length});
  }
  return stitches;
}

}  // namespace

template <class Real> void set_up(State &state, const Scene &scene, const Topology &t)
{
  Backend &b = *state.backend;
  System<Real> *s;
  if constexpr (sizeof(Real) == 8)
    s = (state.system.f64 = std::make_unique<System<double>>()).get();
  else
    s = (state.system.f32 = std::make_unique<System<float>>()).get();

  state.time.step = state.options.time_step;
  if (sizeof(Real) == 4) refuse_stiffness_beyond_single(state, scene, t);
  state.contact.settings = scene.contact;
  state.mesh.cloth_vertices = t.cloth_vertices;
  state.mesh.vertices = static_cast<int>(t.position.size());
  state.mesh.triangles = static_cast<int>(t.triangle.size());
  state.mesh.hinges = static_cast<int>(t.hinge.size());
  state.mesh.faces = static_cast<int>(t.face.size() + t.exact_face.size());
  state.mesh.edges = static_cast<int>(t.edge.size());

  state.mesh.object_name = t.object_name;
  for (const auto &range : t.cloth_range) {
    state.mesh.object_first.push_back(range.first);
    state.mesh.object_static.push_back(0);
  }
  for (std::size_t o = 0; o < scene.obstacles.size(); ++o) {
    state.mesh.object_first.push_back(t.obstacle_range[o].first);
    state.mesh.object_static.push_back(scene.obstacles[o].is_static());
    if (scene.obstacles[o].rigid)
      state.rigid.body.emplace_back(static_cast<int>(state.rigid.body.size()), static_cast<int>(o),
                                    t.obstacle_range[o].first, scene.obstacles[o]);
  }
  if (!state.rigid.body.empty()) {
    std::vector<int> rigid(t.position.size(), 0);
    for (const RigidBody &body : state.rigid.body) std::fill(rigid.begin() + body.first, rigid.begin() + body.last, 1);
    state.rigid.vertex = Stream<int>(b, rigid);
  }
  std::vector<int> fixed(t.position.size(), 0);
  std::fill(fixed.begin() + t.cloth_vertices, fixed.end(), 1);
  for (const Pin &pin : scene.pins)
    for (int v : pin.vertices) fixed[t.cloth_range[pin.cloth].first + v] = 1;
  std::vector<double> inverse_mass(t.position.size(), 0.0);
  std::vector<Real> mass;
  std::vector<dvec3> velocity(t.position.size(), dvec3{0, 0, 0});
  for (int v = 0; v < t.cloth_vertices; ++v) {
    mass.push_back(static_cast<Real>(t.mass[v]));
    if (fixed[v]) continue;
    inverse_mass[v] = 1 / t.mass[v];
    velocity[v] = scene.cloths[t.object[v]].velocity;
  }
  for (const RigidBody &body : state.rigid.body) {
    const dvec3 spin = body.angular_velocity(body.rotation, body.angular_momentum);
    for (int v = body.first; v < body.last; ++v)
      velocity[v] = kernels::dadd(body.velocity, kernels::dcross(spin, kernels::dsub(t.position[v], body.center)));
  }
  state.mesh.position = Stream<dvec3>(b, t.position);
  state.mesh.velocity = Stream<dvec3>(b, velocity);
  state.mesh.position_next = Stream<dvec3>(b, t.position);
  state.mesh.velocity_next = Stream<dvec3>(b, velocity);
  if (state.options.integrator == Integrator::bdf2) {
    state.time.predicted = true;
    state.mesh.position_before = Stream<dvec3>(b, t.position);
    state.mesh.velocity_before = Stream<dvec3>(b, velocity);
    state.mesh.position_base = Stream<dvec3>(b, t.position);
    state.mesh.velocity_base = Stream<dvec3>(b, velocity);
  }
  state.mesh.fixed = Stream<int>(b, fixed);
  state.elements.gravity = Stream<dvec3>(b, std::vector<dvec3>{scene.gravity});
  if (has_wind(scene)) {
    std::vector<double> density;
    for (const Cloth &c : scene.cloths) density.push_back(c.material.density);
    state.elements.areal_density = Stream<double>(b, density);
    if (state.time.predicted || state.options.newton_iterations > 1)
      s->drag = Stream<typename Types<Real>::mat3>(b, t.cloth_vertices);
  }
  if (has_mass_damping(scene)) {
    std::vector<Real> rate;
    for (int v = 0; v < t.cloth_vertices; ++v)
      rate.push_back(static_cast<Real>(scene.cloths[t.object[v]].material.mass_damping * t.mass[v]));
    s->mass_damping = Stream<Real>(b, rate);
    s->drag = Stream<typename Types<Real>::mat3>(b, t.cloth_vertices);
  }
  if (has_wind(scene) || has_mass_damping(scene))
    state.elements.wind = Stream<dvec3>(b, std::vector<dvec3>{scene.wind ? scene.wind->velocity : dvec3{0, 0, 0}});
  if (std::any_of(scene.cloths.begin(), scene.cloths.end(), [](const Cloth &c) { return c.pressure != 0; })) {
    std::vector<double> pressure;
    for (const Cloth &c : scene.cloths) pressure.push_back(c.pressure);
    state.elements.pressure = Stream<double>(b, pressure);
  }
  if (std::any_of(scene.obstacles.begin(), scene.obstacles.end(),
                  [](const Obstacle &o) { return !o.is_static() && o.motion.is_rigid(); }))
    state.mesh.rest_position = Stream<dvec3>(b, t.rest_position);

  if (state.options.forces)
    state.reactions.set_up(b, state.mesh.vertices, state.mesh.cloth_vertices, state.time.predicted);

  s->mass = Stream<Real>(b, mass);
  set_up_materials(state, *s, scene);
  set_up_elements(state, *s, scene, t);
  if (has_gas(scene)) set_up_gas(state, *s, scene, t);
  s->force = Stream<typename Types<Real>::vec3>(b, t.cloth_vertices);
  s->matrix = {Stream<int>(b), Stream<int>(b), Stream<typename Types<Real>::mat3>(b)};
  s->right_side = Stream<typename Types<Real>::vec3>(b, t.cloth_vertices);
  s->solution = Stream<typename Types<Real>::vec3>(b, state.mesh.vertices);

  const std::vector<kernels::stitch> stitches = stitches_of(scene, t);
  state.elements.stitches = static_cast<int>(stitches.size());
  if (scene.has_contact()) {
    set_up_contact(state, scene, t, inverse_mass);
    if (state.time.predicted) {
      s->start_force = Stream<typename Types<Real>::vec3>(b, t.cloth_vertices);
      state.mesh.abrupt_change = Stream<dvec3>(b);
      state.contact.abrupt = Stream<dvec3>(b);
    }
    if (state.options.forces && state.options.newton_iterations > 1) state.contact.remainder = Stream<dvec3>(b);
    const bool remembers =
        state.options.newton_iterations > 1 || state.options.paper.contact_form == ContactForm::rank_one;
    if (state.contact.friction && remembers) {
      s->hold = Stream<typename Types<Real>::vec3>(b);
      state.contact.kept.set_up(b);
      state.contact.kept_next.set_up(b);
    }
  }
  if (state.elements.stitches) state.elements.stitch = Stream<kernels::stitch>(b, stitches);
  if (scene.has_contact() || state.elements.stitches) {
    s->term = Stream<typename Types<Real>::term>(b);
    state.system.term_nodes = Stream<kernels::element_nodes>(b);
    if (state.options.paper.contact_form == ContactForm::star) state.system.term_split = Stream<int>(b);
    state.system.term_incidence.reset(b, t.cloth_vertices);
  }
}

template void set_up<double>(State &, const Scene &, const Topology &);
template void set_up<float>(State &, const Scene &, const Topology &);

}  // namespace cama
