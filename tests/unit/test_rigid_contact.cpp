// SPDX-License-Identifier: Apache-2.0
// Contact of rigid bodies: what of a shape can touch, where two shapes meet, and the impulses there.
#include <cmath>

#include "../catch.hpp"
#include "../meshes.hpp"
#include "cama/generators.hpp"
#include "solver/contact_impulses.hpp"
#include "stages/meetings.hpp"

using namespace cama;
using namespace cama::kernels;

namespace {

PlacedShape placed(const ContactShape &shape, const dvec3 &from, const dvec3 &to)
{
  PlacedShape p(shape);
  for (const dvec3 &x : shape.rest) {
    p.start.push_back(dadd(x, from));
    p.end.push_back(dadd(x, to));
  }
  p.fit();
  return p;
}

std::size_t corners(const ContactShape &s)
{
  std::size_t count = 0;
  for (char corner : s.corner) count += corner != 0;
  return count;
}

}  // namespace

TEST_CASE("however finely a box is meshed, its eight corners and twelve edges touch first", "[rigid]")
{
  for (int triangles : {12, 300, 1200}) {
    const ContactShape box(meshes::obstacle(make_box({0.1, 0.2, 0.3}, triangles), {}, "box"));
    CHECK(box.radius == 0);
    CHECK(box.outward == 1);
    CHECK(corners(box) == 8);
    CHECK(box.edge.size() == 12);
    double length = 0;
    for (const auto &e : box.edge) length += dnorm(dsub(box.rest[std::size_t(e[1])], box.rest[std::size_t(e[0])]));
    CHECK(length == Approx(4 * 0.6));
  }
}

TEST_CASE("the mesh of a sphere is taken for the sphere, others are not", "[rigid]")
{
  for (int triangles : {180, 320, 2000}) {
    const ContactShape ball(meshes::obstacle(make_sphere(0.25, triangles), {}, "ball"));
    CHECK(ball.radius == Approx(0.25).epsilon(1e-12));
    CHECK(dnorm(ball.rest.at(0)) < 1e-12);
    CHECK(ball.face.size() == 1);
  }
  CHECK(ContactShape(meshes::obstacle(make_sphere(0.25, 80), {}, "coarse")).radius == 0);
  CHECK(ContactShape(meshes::obstacle(make_box({1, 1, 1}), {}, "cube")).radius == 0);
  Mesh dome = make_sphere(0.25, 320);
  dome.face.resize(160);
  CHECK(ContactShape(meshes::obstacle(dome, {}, "dome")).radius == 0);
  Mesh egg = make_sphere(0.25, 320);
  for (dvec3 &x : egg.position) x.z *= 1.01;
  CHECK(ContactShape(meshes::obstacle(egg, {}, "egg")).radius == 0);
}

TEST_CASE("a corner that comes from afar meets a face at the time of the closed form", "[rigid]")
{
  const ContactShape box(meshes::obstacle(make_box({0.1, 0.1, 0.1}), {}, "box")),
      plate(meshes::obstacle(make_box({1, 1, 0.02}, 400), {}, "plate"));
  const double gap = 1e-3, height = 0.3, drop = 0.5;
  const PlacedShape a = placed(box, {0.0317, 0.0223, height}, {0.0317, 0.0223, height - drop}),
                    b = placed(plate, {}, {});
  const MeetingSearch search(a, b, gap);
  // On its way the box would go through the plate: its lower corners through the upper face are the first of 16
  // meetings.
  const double time = (height - 0.06 - gap) / drop;
  int first = 0;
  for (const Meeting &m : search.meetings()) {
    CHECK(dnorm(dsub(m.normal, {0, 0, 1})) < 1e-12);
    CHECK(m.time > time - 0.1 * gap / drop);
    first += m.time < time + 0.2 * gap / drop;
  }
  CHECK(first == 4);
  CHECK(search.first_crossing().time == Approx((height - 0.06) / drop).margin(0.1 * gap / drop));
  CHECK(search.depth() == 0);
  // It passes beside the plate: no meeting, although it goes through its plane.
  const PlacedShape beside = placed(box, {0.56, 0, height}, {0.56, 0, height - drop});
  CHECK(MeetingSearch(beside, b, gap).meetings().empty());
  CHECK(MeetingSearch(beside, b, gap).first_crossing().time > 1);
  const PlacedShape sunk = placed(box, {0.03, 0.02, 0.055}, {0.03, 0.02, 0.055});
  CHECK(MeetingSearch(sunk, b, gap).depth() == Approx(0.005));
}

TEST_CASE("a blow off the centre gives the impulse of the closed form, and friction lies in its cone", "[rigid]")
{
  // A body of 2 kg with the moment 0.1 kg m^2 is struck at the lever 0.3 m: the mobility is 1/m + l^2/I.
  for (double friction : {0.0, 0.1, 10.0}) {
    std::vector<MovableBody> bodies{{0.5, {10, 10, 10, 0, 0, 0}, {}, {}}};
    ContactPoint p{};
    p.a = 0;
    p.b = -1;
    p.normal = {0, 0, 1};
    p.lever_a = {0.3, 0, 0};
    p.friction = p.static_friction = friction;
    p.approach = -3;
    p.slip = {0, 2, 0};
    std::vector<ContactPoint> points{p};
    solve_contacts(bodies, points, 1);
    const double normal = 3 / (0.5 + 0.09 * 10), tangent = 2 / (0.5 + 0.09 * 10);
    CHECK(points[0].press == Approx(normal).epsilon(1e-6));
    CHECK(points[0].rub.y == Approx(-std::min(tangent, friction * normal)).epsilon(1e-6).margin(1e-12));
    CHECK(dnorm(dsub(bodies[0].velocity, dscale(0.5, points[0].impulse()))) < 1e-12);
  }
}
