// SPDX-License-Identifier: Apache-2.0
#include "cama/generators.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "cama/error.hpp"
#include "scene/constants.hpp"

namespace cama {
namespace {

/// Two triangles of the cell with corners a (low low), b (high low), c (high high), d (low high); diagonals alternate
/// like a union jack.
void add_cell(std::vector<Triangle> &face, int a, int b, int c, int d, bool rising)
{
  if (rising) {
    face.push_back({a, b, c});
    face.push_back({a, c, d});
  } else {
    face.push_back({a, b, d});
    face.push_back({b, c, d});
  }
}

/// Rounds a number of cells along a side, at least 1. Throws MeshError for a mesh of more than most_triangles.
int cells_along(double number)
{
  if (!(number < 0.5 * most_triangles))
    throw MeshError("a generated mesh would have more than 20,000,000 triangles; give fewer triangles or cells, or "
                    "sides whose lengths differ less");
  return std::max(1, static_cast<int>(std::lround(number)));
}

/// Throws MeshError for more cells, of two triangles each, than most_triangles has.
void check_cells(double columns, double rows) { cells_along(columns * rows); }

}  // namespace

Pattern make_grid(double width, double height, int triangles)
{
  const double cells = std::max(1, triangles) / 2.0;
  if (!(width > 0) || !(height > 0)) throw MeshError("grid: width and height must be greater than 0");
  const int columns = cells_along(std::sqrt(cells * width / height));
  return make_grid_cells(width, height, columns, cells_along(cells / columns));
}

Pattern make_grid_cells(double width, double height, int columns, int rows)
{
  if (!(width > 0) || !(height > 0) || columns < 1 || rows < 1)
    throw MeshError("grid: width, height, columns and rows must be greater than 0");
  check_cells(columns, rows);
  Pattern p;
  const int stride = columns + 1;
  const auto at = [&](int i, int j) { return j * stride + i; };
  for (int j = 0; j <= rows; ++j)
    for (int i = 0; i <= columns; ++i) {
      const double u = width * i / columns, v = height * j / rows;
      p.mesh.material_position.push_back({u, v});
      p.mesh.position.push_back({u - 0.5 * width, v - 0.5 * height, 0});
    }
  for (int j = 0; j < rows; ++j)
    for (int i = 0; i < columns; ++i)
      add_cell(p.mesh.face, at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1), (i + j) % 2 == 0);
  p.mesh.material_face = p.mesh.face;
  for (int j = 0; j <= rows; ++j) {
    p.group["left"].push_back(at(0, j));
    p.group["right"].push_back(at(columns, j));
  }
  for (int i = 0; i <= columns; ++i) {
    p.group["bottom"].push_back(at(i, 0));
    p.group["top"].push_back(at(i, rows));
  }
  p.group["bottom_left"] = {at(0, 0)};
  p.group["bottom_right"] = {at(columns, 0)};
  p.group["top_left"] = {at(0, rows)};
  p.group["top_right"] = {at(columns, rows)};
  return p;
}

Pattern make_tube(double bottom_radius, double top_radius, double height, int triangles, int seams)
{
  if (!(bottom_radius > 0) || !(top_radius > 0) || !(height > 0) || seams < 1)
    throw MeshError("tube: radii, height and seams must be greater than 0");
  const double around = pi * (bottom_radius + top_radius), cells = std::max(8, triangles) / 2.0;
  check_cells(2.0 * seams, 1);
  int columns = (cells_along(1 + std::sqrt(cells * around / height) / (2 * seams)) - 1) * 2 * seams;
  columns = std::max(columns, std::max(2 * seams, 4));
  columns = (columns + 2 * seams - 1) / (2 * seams) * 2 * seams;
  const int rows = cells_along(cells / columns), per_panel = columns / seams;
  check_cells(columns, rows);
  Pattern p;
  for (int j = 0; j <= rows; ++j)
    for (int i = 0; i < columns; ++i) {
      const double r = bottom_radius + (top_radius - bottom_radius) * j / rows, angle = 2 * pi * i / columns;
      p.mesh.position.push_back({r * std::cos(angle), r * std::sin(angle), height * j / rows});
      if (j == 0) p.group["bottom"].push_back(i);
      if (j == rows) p.group["top"].push_back(j * columns + i);
    }
  const double slant = std::hypot(height, top_radius - bottom_radius),
               widest = 2 * pi * std::max(bottom_radius, top_radius) / seams;
  for (int panel = 0; panel < seams; ++panel) {
    const int base = static_cast<int>(p.mesh.material_position.size());
    for (int j = 0; j <= rows; ++j)
      for (int i = 0; i <= per_panel; ++i) {
        const double width = 2 * pi / seams * (bottom_radius + (top_radius - bottom_radius) * j / rows);
        p.mesh.material_position.push_back(
            {1.1 * widest * panel + width * (static_cast<double>(i) / per_panel - 0.5), slant * j / rows});
      }
    for (int j = 0; j < rows; ++j)
      for (int i = 0; i < per_panel; ++i) {
        const int g = panel * per_panel + i, h = (g + 1) % columns;
        const auto m = [&](int a, int b) { return base + b * (per_panel + 1) + a; };
        add_cell(p.mesh.face, j * columns + g, j * columns + h, (j + 1) * columns + h, (j + 1) * columns + g,
                 (g + j) % 2 == 0);
        add_cell(p.mesh.material_face, m(i, j), m(i + 1, j), m(i + 1, j + 1), m(i, j + 1), (g + j) % 2 == 0);
      }
  }
  return p;
}

Mesh make_sphere(double radius, int triangles)
{
  if (!(radius > 0)) throw MeshError("sphere: radius must be greater than 0");
  check_cells(0.5 * triangles, 1);
  const int n = cells_along(std::sqrt(std::max(20, triangles) / 20.0));
  const double g = 0.5 * (1 + std::sqrt(5.0));
  const std::vector<dvec3> corner{{-1, g, 0},  {1, g, 0},  {-1, -g, 0}, {1, -g, 0}, {0, -1, g},  {0, 1, g},
                                  {0, -1, -g}, {0, 1, -g}, {g, 0, -1},  {g, 0, 1},  {-g, 0, -1}, {-g, 0, 1}};
  const std::vector<Triangle> side{{0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
                                   {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
                                   {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};
  Mesh m;
  std::map<std::array<int, 6>, int> known;   // corners with a weight above zero, sorted
  const auto vertex = [&](const Triangle &t, int a, int b, int c) {
    std::array<std::pair<int, int>, 3> w{{{t[0], a}, {t[1], b}, {t[2], c}}};
    for (auto &x : w)
      if (x.second == 0) x.first = -1;
    std::sort(w.begin(), w.end());
    const auto [place, fresh] =
        known.try_emplace({w[0].first, w[0].second, w[1].first, w[1].second, w[2].first, w[2].second},
                          static_cast<int>(m.position.size()));
    if (fresh) {
      dvec3 x{0, 0, 0};
      for (const auto &[index, weight] : w)
        if (index >= 0) x = kernels::daxpy(x, weight, corner[index]);
      m.position.push_back(kernels::dscale(radius, kernels::dnormalize(x)));
    }
    return place->second;
  };
  for (const Triangle &t : side)
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n - i; ++j) {
        const int a = vertex(t, n - i - j, i, j), b = vertex(t, n - i - j - 1, i + 1, j),
                  c = vertex(t, n - i - j - 1, i, j + 1);
        m.face.push_back({a, b, c});
        if (i + j + 1 < n) m.face.push_back({b, vertex(t, n - i - j - 2, i + 1, j + 1), c});
      }
  return m;
}

Mesh make_box(const dvec3 &size, int triangles)
{
  if (!(size.x > 0) || !(size.y > 0) || !(size.z > 0))
    throw MeshError("box: size must be greater than 0 in all directions");
  const double area = 2 * (size.x * size.y + size.y * size.z + size.z * size.x),
               edge = std::sqrt(2 * area / std::max(12, triangles));
  const int n[3] = {cells_along(size.x / edge), cells_along(size.y / edge), cells_along(size.z / edge)};
  for (int axis = 0; axis < 3; ++axis) check_cells(2.0 * n[axis], n[(axis + 1) % 3]);
  const double s[3] = {size.x, size.y, size.z};
  Mesh m;
  std::map<std::array<int, 3>, int> known;
  const auto vertex = [&](const std::array<int, 3> &k) {
    const auto [place, fresh] = known.try_emplace(k, static_cast<int>(m.position.size()));
    if (fresh)
      m.position.push_back(
          {s[0] * k[0] / n[0] - 0.5 * s[0], s[1] * k[1] / n[1] - 0.5 * s[1], s[2] * k[2] / n[2] - 0.5 * s[2]});
    return place->second;
  };
  for (int axis = 0; axis < 3; ++axis)
    for (int high = 0; high < 2; ++high) {
      const int u = high ? (axis + 1) % 3 : (axis + 2) % 3, v = high ? (axis + 2) % 3 : (axis + 1) % 3;
      for (int i = 0; i < n[u]; ++i)
        for (int j = 0; j < n[v]; ++j) {
          const auto at = [&](int a, int b) {
            std::array<int, 3> k{};
            k[axis] = high * n[axis];
            k[u] = a;
            k[v] = b;
            return vertex(k);
          };
          add_cell(m.face, at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1), (i + j) % 2 == 0);
        }
    }
  return m;
}

Mesh make_capsule(double radius, double length, int triangles)
{
  if (!(radius > 0) || !(length >= 0)) throw MeshError("capsule: radius must be greater than 0 and length 0 or more");
  const double area = 2 * pi * radius * (length + 2 * radius), edge = std::sqrt(2 * area / std::max(40, triangles));
  const int around = std::max(6, cells_along(2 * pi * radius / edge)),
            cap = std::max(2, cells_along(0.5 * pi * radius / edge));
  const int straight = length > 0 ? cells_along(length / edge) : 0;
  check_cells(around, 2.0 * cap + straight);
  std::vector<std::pair<double, double>> ring;   // radius and z, from below
  for (int i = 1; i <= cap; ++i)
    ring.emplace_back(radius * std::sin(0.5 * pi * i / cap), -0.5 * length - radius * std::cos(0.5 * pi * i / cap));
  for (int i = 1; i <= straight; ++i) ring.emplace_back(radius, length * i / straight - 0.5 * length);
  for (int i = cap - 1; i >= 1; --i)
    ring.emplace_back(radius * std::sin(0.5 * pi * i / cap), 0.5 * length + radius * std::cos(0.5 * pi * i / cap));
  Mesh m;
  m.position.push_back({0, 0, -0.5 * length - radius});
  const int rings = static_cast<int>(ring.size());
  for (const auto &[r, z] : ring)
    for (int i = 0; i < around; ++i)
      m.position.push_back({r * std::cos(2 * pi * i / around), r * std::sin(2 * pi * i / around), z});
  m.position.push_back({0, 0, 0.5 * length + radius});
  const int top = static_cast<int>(m.position.size()) - 1;
  for (int i = 0; i < around; ++i) {
    const int j = (i + 1) % around, last = 1 + (rings - 1) * around;
    m.face.push_back({0, 1 + j, 1 + i});
    for (int k = 0; k + 1 < rings; ++k)
      add_cell(m.face, 1 + k * around + i, 1 + k * around + j, 1 + (k + 1) * around + j, 1 + (k + 1) * around + i,
               (i + k) % 2 == 0);
    m.face.push_back({last + i, last + j, top});
  }
  return m;
}

Mesh make_revolution(const std::vector<std::pair<double, double>> &profile, int segments)
{
  const int n = static_cast<int>(profile.size());
  if (n < 3 || segments < 3) throw MeshError("revolution: needs at least 3 profile points and 3 segments");
  check_cells(n, segments);
  Mesh m;
  for (const auto &[r, z] : profile) {
    if (!(r > 0)) throw MeshError("revolution: profile radii must be greater than 0");
    for (int i = 0; i < segments; ++i)
      m.position.push_back({r * std::cos(2 * pi * i / segments), r * std::sin(2 * pi * i / segments), z});
  }
  for (int k = 0; k < n; ++k)
    for (int i = 0; i < segments; ++i) {
      const int l = (k + 1) % n, j = (i + 1) % segments;
      add_cell(m.face, k * segments + i, k * segments + j, l * segments + j, l * segments + i, (i + k) % 2 == 0);
    }
  return m;
}

Mesh make_funnel(const Funnel &f, int triangles)
{
  if (!(f.throat_radius > f.wall) || !(f.top_radius > f.throat_radius) || !(f.cone_height > 0) ||
      !(f.tube_length > 0) || !(f.wall > 0))
    throw MeshError("funnel: needs top_radius > throat_radius > wall > 0, cone_height > 0, tube_length > 0");
  // Middle line of the wall from the tube's lower end to the cone's upper rim; the corner at the throat is an arc.
  const double slope = std::atan2(f.top_radius - f.throat_radius, f.cone_height);   // of the cone, from the vertical
  const double r0 = f.throat_radius + 0.5 * f.wall,
               bend = std::min(0.6 * f.throat_radius + f.wall,
                               0.4 * std::min(f.cone_height, f.tube_length) / std::tan(0.5 * slope));
  const double cut = bend * std::tan(0.5 * slope);   // where the arc starts, before and after the corner
  struct Point {
    double r, z, nr, nz;   // position and normal towards the inside
  };
  std::vector<Point> line;
  const auto straight = [&](double ra, double za, double rb, double zb, int n) {
    const double l = std::hypot(rb - ra, zb - za), nr = -(zb - za) / l, nz = (rb - ra) / l;
    for (int i = 0; i < n; ++i) line.push_back({ra + (rb - ra) * i / n, za + (zb - za) * i / n, nr, nz});
  };
  const double slant = std::hypot(f.cone_height, f.top_radius - f.throat_radius),
               outline = 2 * (f.tube_length + slant) + pi * f.wall;
  const double mean_radius = 0.5 * (f.top_radius + f.throat_radius);
  const int segments =
      std::max(12, cells_along(std::sqrt(std::max(200, triangles) / 2.0 * 2 * pi * mean_radius / outline)));
  const double edge = 2 * pi * mean_radius / segments;
  const auto count = [&](double l) { return cells_along(l / edge); };
  straight(r0, -f.tube_length, r0, -cut, count(f.tube_length - cut));
  const int arc = std::max(6, count(bend * slope));
  for (int i = 0; i < arc; ++i) {
    const double a = slope * i / arc;   // the arc's centre lies outside the wall
    line.push_back({r0 + bend * (1 - std::cos(a)), -cut + bend * std::sin(a), -std::cos(a), std::sin(a)});
  }
  const double s = std::sin(slope), c = std::cos(slope);
  straight(r0 + cut * s, cut * c, r0 + slant * s, slant * c, count(slant - cut));
  line.push_back({r0 + slant * s, slant * c, -c, s});

  std::vector<std::pair<double, double>> profile;
  const double h = 0.5 * f.wall;
  // The inner wall, downwards.
  for (auto p = line.rbegin(); p != line.rend(); ++p) profile.emplace_back(p->r + h * p->nr, p->z + h * p->nz);
  // The lower lip, from the inner to the outer wall, on the side away from the line.
  for (int i = 1; i < 6; ++i) {
    const Point &p = line.front();
    const double a = pi * i / 6;
    profile.emplace_back(p.r + h * std::cos(a) * p.nr, p.z - h * std::sin(a));
  }
  // The outer wall, upwards.
  for (const Point &p : line) profile.emplace_back(p.r - h * p.nr, p.z - h * p.nz);
  for (int i = 1; i < 6; ++i) {
    const Point &p = line.back();
    const double a = pi * i / 6, tr = p.nz, tz = -p.nr;
    profile.emplace_back(p.r - h * std::cos(a) * p.nr + h * std::sin(a) * tr,
                         p.z - h * std::cos(a) * p.nz + h * std::sin(a) * tz);
  }
  return make_revolution(profile, segments);
}

}  // namespace cama
