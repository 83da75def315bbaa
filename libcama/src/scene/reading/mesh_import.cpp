// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cctype>
#include <cstring>
#include <map>
#include <unordered_map>

#include "cama/error.hpp"
#include "cama/mesh.hpp"
#include "device/fnv.hpp"
#include "scene/reading/assimp_file.hpp"
#include "scene/reading/obj_reader.hpp"
#include "scene/reading/weld.hpp"

#if CAMA_HAS_ASSIMP
#include <assimp/config.h>
#include <assimp/postprocess.h>
#endif

namespace cama {
namespace {

std::string extension(const std::filesystem::path &file)
{
  std::string e = file.extension().string();
  std::transform(e.begin(), e.end(), e.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return e;
}

#if CAMA_HAS_ASSIMP
/// A text of assimp, which may quote the file, with a few hundred printable characters at most.
std::string one_line(std::string text)
{
  if (text.size() > 300) text = text.substr(0, 300) + "...";
  std::replace_if(text.begin(), text.end(), [](unsigned char c) { return c < 0x20; }, ' ');
  return text;
}

struct Corners {
  std::vector<dvec3> position;
  std::vector<Triangle> face;
  std::vector<MaterialPoint> texture;
};

void collect(const aiScene &scene, const aiNode &node, const Affine &parent, Corners &out, bool &textured)
{
  const Affine here = multiply(parent, Affine::from(node.mTransformation));
  for (unsigned i = 0; i < node.mNumMeshes; ++i) {
    const aiMesh &m = *scene.mMeshes[node.mMeshes[i]];
    if (!(m.mPrimitiveTypes & aiPrimitiveType_TRIANGLE)) continue;
    const int base = static_cast<int>(out.position.size());
    textured = textured && m.HasTextureCoords(0);
    for (unsigned v = 0; v < m.mNumVertices; ++v) {
      out.position.push_back(here.apply({m.mVertices[v].x, m.mVertices[v].y, m.mVertices[v].z}));
      out.texture.push_back(m.HasTextureCoords(0) ? MaterialPoint{m.mTextureCoords[0][v].x, m.mTextureCoords[0][v].y}
                                                  : MaterialPoint{0, 0});
    }
    for (unsigned f = 0; f < m.mNumFaces; ++f)
      if (is_triangle(m, f))
        out.face.push_back({base + static_cast<int>(m.mFaces[f].mIndices[0]),
                            base + static_cast<int>(m.mFaces[f].mIndices[1]),
                            base + static_cast<int>(m.mFaces[f].mIndices[2])});
  }
  for (unsigned c = 0; c < node.mNumChildren; ++c) collect(scene, *node.mChildren[c], here, out, textured);
}

Mesh load_through_assimp(const std::filesystem::path &file, double scale, RestShape rest, double material_scale)
{
  Assimp::Importer importer;
  const aiScene *scene = open_assimp(importer, file, true);
  Corners corners;
  bool textured = true, some = false;
  collect(*scene, *scene->mRootNode, Affine(), corners, textured);
  for (unsigned i = 0; i < scene->mNumMeshes; ++i) some = some || scene->mMeshes[i]->HasTextureCoords(0);
  if (rest == RestShape::uv && !textured && !corners.face.empty()) fail_without_texture(file.string(), some);
  const std::string e = extension(file);
  const bool y_up = e == ".glb" || e == ".gltf" || e == ".fbx" || e == ".dae";

  const Weld weld = weld_equal(corners.position, {});
  Mesh mesh;
  for (int v : weld.first)
    mesh.position.push_back(kernels::dscale(scale, y_up ? y_up_to_z_up(corners.position[v]) : corners.position[v]));
  std::map<std::array<double, 3>, int> material;   // world vertex, u, v
  for (const Triangle &t : corners.face) {
    const Triangle w{weld.index[t[0]], weld.index[t[1]], weld.index[t[2]]};
    if (w[0] == w[1] || w[1] == w[2] || w[2] == w[0]) continue;   // collapsed by welding: zero area
    mesh.face.push_back(w);
    if (rest != RestShape::uv) continue;
    Triangle u{};
    for (int k = 0; k < 3; ++k) {
      const MaterialPoint &p = corners.texture[t[k]];
      const auto [place, fresh] = material.try_emplace({static_cast<double>(w[k]), p[0], p[1]},
                                                       static_cast<int>(mesh.material_position.size()));
      if (fresh) mesh.material_position.push_back({material_scale * p[0], material_scale * p[1]});
      u[k] = place->second;
    }
    mesh.material_face.push_back(u);
  }
  if (mesh.face.empty()) throw FileError(file.string() + ": no triangles in the file");
  return mesh;
}
#endif

}  // namespace

#if CAMA_HAS_ASSIMP
bool is_triangle(const aiMesh &mesh, unsigned f)
{
  const aiFace &face = mesh.mFaces[f];
  return face.mNumIndices == 3 &&
         std::all_of(face.mIndices, face.mIndices + 3, [&](unsigned v) { return v < mesh.mNumVertices; });
}

const aiScene *open_assimp(Assimp::Importer &importer, const std::filesystem::path &file, bool need_mesh)
{
  if (!std::filesystem::exists(file)) throw FileError(file.string() + ": no such file");
  importer.SetPropertyBool(AI_CONFIG_IMPORT_FBX_PRESERVE_PIVOTS, false);
  const aiScene *scene = importer.ReadFile(file.string(), aiProcess_Triangulate);
  if (!scene || !scene->mRootNode)
    throw FileError(file.string() + ": cannot be read: " + one_line(importer.GetErrorString()));
  if (need_mesh && scene->mNumMeshes == 0) throw FileError(file.string() + ": holds no mesh");
  return scene;
}
#endif

Weld weld_equal(const std::vector<dvec3> &position, const std::vector<std::string> &tag)
{
  struct Hash {
    std::size_t operator()(const std::array<std::uint64_t, 3> &k) const
    {
      return static_cast<std::size_t>(fnv1a(k.data(), sizeof k));
    }
  };
  std::unordered_multimap<std::array<std::uint64_t, 3>, int, Hash> seen;
  Weld weld;
  weld.index.resize(position.size());
  for (std::size_t v = 0; v < position.size(); ++v) {
    std::array<std::uint64_t, 3> key;
    const double x[3] = {position[v].x + 0.0, position[v].y + 0.0, position[v].z + 0.0};   // -0 becomes 0
    std::memcpy(key.data(), x, sizeof x);
    int found = -1;
    for (auto [i, end] = seen.equal_range(key); i != end; ++i)
      if (tag.empty() || tag[weld.first[i->second]] == tag[v]) found = i->second;
    if (found < 0) {
      found = static_cast<int>(weld.first.size());
      weld.first.push_back(static_cast<int>(v));
      seen.emplace(key, found);
    }
    weld.index[v] = found;
  }
  return weld;
}

Mesh load_mesh(const std::filesystem::path &file, double scale, RestShape rest, double material_scale)
{
  if (rest != RestShape::uv && material_scale != 1)
    throw MeshError(file.string() + ": material_scale is given, which only RestShape::uv uses; ask for that, or leave "
                                    "it out");
  if (extension(file) == ".obj") return read_obj(file, scale, rest, material_scale).mesh;
#if CAMA_HAS_ASSIMP
  return load_through_assimp(file, scale, rest, material_scale);
#else
  (void)scale;
  throw FileError(
      file.string() +
      ": this build of cama reads OBJ only; install assimp (Debian: libassimp-dev) and configure again to read "
      "PLY, glTF, FBX, DAE and STL");
#endif
}

std::vector<MeshStitch> load_stitches(const std::filesystem::path &file)
{
  return extension(file) == ".obj" ? read_obj(file, 1, RestShape::start, 1).stitches : std::vector<MeshStitch>();
}

}  // namespace cama
