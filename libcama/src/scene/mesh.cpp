// SPDX-License-Identifier: Apache-2.0
#include "cama/mesh.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <initializer_list>
#include <memory>

#include "cama/error.hpp"

namespace cama {
namespace {

[[noreturn]] void fail(const std::string &object, const std::string &what)
{
  throw MeshError("mesh of " + object + ": " + what);
}

const char *const not_finite = " has a coordinate that is not finite (NaN or infinity); give it a place, or remove it "
                               "with its faces (vertices count "
                               "from 0)";

std::string describe(int f, const Triangle &t)
{
  return "face " + std::to_string(f) + " (" + std::to_string(t[0]) + " " + std::to_string(t[1]) + " " +
         std::to_string(t[2]) + ")";
}

void check_indices(const std::string &object, const std::vector<Triangle> &face, std::size_t size, const char *of)
{
  for (std::size_t f = 0; f < face.size(); ++f) {
    const Triangle &t = face[f];
    for (int v : t)
      if (v < 0 || static_cast<std::size_t>(v) >= size)
        fail(object, describe(static_cast<int>(f), t) + " uses " + of + " " + std::to_string(v) + ", but there are " +
                         std::to_string(size) + "; indices count from 0");
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0])
      fail(object, describe(static_cast<int>(f), t) + " uses one " + std::string(of) + " twice; remove the face");
  }
}

void check_area(const std::string &object, const Mesh &m)
{
  for (std::size_t f = 0; f < m.face.size(); ++f) {
    const Triangle &t = m.face[f];
    const dvec3 a = kernels::dsub(m.position[t[1]], m.position[t[0]]),
                b = kernels::dsub(m.position[t[2]], m.position[t[0]]);
    const double area = 0.5 * kernels::dnorm(kernels::dcross(a, b));
    const double longest = std::max({kernels::ddot(a, a), kernels::ddot(b, b)});
    if (!(area > 1e-12 * longest))
      fail(object, describe(static_cast<int>(f), t) + " has zero area (" + std::to_string(area) +
                       " m^2); remove it or move its vertices apart");
    if (m.material_face.empty()) continue;
    const Triangle &u = m.material_face[f];
    const MaterialPoint &p = m.material_position[u[0]], &q = m.material_position[u[1]], &r = m.material_position[u[2]];
    const double ax = q[0] - p[0], ay = q[1] - p[1], bx = r[0] - p[0], by = r[1] - p[1];
    const double material_area = 0.5 * (ax * by - ay * bx);
    if (!(std::abs(material_area) > 1e-12 * std::max(ax * ax + ay * ay, bx * bx + by * by)))
      fail(object, describe(static_cast<int>(f), t) +
                       " has zero area in material space; its texture coordinates coincide or lie on a line");
  }
}

void check_duplicates(const std::string &object, const std::vector<Triangle> &face)
{
  struct Key {
    Triangle sorted;
    int index;
  };
  std::vector<Key> key(face.size());
  for (std::size_t f = 0; f < face.size(); ++f) {
    key[f] = {face[f], static_cast<int>(f)};
    std::sort(key[f].sorted.begin(), key[f].sorted.end());
  }
  std::sort(key.begin(), key.end(),
            [](const Key &a, const Key &b) { return a.sorted != b.sorted ? a.sorted < b.sorted : a.index < b.index; });
  for (std::size_t i = 1; i < key.size(); ++i)
    if (key[i].sorted == key[i - 1].sorted)
      fail(object, describe(key[i].index, face[key[i].index]) + " repeats face " + std::to_string(key[i - 1].index) +
                       "; remove one of them");
}

}  // namespace

void Mesh::validate(const std::string &object) const
{
  if (position.empty() || face.empty())
    fail(object, "is empty (" + std::to_string(position.size()) + " vertices, " + std::to_string(face.size()) +
                     " faces); give at least one triangle");
  for (std::size_t v = 0; v < position.size(); ++v)
    if (!std::isfinite(position[v].x) || !std::isfinite(position[v].y) || !std::isfinite(position[v].z))
      fail(object, "vertex " + std::to_string(v) + not_finite);
  for (std::size_t v = 0; v < material_position.size(); ++v)
    if (!std::isfinite(material_position[v][0]) || !std::isfinite(material_position[v][1]))
      fail(object, "material vertex " + std::to_string(v) + not_finite);
  check_indices(object, face, position.size(), "vertex");
  if (!material_face.empty()) {
    if (material_face.size() != face.size())
      fail(object, "has " + std::to_string(face.size()) + " faces but " + std::to_string(material_face.size()) +
                       " faces in material space; give one for each, or none");
    check_indices(object, material_face, material_position.size(), "material vertex");
  }
  check_area(object, *this);
  check_duplicates(object, face);
  std::vector<char> used(position.size(), 0);
  for (const Triangle &t : face)
    for (int v : t) used[v] = 1;
  const auto isolated = std::find(used.begin(), used.end(), 0);
  if (isolated != used.end())
    fail(object, "vertex " + std::to_string(isolated - used.begin()) + " is isolated: no face uses it; remove it");
}

std::vector<std::array<int, 2>> unique_edges(const std::vector<Triangle> &face)
{
  std::vector<std::uint64_t> key;
  key.reserve(3 * face.size());
  for (const Triangle &t : face)
    for (int k = 0; k < 3; ++k) {
      const auto lo = static_cast<std::uint64_t>(std::min(t[k], t[(k + 1) % 3])),
                 hi = static_cast<std::uint64_t>(std::max(t[k], t[(k + 1) % 3]));
      key.push_back(lo << 32 | hi);
    }
  std::sort(key.begin(), key.end());
  key.erase(std::unique(key.begin(), key.end()), key.end());
  std::vector<std::array<int, 2>> edge(key.size());
  for (std::size_t e = 0; e < key.size(); ++e)
    edge[e] = {static_cast<int>(key[e] >> 32), static_cast<int>(key[e] & 0xffffffffu)};
  return edge;
}

void save_obj(const std::filesystem::path &file, const Mesh &mesh)
{
  const std::unique_ptr<std::FILE, int (*)(std::FILE *)> out(std::fopen(file.string().c_str(), "wb"), &std::fclose);
  if (!out) throw FileError(file.string() + ": cannot be written");
  bool good = true;
  const auto line = [&](const char *key,
                        std::initializer_list<double> numbers) {  // the same in every locale, and exact to the last bit
    char text[128], *end = text;
    for (; *key; ++key) *end++ = *key;
    for (double x : numbers) {
      *end++ = ' ';
      end = std::to_chars(end, text + sizeof text, x).ptr;
    }
    *end++ = '\n';
    const std::size_t size = static_cast<std::size_t>(end - text);
    good = std::fwrite(text, 1, size, out.get()) == size && good;
  };
  for (const dvec3 &x : mesh.position) line("v", {x.x, x.y, x.z});
  for (const MaterialPoint &u : mesh.material_position) line("vt", {u[0], u[1]});
  for (std::size_t f = 0; f < mesh.face.size(); ++f) {
    const Triangle &t = mesh.face[f];
    if (mesh.material_face.empty())
      good = std::fprintf(out.get(), "f %d %d %d\n", t[0] + 1, t[1] + 1, t[2] + 1) > 0 && good;
    else {
      const Triangle &u = mesh.material_face[f];
      good = std::fprintf(out.get(), "f %d/%d %d/%d %d/%d\n", t[0] + 1, u[0] + 1, t[1] + 1, u[1] + 1, t[2] + 1,
                          u[2] + 1) > 0 &&
             good;
    }
  }
  if (!good || std::fflush(out.get()) != 0) throw FileError(file.string() + ": writing failed; is the disk full?");
}

}  // namespace cama
