// SPDX-License-Identifier: Apache-2.0
// OBJ files are not read with assimp, which stores floats, splits vertices at texture seams and orders them by first
// use. Users refer to vertices by their place in the file, panels share world vertices that are separate in material
// space, and coordinates must be kept to the last bit.
#include "scene/reading/obj_reader.hpp"

#include <charconv>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <string>

#include "cama/error.hpp"
#include "scene/reading/text_file.hpp"

namespace cama {
namespace {

/// A polygon is the triangles [first, end).
struct Polygon {
  long line;
  std::size_t first, end;
};

class ObjReader {
public:
  ObjReader(const std::filesystem::path &file, double scale, RestShape rest, double material_scale)
      : file_(file.string()), text_(read_text(file)), scale_(scale), material_scale_(material_scale),
        textured_(rest == RestShape::uv)
  {}

  ObjFile read()
  {
    std::size_t begin = 0;
    while (begin < text_.size()) {
      std::size_t end = text_.find('\n', begin);
      if (end == std::string::npos) end = text_.size();
      ++line_;
      if (end < text_.size()) text_[end] = '\0';
      parse_line(text_.c_str() + begin);
      begin = end + 1;
    }
    check();
    return std::move(out_);
  }

private:
  [[noreturn]] void fail(const std::string &what) const
  {
    throw FileError(file_ + ":" + std::to_string(line_) + ": " + what);
  }

  void parse_line(const char *s)
  {
    while (*s == ' ' || *s == '\t') ++s;
    if (s[0] == 'v' && is_space(s[1]))
      read_vertex(s + 1);
    else if (textured_ && s[0] == 'v' && s[1] == 't' && is_space(s[2]))
      read_texture(s + 2);
    else if (s[0] == 'f' && is_space(s[1]))
      read_face(s + 1);
    else if (std::strncmp(s, "stitch", 6) == 0 && is_space(s[6]))
      read_stitch(s + 6);
  }

  static bool is_space(char c) { return c == ' ' || c == '\t'; }

  double real(const char *&s, const char *what)
  {
    while (is_space(*s)) ++s;
    if (*s == '+') ++s;
    double x = 0;
    const auto [end, problem] = std::from_chars(s, s + std::strlen(s), x);  // unlike strtod, the same in every locale
    if (problem == std::errc::result_out_of_range) fail(std::string(what) + " is out of the range of a double");
    if (problem != std::errc()) fail(std::string("expected ") + what);
    s = end;
    return x;
  }

  void read_vertex(const char *s)
  {
    const double x = real(s, "x of a vertex"), y = real(s, "y of a vertex"), z = real(s, "z of a vertex");
    out_.mesh.position.push_back({scale_ * x, scale_ * y, scale_ * z});
  }

  void read_texture(const char *s)
  {
    const double u = real(s, "u of a texture coordinate"), v = real(s, "v of a texture coordinate");
    out_.mesh.material_position.push_back({material_scale_ * u, material_scale_ * v});
  }

  /// Converts an index of the file (from 1, or from the end if negative) to an index from 0.
  int resolve(long i, std::size_t count)
  {
    const long r = i > 0 ? i - 1 : static_cast<long>(count) + i;
    if (i == 0 || r < 0 || r > std::numeric_limits<int>::max()) fail("index " + std::to_string(i) + " out of range");
    return static_cast<int>(r);
  }

  bool next_corner(const char *&s, int &v, int &t)
  {
    while (is_space(*s) || *s == '\r') ++s;
    if (*s == '\0' || *s == '#') return false;
    char *end = nullptr;
    const long iv = std::strtol(s, &end, 10);
    if (end == s) fail("expected a vertex index, got \"" + std::string(s, std::strcspn(s, " \t\r")) + "\"");
    v = resolve(iv, out_.mesh.position.size());
    t = -1;
    if (textured_ && *end == '/' && end[1] != '/') {
      const char *p = end + 1;
      t = resolve(std::strtol(p, &end, 10), out_.mesh.material_position.size());
      if (end == p) fail("expected a texture index");
    }
    s = end + std::strcspn(end, " \t\r");
    return true;
  }

  void read_face(const char *s)
  {
    int v[3], t[3], count = 0, nv = 0, nt = 0;
    while (next_corner(s, nv, nt)) {  // a polygon becomes a fan of triangles around its first corner
      const int k = count < 2 ? count : 2;
      v[k] = nv;
      t[k] = nt;
      if (++count < 3) continue;
      out_.mesh.face.push_back({v[0], v[1], v[2]});
      if ((t[0] >= 0) != (t[1] >= 0) || (t[0] >= 0) != (t[2] >= 0))
        fail("some corners of the face have texture coordinates and some have none");
      if (t[0] >= 0) out_.mesh.material_face.push_back({t[0], t[1], t[2]});
      v[1] = v[2];
      t[1] = t[2];
    }
    if (count < 3) fail("a face needs at least 3 corners, got " + std::to_string(count));
    if (count > 3)
      polygons_.push_back({line_, out_.mesh.face.size() - static_cast<std::size_t>(count - 2), out_.mesh.face.size()});
  }

  /// A fan covers a polygon once if all its triangles have the orientation of the polygon.
  void check_convex(const Polygon &p)
  {
    const auto normal = [&](std::size_t f) {
      const Triangle &t = out_.mesh.face[f];
      const auto corner = [&](int k) {
        return out_.mesh.position[static_cast<std::size_t>(t[static_cast<std::size_t>(k)])];
      };
      return kernels::dcross(kernels::dsub(corner(1), corner(0)), kernels::dsub(corner(2), corner(0)));
    };
    dvec3 whole{0, 0, 0};
    for (std::size_t f = p.first; f < p.end; ++f) whole = kernels::dadd(whole, normal(f));
    line_ = p.line;
    for (std::size_t f = p.first; f < p.end; ++f) {
      constexpr double flat = 1e-9;  // relative to the polygon: corners on a line, within rounding
      if (kernels::ddot(normal(f), whole) < -flat * kernels::ddot(whole, whole))
        fail("the face is a concave polygon, which a fan of triangles would fold over itself; split it into triangles");
    }
  }

  void read_stitch(const char *s)
  {
    long index[3];
    for (long &i : index) {
      char *end = nullptr;
      i = std::strtol(s, &end, 10);
      if (end == s) fail("expected \"stitch a b c ratio\"");
      s = end;
    }
    out_.stitches.push_back({static_cast<int>(index[0]), static_cast<int>(index[1]), static_cast<int>(index[2]),
                             real(s, "ratio of a stitch")});
  }

  void check()
  {
    Mesh &m = out_.mesh;
    if (m.face.empty()) fail("no faces in the file");
    const auto range = [&](const std::vector<Triangle> &face, std::size_t size, const char *what) {
      for (std::size_t f = 0; f < face.size(); ++f)
        for (int v : face[f])
          if (static_cast<std::size_t>(v) >= size)
            fail("triangle " + std::to_string(f) + " uses " + what + " " + std::to_string(v + 1) +
                 ", but the file has " + std::to_string(size));
    };
    range(m.face, m.position.size(), "vertex");
    if (!m.material_face.empty() && m.material_face.size() != m.face.size())
      fail("some faces have texture coordinates and some have none");
    range(m.material_face, m.material_position.size(), "texture coordinate");
    const long last = line_;
    for (const Polygon &p : polygons_) check_convex(p);
    line_ = last;
    if (textured_ && m.material_face.empty()) fail_without_texture(file_, false);
    const auto count = static_cast<int>(m.position.size());
    for (const MeshStitch &s : out_.stitches)
      for (int v : {s.a, s.b, s.c})
        if (v < 0 || v >= count)
          fail("a stitch uses vertex " + std::to_string(v) + ", but the file has " + std::to_string(count) +
               " (stitches count from 0)");
  }

  std::string file_, text_;
  double scale_, material_scale_;
  bool textured_;  // texture coordinates are read
  long line_ = 0;
  std::vector<Polygon> polygons_;  // with more than three corners
  ObjFile out_;
};

}  // namespace

ObjFile read_obj(const std::filesystem::path &file, double scale, RestShape rest, double material_scale)
{
  return ObjReader(file, scale, rest, material_scale).read();
}

void fail_without_texture(const std::string &file, bool some)
{
  throw MeshError(file + ": has no texture coordinates" + (some ? " in some of its meshes" : "") +
                  ", which rest \"uv\" takes as the rest shape; unwrap it in the program that made it, or leave rest "
                  "out, and the start is the rest shape");
}

}  // namespace cama
