// SPDX-License-Identifier: Apache-2.0
#include "solver/contact_impulses.hpp"

#include <algorithm>
#include <cmath>

#include "device/kernels.hpp"

namespace cama {
namespace {

using namespace kernels;

constexpr int max_sweeps = 500;  // in either direction
constexpr double tolerance = 1e-7;  // of the speed that does not matter
constexpr int max_changes = 4;  // of which contacts slide, where friction differs between sticking and sliding
constexpr double at_rest = 1e-3;  // of that speed: what sticks is not faster

dvec3 product(const SymmetricMatrix &m, const dvec3 &v)
{
  return {m[0] * v.x + m[3] * v.y + m[5] * v.z, m[3] * v.x + m[1] * v.y + m[4] * v.z,
          m[5] * v.x + m[4] * v.y + m[2] * v.z};
}

/// A contact point with what stays the same in all sweeps.
class Row {
public:
  Row(std::vector<MovableBody> &bodies, ContactPoint &point)
      : point_(point), a_(point.a < 0 ? nullptr : &bodies[static_cast<std::size_t>(point.a)]),
        b_(point.b < 0 ? nullptr : &bodies[static_cast<std::size_t>(point.b)]), along_(any_perpendicular(point.normal)),
        across_(dcross(point.normal, along_))
  {
    press_ = 1 / mobility(point.normal, point.normal);
    const double x = mobility(along_, along_), y = mobility(across_, across_), xy = mobility(along_, across_);
    rub_ = 1 / (0.5 * (x + y) + std::sqrt(0.25 * (x - y) * (x - y) + xy * xy));  // of the softest direction
    push(point.impulse());
  }

  /// Returns the change of velocity at the point that it made, m/s.
  double sweep()
  {
    ContactPoint &p = point_;
    const double before = p.press;
    p.press = std::max(0.0, before - press_ * (ddot(p.normal, velocity()) + p.approach));
    const double pressed = p.press - before;
    if (pressed != 0) push(dscale(pressed, p.normal));
    double change = std::abs(pressed) / press_;
    if (!(p.friction > 0) && !(p.static_friction > 0)) return change;
    const dvec3 slip = tangential(), old = p.rub;
    p.rub = daxpy(old, -rub_, slip);
    const double most = (p.slides ? p.friction : p.static_friction) * p.press, size = dnorm(p.rub);
    if (size > most) p.rub = dscale(most / size, p.rub);
    const dvec3 rubbed = dsub(p.rub, old);
    push(rubbed);
    return std::max(change, dnorm(rubbed) / rub_);
  }

  bool breaks_away(double slow) const
  {
    return !point_.slides && point_.press > 0 && point_.static_friction > point_.friction &&
           dnorm(tangential()) > at_rest * slow;
  }

private:
  dvec3 velocity() const
  {
    dvec3 v{0, 0, 0};
    if (a_) v = dadd(a_->velocity, dcross(a_->spin, point_.lever_a));
    if (b_) v = dsub(v, dadd(b_->velocity, dcross(b_->spin, point_.lever_b)));
    return v;
  }
  dvec3 tangential() const
  {
    const dvec3 v = dadd(velocity(), point_.slip);
    return daxpy(v, -ddot(v, point_.normal), point_.normal);
  }
  double mobility(const dvec3 &u, const dvec3 &v) const
  {
    double sum = 0;
    const auto add = [&](const MovableBody *body, const dvec3 &lever) {
      if (body)
        sum +=
            body->inverse_mass * ddot(u, v) + ddot(dcross(lever, u), product(body->inverse_inertia, dcross(lever, v)));
    };
    add(a_, point_.lever_a);
    add(b_, point_.lever_b);
    return sum;
  }
  void push(const dvec3 &impulse)
  {
    if (a_) {
      a_->velocity = daxpy(a_->velocity, a_->inverse_mass, impulse);
      a_->spin = dadd(a_->spin, product(a_->inverse_inertia, dcross(point_.lever_a, impulse)));
    }
    if (b_) {
      b_->velocity = daxpy(b_->velocity, -b_->inverse_mass, impulse);
      b_->spin = dsub(b_->spin, product(b_->inverse_inertia, dcross(point_.lever_b, impulse)));
    }
  }

  ContactPoint &point_;
  MovableBody *a_, *b_;
  dvec3 along_, across_;
  double press_, rub_;
};

}  // namespace

dvec3 ContactPoint::impulse() const { return daxpy(rub, press, normal); }

void solve_contacts(std::vector<MovableBody> &bodies, std::vector<ContactPoint> &points, double slow)
{
  for (MovableBody &body : bodies) body.velocity = body.spin = {0, 0, 0};
  std::vector<Row> rows;
  rows.reserve(points.size());
  for (ContactPoint &p : points) rows.emplace_back(bodies, p);
  for (int change = 0; change <= max_changes; ++change) {
    for (int i = 0; i < max_sweeps; ++i) {
      double changed = 0;
      for (Row &row : rows) changed = std::max(changed, row.sweep());
      for (std::size_t k = rows.size(); k-- > 0;) changed = std::max(changed, rows[k].sweep());
      if (!(changed > tolerance * slow)) break;
    }
    bool again = false;
    for (std::size_t k = 0; k < rows.size(); ++k)
      if (rows[k].breaks_away(slow)) again = points[k].slides = true;
    if (!again) break;
  }
}

}  // namespace cama
