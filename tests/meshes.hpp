// SPDX-License-Identifier: Apache-2.0
// Small meshes and scenes that the tests build for themselves.
#pragma once
#include <cmath>
#include <string>
#include <vector>

#include "cama/scene.hpp"

namespace meshes {

using cama::dvec3;

/// (columns + 1)(rows + 1) vertices in the plane z, cells split along alternating diagonals; corner at (x, y).
inline cama::Mesh grid(int columns, int rows, double width, double height, double x = 0, double y = 0, double z = 0)
{
  cama::Mesh m;
  for (int j = 0; j <= rows; ++j)
    for (int i = 0; i <= columns; ++i) m.position.push_back({x + width * i / columns, y + height * j / rows, z});
  for (int j = 0; j < rows; ++j)
    for (int i = 0; i < columns; ++i) {
      const int a = j * (columns + 1) + i, b = a + 1, c = a + columns + 1, d = c + 1;
      if ((i + j) % 2) {
        m.face.push_back({a, b, c});
        m.face.push_back({b, d, c});
      } else {
        m.face.push_back({a, b, d});
        m.face.push_back({a, d, c});
      }
    }
  return m;
}

/// Longitudes and latitudes; 2 poles + (rings - 1) * sectors vertices.
inline cama::Mesh sphere(int sectors, int rings, double radius, dvec3 center = {0, 0, 0})
{
  const double pi = 3.14159265358979323846;
  cama::Mesh m;
  m.position.push_back({center.x, center.y, center.z + radius});
  for (int j = 1; j < rings; ++j)
    for (int i = 0; i < sectors; ++i) {
      const double a = pi * j / rings, b = 2 * pi * i / sectors;
      m.position.push_back({center.x + radius * std::sin(a) * std::cos(b),
                            center.y + radius * std::sin(a) * std::sin(b), center.z + radius * std::cos(a)});
    }
  m.position.push_back({center.x, center.y, center.z - radius});
  const int last = static_cast<int>(m.position.size()) - 1;
  const auto at = [=](int j, int i) { return 1 + (j - 1) * sectors + i % sectors; };
  for (int i = 0; i < sectors; ++i) {
    m.face.push_back({0, at(1, i), at(1, i + 1)});
    m.face.push_back({last, at(rings - 1, i + 1), at(rings - 1, i)});
    for (int j = 1; j + 1 < rings; ++j) {
      m.face.push_back({at(j, i), at(j + 1, i), at(j + 1, i + 1)});
      m.face.push_back({at(j, i), at(j + 1, i + 1), at(j, i + 1)});
    }
  }
  return m;
}

/// `pages` triangles on one edge: non-manifold from three on.
inline cama::Mesh book(int pages, double size)
{
  cama::Mesh m;
  m.position = {{0, 0, 0}, {0, size, 0}};
  for (int p = 0; p < pages; ++p) {
    const double angle = 2.5 * p / pages;
    m.position.push_back({size * std::cos(angle), 0.4 * size, size * std::sin(angle)});
    m.face.push_back({0, 1, 2 + p});
  }
  return m;
}

inline cama::Material cotton() { return cama::Material::isotropic(200, 0.3, 2e-5, 0.15); }

inline cama::Cloth cloth(cama::Mesh mesh, cama::Material material = cotton(), const std::string &name = "cloth")
{
  cama::Cloth c;
  c.name = name;
  c.mesh = std::move(mesh);
  c.material = std::move(material);
  return c;
}

inline cama::Obstacle obstacle(cama::Mesh mesh, cama::Motion motion = {}, const std::string &name = "obstacle")
{
  cama::Obstacle o;
  o.name = name;
  o.mesh = std::move(mesh);
  o.motion = std::move(motion);
  return o;
}

/// A square sheet of 0.4 m that hangs by two corners, without contact.
inline cama::Scene hanging(int cells)
{
  cama::Scene s;
  s.time_step = 1.0 / 200;
  s.contact.enabled = false;
  s.cloths.push_back(cloth(grid(cells, cells, 0.4, 0.4)));
  cama::Pin pin;
  pin.vertices = {0, cells};
  s.pins.push_back(pin);
  return s;
}

/// A sheet on a ball: in contact with it, moving, wrinkling.
inline cama::Scene sheet_on_ball()
{
  cama::Scene s;
  s.time_step = 1.0 / 200;
  s.contact.thickness = 4e-3;
  s.cloths.push_back(cloth(grid(10, 10, 0.3, 0.3, -0.15, -0.15, 0.004)));
  s.cloths[0].velocity = {0.05, 0, -1};
  s.obstacles.push_back(obstacle(sphere(12, 8, 0.1, {0, 0, -0.101})));
  return s;
}

/// Two sheets fall on a moving ball: contacts of cloth with cloth and obstacle from the first steps on.
inline cama::Scene pile(int cells)
{
  cama::Scene s;
  s.time_step = 1.0 / 200;
  s.contact.thickness = 4e-3;
  s.cloths.push_back(cloth(grid(cells, cells, 0.3, 0.3, -0.15, -0.15, 0.004)));
  s.cloths.push_back(cloth(grid(cells, cells, 0.28, 0.3, -0.14, -0.153, 0.0075), cotton(), "upper"));
  s.cloths[0].velocity = s.cloths[1].velocity = {0.1, 0, -1};
  cama::Motion motion;
  motion.velocity = {0.2, 0.1, 0.3};
  s.obstacles.push_back(obstacle(sphere(12, 8, 0.1, {0, 0, -0.101}), motion));
  return s;
}

}  // namespace meshes
