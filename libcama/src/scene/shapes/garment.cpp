// SPDX-License-Identifier: Apache-2.0
// Skirts and dresses around a human body: rings that follow the convex hull of the body's cross-sections, cut into
// gores.
#include <algorithm>
#include <cmath>
#include <numeric>

#include "cama/error.hpp"
#include "cama/generators.hpp"
#include "scene/constants.hpp"

namespace cama {
namespace {

constexpr int directions = 360;   // in the outline of a ring around the axis

struct Point2 {
  double x, y;
};

double cross(const Point2 &o, const Point2 &a, const Point2 &b)
{
  return (a.x - o.x) * (b.y - o.y) - (a.y - o.y) * (b.x - o.x);
}

std::vector<Point2> convex_hull(std::vector<Point2> p)
{
  if (p.size() < 2) return p;
  std::sort(p.begin(), p.end(),
            [](const Point2 &a, const Point2 &b) { return a.x < b.x || (a.x == b.x && a.y < b.y); });
  std::vector<Point2> h;
  for (int pass = 0; pass < 2; ++pass) {
    const std::size_t base = h.size();
    for (const Point2 &q : p) {
      while (h.size() >= base + 2 && cross(h[h.size() - 2], h.back(), q) <= 0) h.pop_back();
      h.push_back(q);
    }
    h.pop_back();
    std::reverse(p.begin(), p.end());
  }
  return h;
}

/// The part of a human body below a height that the garment surrounds: trunk and legs, without the arms beside them.
class Trunk {
public:
  Trunk(const Mesh &body, double top) : body_(body), parent_(body.position.size()), kept_(body.face.size(), 0)
  {
    std::iota(parent_.begin(), parent_.end(), 0);
    const auto z = [&](int v) { return body_.position[v].z; };
    for (const Triangle &t : body_.face)
      if (std::min({z(t[0]), z(t[1]), z(t[2])}) <= top)
        for (int k = 1; k < 3; ++k) parent_[root(t[k])] = root(t[0]);
    std::vector<double> outline(parent_.size(), 0);   // length of each part's cut at the top
    for (const Triangle &t : body_.face) {
      std::vector<dvec3> cut;
      for (int k = 0; k < 3; ++k) add_cut(t[k], t[(k + 1) % 3], top, cut);
      if (cut.size() == 2) outline[root(t[0])] += kernels::dnorm(kernels::dsub(cut[0], cut[1]));
    }
    const int main = static_cast<int>(std::max_element(outline.begin(), outline.end()) - outline.begin());
    if (!(outline[main] > 0)) throw MeshError("there is no body at height " + std::to_string(top) + " m");
    for (std::size_t f = 0; f < body_.face.size(); ++f) {
      const Triangle &t = body_.face[f];
      const bool below = std::min({z(t[0]), z(t[1]), z(t[2])}) <= top;
      const int r = root(t[0]);
      kept_[f] = below && (r == main || outline[r] == 0);
      if (below && !kept_[f]) beside_.insert(beside_.end(), t.begin(), t.end());
    }
  }

  const std::vector<int> &beside() const { return beside_; }   ///< vertices of the parts left out

  /// Points of the kept part between two heights, projected to the horizontal plane.
  std::vector<Point2> slab(double lo, double hi) const
  {
    std::vector<dvec3> p;
    for (std::size_t f = 0; f < body_.face.size(); ++f) {
      if (!kept_[f]) continue;
      const Triangle &t = body_.face[f];
      for (int k = 0; k < 3; ++k) {
        const dvec3 &x = body_.position[t[k]];
        if (x.z >= lo && x.z <= hi) p.push_back(x);
        add_cut(t[k], t[(k + 1) % 3], lo, p);
        add_cut(t[k], t[(k + 1) % 3], hi, p);
      }
    }
    std::vector<Point2> q;
    for (const dvec3 &x : p) q.push_back({x.x, x.y});
    return q;
  }

private:
  int root(int v)
  {
    while (parent_[v] != v) v = parent_[v] = parent_[parent_[v]];
    return v;
  }

  void add_cut(int a, int b, double z, std::vector<dvec3> &out) const
  {
    const dvec3 &p = body_.position[a], &q = body_.position[b];
    if ((p.z <= z) != (q.z <= z)) out.push_back(kernels::dlerp(p, q, (z - p.z) / (q.z - p.z)));
  }

  const Mesh &body_;
  std::vector<int> parent_, beside_;
  std::vector<char> kept_;
};

using Outline = std::vector<double>;   // [directions] radius

/// Radius, from the axis, of the convex hull of `points` widened by `clearance`.
Outline outline(std::vector<Point2> points, const Point2 &axis, double clearance)
{
  std::vector<Point2> wide;
  for (const Point2 &p : convex_hull(std::move(points)))
    for (int k = 0; k < 24; ++k) {
      const double a = 2 * pi * k / 24, r = clearance / std::cos(pi / 24);
      wide.push_back({p.x + r * std::cos(a) - axis.x, p.y + r * std::sin(a) - axis.y});
    }
  const std::vector<Point2> h = convex_hull(std::move(wide));
  Outline out(directions, 0);
  for (int d = 0; d < directions; ++d) {
    const double a = 2 * pi * d / directions, cx = std::cos(a), cy = std::sin(a);
    for (std::size_t k = 0; k < h.size(); ++k) {   // ray against the edge p + s (q - p)
      const Point2 &p = h[k], &q = h[(k + 1) % h.size()];
      const double ex = q.x - p.x, ey = q.y - p.y, det = cx * ey - cy * ex;
      if (det == 0) continue;
      const double r = (p.x * ey - p.y * ex) / det, s = (p.x * cy - p.y * cx) / det;
      if (s >= -1e-12 && s <= 1 + 1e-12 && r > out[d]) out[d] = r;
    }
  }
  return out;
}

/// Smooths an outline without going below it: the maximum over a window, then the mean over the same window.
Outline rounded(const Outline &r, int window)
{
  Outline most(directions), mean(directions, 0);
  for (int d = 0; d < directions; ++d)
    for (int k = -window; k <= window; ++k) most[d] = std::max(most[d], r[(d + k + directions) % directions]);
  for (int d = 0; d < directions; ++d)
    for (int k = -window; k <= window; ++k) mean[d] += most[(d + k + directions) % directions] / (2 * window + 1);
  return mean;
}

double radius(const Outline &r, double angle)
{
  double d = angle / (2 * pi) * directions;
  d -= std::floor(d / directions) * directions;
  const int i = static_cast<int>(d) % directions;
  return r[i] + (d - std::floor(d)) * (r[(i + 1) % directions] - r[i]);
}

double length_of(const Outline &r)
{
  double sum = 0;
  for (int d = 0; d < directions; ++d) {
    const double a = 2 * pi / directions, p = r[d], q = r[(d + 1) % directions];
    sum += std::sqrt(p * p + q * q - 2 * p * q * std::cos(a));
  }
  return sum;
}

/// Height levels of the cloth, from the top down, with straight lines between.
constexpr int levels = 64;

struct Shell {
  Point2 axis{0, 0};
  double top = 0, length = 0;
  std::vector<Outline> level;     // [levels + 1]
  std::vector<double> turn;       // [directions + 1] share of the middle outline before each direction

  double radius_at(double angle, double down) const   // down is 0 at the top, 1 at the hem
  {
    const double s = std::clamp(down, 0.0, 1.0) * levels;
    const int i = std::min(static_cast<int>(s), levels - 1);
    const double a = radius(level[i], angle), b = radius(level[i + 1], angle);
    return a + (s - i) * (b - a);
  }
  /// around: 0 to 1, proportional to length along the middle outline.
  dvec3 point(double around, double down) const
  {
    around -= std::floor(around);
    const auto d =
        std::min<std::size_t>(std::upper_bound(turn.begin(), turn.end(), around) - turn.begin(), directions) - 1;
    const double angle = 2 * pi / directions * (static_cast<double>(d) + (around - turn[d]) / (turn[d + 1] - turn[d])),
                 r = radius_at(angle, down);
    return {axis.x + r * std::cos(angle), axis.y + r * std::sin(angle), top - down * length};
  }
};

/// The maximum over a window of heights, then the mean over the same window: smooth, and nowhere inside the levels.
void smooth_heights(std::vector<Outline> &level, int window)
{
  const int n = static_cast<int>(level.size());
  for (int d = 0; d < directions; ++d) {
    std::vector<double> most(n), mean(n, 0);
    for (int i = 0; i < n; ++i) {
      most[i] = 0;
      for (int k = std::max(0, i - window); k <= std::min(n - 1, i + window); ++k)
        most[i] = std::max(most[i], level[k][d]);
    }
    for (int i = 0; i < n; ++i) {
      int count = 0;
      for (int k = std::max(0, i - window); k <= std::min(n - 1, i + window); ++k, ++count) mean[i] += most[k];
      level[i][d] = mean[i] / count;
    }
  }
}

/// From level `first` down, straight lines outside of the levels that flare: nearly a cone, which cloth can take
/// without stretch.
void straighten(std::vector<Outline> &level, int first, double flare)
{
  const int n = static_cast<int>(level.size()) - 1, near = std::min(n, first + std::max(1, n / 16));
  if (first >= n) return;
  Outline start = level[first], slope(directions, 0);
  for (int d = 0; d < directions; ++d)
    for (int i = first; i <= near; ++i) start[d] = std::max(start[d], level[i][d]);
  for (int d = 0; d < directions; ++d)
    for (int i = near + 1; i <= n; ++i) slope[d] = std::max(slope[d], (level[i][d] - start[d]) / (i - first));
  slope = rounded(slope, 20);
  for (int i = first; i <= n; ++i)
    for (int d = 0; d < directions; ++d) level[i][d] = start[d] + (i - first) * (slope[d] + flare / (n - first));
}

Shell make_shell(const Trunk &trunk, const Garment &g, const Point2 &axis)
{
  Shell shell{axis, g.top, g.length, {}, {}};
  const double step = g.length / levels, reach = std::max(step, 0.01);
  for (int i = 0; i <= levels; ++i) {
    const double z = g.top - i * step;
    std::vector<Point2> points = trunk.slab(z - reach, i == 0 ? z + 0.01 : z + reach);
    points.push_back(axis);   // with a bent leg the axis may lie outside
    shell.level.push_back(rounded(outline(std::move(points), axis, g.clearance), 6));
  }
  const int hip =
      g.hip > 0 && g.hip < g.top ? std::min(levels, static_cast<int>(std::lround((g.top - g.hip) / step))) : 0;
  if (hip > 0) smooth_heights(shell.level, std::max(1, static_cast<int>(std::lround(0.05 / step))));
  straighten(shell.level, hip, g.flare);

  const Outline &middle = shell.level[levels / 2];
  shell.turn.assign(1, 0);
  for (int d = 0; d < directions; ++d) {
    const double p = middle[d], q = middle[(d + 1) % directions];
    shell.turn.push_back(shell.turn.back() + std::sqrt(p * p + q * q - 2 * p * q * std::cos(2 * pi / directions)));
  }
  const double around = shell.turn.back();
  if (!(around > 0 && std::isfinite(around))) throw MeshError("the garment has no width; check length, flare and body");
  for (double &t : shell.turn) t /= around;
  return shell;
}

void check_beside(const Mesh &body, const Trunk &trunk, const Garment &g, const Shell &shell)
{
  for (int v : trunk.beside()) {
    const dvec3 &x = body.position[v];
    if (x.z < g.top - g.length - g.clearance) continue;
    const double r = shell.radius_at(std::atan2(x.y - shell.axis.y, x.x - shell.axis.x), (g.top - x.z) / g.length);
    if (std::hypot(x.x - shell.axis.x, x.y - shell.axis.y) < r + g.clearance)
      throw MeshError(
          "an arm or another part of the body is in the way at height " + std::to_string(x.z) +
          " m; start with the arms away from the body (lead_in), or change waist, length, flare or clearance");
  }
}

/// A gore laid flat: a coarse net of springs, with their lengths on the shell, that comes to rest in the plane.
class FlatGore {
public:
  FlatGore(const Shell &shell, double first, double last) : x_((across + 1) * (along + 1)), u_(x_.size())
  {
    for (int j = 0; j <= along; ++j)
      for (int i = 0; i <= across; ++i)
        x_[at(i, j)] = shell.point(first + (last - first) * i / across, 1 - static_cast<double>(j) / along);
    double v = 0;
    for (int j = 0; j <= along; ++j) {   // starts with straight rows
      if (j > 0) v += kernels::dnorm(kernels::dsub(x_[at(across / 2, j)], x_[at(across / 2, j - 1)]));
      double width = 0;
      for (int i = 0; i < across; ++i) width += kernels::dnorm(kernels::dsub(x_[at(i + 1, j)], x_[at(i, j)]));
      for (int i = 0; i <= across; ++i) u_[at(i, j)] = {width * (static_cast<double>(i) / across - 0.5), v};
    }
    for (int round = 0; round < 1500; ++round)
      for (int j = 0; j <= along; ++j)
        for (int i = 0; i <= across; ++i) {
          if (i < across) pull(at(i, j), at(i + 1, j));
          if (j < along) pull(at(i, j), at(i, j + 1));
          if (i < across && j < along) {
            pull(at(i, j), at(i + 1, j + 1));
            pull(at(i + 1, j), at(i, j + 1));
          }
        }
    upright();
  }

  MaterialPoint point(double a, double b) const   // a: 0 to 1 across; b: 0 to 1 along, from the hem up
  {
    const double s = a * across, t = b * along;
    const int i = std::min(static_cast<int>(s), across - 1), j = std::min(static_cast<int>(t), along - 1);
    MaterialPoint p;
    for (int k = 0; k < 2; ++k) {
      const double low = u_[at(i, j)][k] + (s - i) * (u_[at(i + 1, j)][k] - u_[at(i, j)][k]);
      const double high = u_[at(i, j + 1)][k] + (s - i) * (u_[at(i + 1, j + 1)][k] - u_[at(i, j + 1)][k]);
      p[k] = low + (t - j) * (high - low);
    }
    return p;
  }
  double left() const
  {
    return extreme([](double x, double y) { return x < y; });
  }
  double right() const
  {
    return extreme([](double x, double y) { return x > y; });
  }

private:
  static constexpr int across = 8, along = 24;
  static int at(int i, int j) { return j * (across + 1) + i; }

  void pull(int a, int b)
  {
    const double dx = u_[b][0] - u_[a][0], dy = u_[b][1] - u_[a][1], l = std::hypot(dx, dy);
    const double s = l > 0 ? 0.5 * (1 - kernels::dnorm(kernels::dsub(x_[b], x_[a])) / l) : 0;
    u_[a] = {u_[a][0] + s * dx, u_[a][1] + s * dy};
    u_[b] = {u_[b][0] - s * dx, u_[b][1] - s * dy};
  }

  /// Turns the middle line along v, so that the warp runs down the gore, and puts the lowest point at v = 0.
  void upright()
  {
    const MaterialPoint lo = u_[at(across / 2, 0)], hi = u_[at(across / 2, along)];
    const double l = std::hypot(hi[0] - lo[0], hi[1] - lo[1]), c = (hi[1] - lo[1]) / l, s = (hi[0] - lo[0]) / l;
    double least = 1e300;
    for (MaterialPoint &p : u_) {
      const double x = p[0] - lo[0], y = p[1] - lo[1];
      p = {c * x - s * y, s * x + c * y};
      least = std::min(least, p[1]);
    }
    for (MaterialPoint &p : u_) p[1] -= least;
  }

  template <class Less> double extreme(Less less) const
  {
    double e = u_[0][0];
    for (const MaterialPoint &p : u_)
      if (less(p[0], e)) e = p[0];
    return e;
  }

  std::vector<dvec3> x_;
  std::vector<MaterialPoint> u_;
};

void add_gore(Pattern &p, const FlatGore &gore, int panel, int per_panel, int columns, int rows, double offset)
{
  const int base = static_cast<int>(p.mesh.material_position.size());
  for (int j = 0; j <= rows; ++j)
    for (int i = 0; i <= per_panel; ++i) {
      const MaterialPoint u = gore.point(static_cast<double>(i) / per_panel, static_cast<double>(j) / rows);
      p.mesh.material_position.push_back({offset + u[0], u[1]});
    }
  for (int j = 0; j < rows; ++j)
    for (int i = 0; i < per_panel; ++i) {
      const int g = panel * per_panel + i, h = (g + 1) % columns;
      const auto m = [&](int a, int b) { return base + b * (per_panel + 1) + a; };
      const std::array<int, 4> world{j * columns + g, j * columns + h, (j + 1) * columns + h, (j + 1) * columns + g},
          material{m(i, j), m(i + 1, j), m(i + 1, j + 1), m(i, j + 1)};
      const Triangle split[2][2] = {{{0, 1, 3}, {1, 2, 3}}, {{0, 1, 2}, {0, 2, 3}}};
      for (const Triangle &t : split[(g + j) % 2]) {
        p.mesh.face.push_back({world[t[0]], world[t[1]], world[t[2]]});
        p.mesh.material_face.push_back({material[t[0]], material[t[1]], material[t[2]]});
      }
    }
}

}  // namespace

Pattern make_garment(const Mesh &body, const Garment &g, int triangles)
{
  if (!(g.length > 0) || !(g.clearance > 0) || g.panels < 1 || g.panels > 64 || !(g.flare >= 0))
    throw MeshError("garment: length and clearance must be greater than 0, flare 0 or more, panels from 1 to 64");
  for (const dvec3 &x : body.position)
    if (!std::isfinite(x.x + x.y + x.z)) throw MeshError("a vertex of the body is not finite");
  const Trunk trunk(body, g.top);
  Point2 axis{0, 0};
  const std::vector<Point2> top = convex_hull(trunk.slab(g.top - 0.01, g.top));
  if (top.size() < 3) throw MeshError("there is no body at height " + std::to_string(g.top) + " m");
  double lo_x = 1e300, hi_x = -1e300, lo_y = 1e300, hi_y = -1e300;
  for (const Point2 &p : top) {
    lo_x = std::min(lo_x, p.x);
    hi_x = std::max(hi_x, p.x);
    lo_y = std::min(lo_y, p.y);
    hi_y = std::max(hi_y, p.y);
  }
  axis = {0.5 * (lo_x + hi_x), 0.5 * (lo_y + hi_y)};

  const Shell shell = make_shell(trunk, g, axis);
  check_beside(body, trunk, g, shell);
  const double around = 0.5 * (length_of(shell.level.front()) + length_of(shell.level.back())),
               down = std::hypot(g.length, g.flare);
  const double cells = std::max(triangles, 64) / 2.0;
  const int unit = g.panels % 2 ? 2 * g.panels : g.panels;
  if (!(std::sqrt(cells * around / down) < most_triangles) || !(cells < most_triangles))
    throw MeshError("garment: would have more than 20,000,000 triangles; give fewer, or a length that fits the body");
  const int columns = std::max(1, static_cast<int>(std::lround(std::sqrt(cells * around / down) / unit))) * unit,
            rows = std::max(2, static_cast<int>(std::lround(cells / columns)));

  Pattern p;
  for (int j = 0; j <= rows; ++j)   // from the hem up
    for (int i = 0; i < columns; ++i) {
      p.mesh.position.push_back(shell.point(static_cast<double>(i) / columns, 1 - static_cast<double>(j) / rows));
      if (j == 0) p.group["hem"].push_back(i);
      if (j == rows) p.group["waist"].push_back(j * columns + i);
    }
  double offset = 0;
  for (int panel = 0; panel < g.panels; ++panel) {
    const FlatGore gore(shell, static_cast<double>(panel) / g.panels, static_cast<double>(panel + 1) / g.panels);
    offset -= gore.left();
    add_gore(p, gore, panel, columns / g.panels, columns, rows, offset);
    offset += gore.right() + 0.02;
  }
  return p;
}

}  // namespace cama
