// SPDX-License-Identifier: Apache-2.0
// Two engines in lock step: before each leaf stage the candidate gets every stream of the reference, both run it, and
// every stream that State::visit names must be the same, bit for bit. Added stages are covered without a new test.
#pragma once
#include <cstring>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

#include "../catch.hpp"
#include "../engine.hpp"

namespace lockstep {

#if CAMA_FAST_MATH
inline constexpr bool strict = false;
#else
inline constexpr bool strict = true;
#endif

/// False, and counted as skipped, if products and sums may be contracted: only strict builds guarantee equal bits.
inline bool strict_build()
{
  if (!strict) {
    ++skipped;
    WARN("SKIPPED: built with CAMA_FAST_MATH, bits differ between backends and machines");
  }
  return strict;
}

/// Calls f on every number of a value, so that padding between members does not count.
template <class F> void each(key64 v, F &&f) { f(v); }
template <class F> void each(int v, F &&f) { f(v); }
template <class F> void each(float v, F &&f) { f(v); }
template <class F> void each(double v, F &&f) { f(v); }
template <class F, class T, std::size_t n> void each(const T (&array)[n], F &&f)
{
  for (const T &v : array) each(v, f);
}
template <class F, class... T> void each_of(F &&f, const T &...member) { (each(member, f), ...); }

template <class F> void each(const cama::dvec3 &v, F &&f) { each_of(f, v.x, v.y, v.z); }
#define LOCKSTEP_REAL(space)                                                                                           \
  template <class F> void each(const cama::kernels::space::vec3 &v, F &&f) { each_of(f, v.x, v.y, v.z); }              \
  template <class F> void each(const cama::kernels::space::mat3 &m, F &&f)                                             \
  {                                                                                                                    \
    each_of(f, m.row[0], m.row[1], m.row[2]);                                                                          \
  }                                                                                                                    \
  template <class F> void each(const cama::kernels::space::stretching_stiffness &k, F &&f) { each(k.k, f); }           \
  template <class F> void each(const cama::kernels::space::moment_step &s, F &&f) { each_of(f, s.momentum, s.share); } \
  template <class F> void each(const cama::kernels::space::strain_limit &l, F &&f) { each_of(f, l.strain, l.factor); } \
  template <class F> void each(const cama::kernels::space::bending_stiffness &k, F &&f) { each(k.k, f); }              \
  template <class F> void each(const cama::kernels::space::triangle_rest &r, F &&f)                                    \
  {                                                                                                                    \
    each_of(f, r.node, r.material, r.d, r.area);                                                                       \
  }                                                                                                                    \
  template <class F> void each(const cama::kernels::space::triangle_factor &t, F &&f)                                  \
  {                                                                                                                    \
    each_of(f, t.u, t.w, t.d, t.k, t.e0, t.e1);                                                                        \
  }                                                                                                                    \
  template <class F> void each(const cama::kernels::space::hinge_rest &r, F &&f)                                       \
  {                                                                                                                    \
    each_of(f, r.node, r.material, r.rest_angle, r.length, r.area, r.direction);                                       \
  }                                                                                                                    \
  template <class F> void each(const cama::kernels::space::hinge_coupling &c, F &&f)                                   \
  {                                                                                                                    \
    each_of(f, c.neighbour, c.cloth, c.coupling, c.scale, c.bound, c.reference);                                       \
  }                                                                                                                    \
  template <class F> void each(const cama::kernels::space::plastic_material &m, F &&f)                                 \
  {                                                                                                                    \
    each_of(f, m.yield_curvature, m.hardening);                                                                        \
  }                                                                                                                    \
  template <class F> void each(const cama::kernels::space::plastic_triangle &t, F &&f)                                 \
  {                                                                                                                    \
    each_of(f, t.material, t.hinge, t.curvature);                                                                      \
  }                                                                                                                    \
  template <class F> void each(const cama::kernels::space::plastic_hinge &h, F &&f)                                    \
  {                                                                                                                    \
    each_of(f, h.triangle, h.rest_angle, h.angle);                                                                     \
  }                                                                                                                    \
  template <class F> void each(const cama::kernels::space::hinge_factor &h, F &&f)                                     \
  {                                                                                                                    \
    each_of(f, h.gradient[0], h.gradient[1], h.gradient[2], h.gradient[3], h.coefficient);                             \
  }                                                                                                                    \
  template <class F> void each(const cama::kernels::space::term &t, F &&f)                                             \
  {                                                                                                                    \
    each_of(f, t.node, t.weight, t.normal, t.along, t.around, t.push);                                                 \
  }
LOCKSTEP_REAL(f64)
LOCKSTEP_REAL(f32)
#undef LOCKSTEP_REAL
template <class F> void each(const cama::kernels::element_nodes &e, F &&f) { each(e.node, f); }
template <class F> void each(const cama::kernels::gas_part &p, F &&f) { each_of(f, p.gas, p.first, p.end); }
template <class F> void each(const cama::kernels::gas_state &s, F &&f)
{
  each_of(f, s.volume, s.pressure, s.stiffness);
}
template <class F> void each(const cama::kernels::gas &g, F &&f)
{
  each_of(f, g.cloth, g.first_vertex, g.triangle_part, g.triangle_parts, g.vertex_part, g.vertex_parts, g.amount,
          g.ambient, g.least_volume);
}
template <class F> void each(const cama::kernels::face_nodes &e, F &&f) { each(e.node, f); }
template <class F> void each(const cama::kernels::edge_nodes &e, F &&f) { each(e.node, f); }
template <class F> void each(const cama::kernels::fvec3 &v, F &&f) { each_of(f, v.x, v.y, v.z); }
template <class F> void each(const cama::kernels::face_features &e, F &&f) { each_of(f, e.edge, e.owned); }
template <class F> void each(const cama::kernels::stitch &s, F &&f) { each_of(f, s.node, s.ratio, s.stiffness); }
template <class F> void each(const cama::kernels::vertex_contact &v, F &&f)
{
  each_of(f, v.thickness, v.area, v.stiffness, v.friction, v.static_friction, v.radius, v.obstacle, v.shape);
}
template <class F> void each(const cama::kernels::box &b, F &&f) { each_of(f, b.lo, b.hi); }
template <class F> void each(const cama::kernels::bvh8_node &g, F &&f) { each_of(f, g.lo, g.hi); }
template <class F> void each(const cama::kernels::pair &p, F &&f) { each_of(f, p.a, p.b); }
template <class F> void each(const cama::kernels::contact &c, F &&f)
{
  each_of(f, c.node, c.kind, c.candidate, c.weight, c.normal, c.distance, c.thickness, c.stiffness, c.friction,
          c.static_friction);
}
template <class F> void each(const cama::kernels::impact &m, F &&f)
{
  each_of(f, m.node, m.kind, m.candidate, m.repeated, m.weight, m.normal, m.target);
}

/// The numbers of a value as words: equal words are equal bits; every NaN is the same word, since its payload is not
/// defined.
template <class T> std::vector<std::uint64_t> words(const T &value)
{
  std::vector<std::uint64_t> result;
  each(value, [&](auto number) {
    std::uint64_t word = 0;
    if (number != number)
      word = ~std::uint64_t(0);
    else
      std::memcpy(&word, &number, sizeof number);
    result.push_back(word);
  });
  return result;
}

struct Difference {
  std::string stream;
  int index;
  std::string what;
};

/// used: how many values of a stream that has room for more than there are, or -1.
template <class T>
std::optional<Difference> compare(const std::string &name, const cama::Stream<T> &a, const cama::Stream<T> &b,
                                  int used = -1)
{
  if ((a.backend() == nullptr) != (b.backend() == nullptr)) return Difference{name, 0, "present on one side only"};
  if (!a.backend()) return std::nullopt;
  if (a.size() != b.size())
    return Difference{name, 0, "sizes " + std::to_string(a.size()) + " and " + std::to_string(b.size())};
  std::vector<T> x = a.download(), y = b.download();
  if (used >= 0) {
    x.resize(static_cast<std::size_t>(used));
    y.resize(static_cast<std::size_t>(used));
  }
  if (!x.empty() && std::memcmp(x.data(), y.data(), x.size() * sizeof(T)) == 0) return std::nullopt;
  for (std::size_t i = 0; i < x.size(); ++i)
    if (words(x[i]) != words(y[i])) return Difference{name, static_cast<int>(i), "values differ"};
  return std::nullopt;
}

/// Compares a number that stages pass to each other.
template <class T> std::optional<Difference> compare(const std::string &name, const T &a, const T &b)
{
  if (words(static_cast<double>(a)) == words(static_cast<double>(b))) return std::nullopt;
  return Difference{name, 0, std::to_string(a) + " and " + std::to_string(b)};
}

/// Calls f(name, value of a, value of b) for every stream and number of two states of one scene.
template <class F> void for_each_value(cama::State &a, cama::State &b, F &&f)
{
  std::vector<void *> values;
  a.visit([&](const char *, cama::Life, auto &value) { values.push_back(&value); });
  std::size_t next = 0;
  b.visit([&](const char *name, cama::Life, auto &value) {
    using T = std::decay_t<decltype(value)>;
    f(std::string(name), *static_cast<T *>(values.at(next++)), value);
  });
}

/// Copies all data that lives longer than a stage from one backend to another.
inline void copy(cama::State &from, cama::State &to)
{
  for_each_value(from, to, [](const std::string &, auto &source, auto &target) {
    using T = std::decay_t<decltype(source)>;
    if constexpr (!cama::IsStream<T>::value)
      target = source;
    else if (source.backend() && target.backend())
      target.assign(source.download());
    else if (source.backend())
      target = {*target.backend(), source.download()};
  });
  to.report = from.report;
}

/// The first difference between two states.
inline std::optional<Difference> first_difference(cama::State &a, cama::State &b)
{
  std::optional<Difference> first;
  for_each_value(a, b, [&](const std::string &name, auto &x, auto &y) {
    if (first) return;
    if constexpr (cama::IsStream<std::decay_t<decltype(x)>>::value) {
      const cama::Incidence &terms = a.system.term_incidence;
      const bool room = name == "term_incidence.entry" && x.backend();
      first = compare(name, x, y, !room ? -1 : a.system.terms > 0 ? terms.row.at(terms.vertices) : 0);
    } else {
      first = compare(name, x, y);
    }
  });
  return first;
}

/// Called after a stage has run on the candidate, to plant an error.
using Tamper = std::function<void(int step, const std::string &stage, cama::State &candidate)>;

/// Runs both through `steps` steps. For every stage of every step that differs, the first difference: "step 3, stage
/// linear solve, stream solution, index 12: values differ". Stages start from the reference's state, so that one
/// difference does not cause the next. At most `most` differences.
inline std::vector<std::string> differences(StagedEngine &reference, StagedEngine &candidate, int steps,
                                            const Tamper &tamper = {}, std::size_t most = 1000)
{
  if (reference.leaves().size() != candidate.leaves().size()) return {"the pipelines have different stages"};
  std::vector<std::string> found;
  for (int step = 1; step <= steps; ++step) {
    reference.begin_step();
    candidate.begin_step();
    for (std::size_t k = 0; k < reference.leaves().size() && found.size() < most; ++k) {
      const std::string stage(reference.leaves()[k]->name());
      copy(reference.state, candidate.state);
      reference.leaves()[k]->run(reference.state);
      candidate.leaves()[k]->run(candidate.state);
      if (tamper) tamper(step, stage, candidate.state);
      if (const auto d = first_difference(reference.state, candidate.state))
        found.push_back("step " + std::to_string(reference.state.report.step) + ", stage " + stage + ", stream " +
                        d->stream + ", index " + std::to_string(d->index) + ": " + d->what);
    }
    if (found.size() >= most) break;
    reference.end_step();
    candidate.end_step();
  }
  return found;
}

/// The first difference, or an empty text.
inline std::string run(StagedEngine &reference, StagedEngine &candidate, int steps, const Tamper &tamper = {})
{
  const std::vector<std::string> found = differences(reference, candidate, steps, tamper, 1);
  return found.empty() ? "" : found.front();
}

}  // namespace lockstep
