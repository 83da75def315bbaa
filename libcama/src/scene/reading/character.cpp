// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <string>

#include "cama/error.hpp"
#include "cama/motion.hpp"
#include "scene/constants.hpp"
#include "scene/reading/assimp_file.hpp"
#include "scene/reading/weld.hpp"
#include "scene/shapes/quaternion.hpp"

namespace cama {

#if CAMA_HAS_ASSIMP
namespace {

/// Local placement of a node: translation after rotation after scale.
struct Pose {
  dvec3 translation;
  Quaternion rotation;
  dvec3 scale;
};

Pose mix(const Pose &a, const Pose &b, double t)
{
  return {kernels::dlerp(a.translation, b.translation, t), slerp(a.rotation, b.rotation, t),
          kernels::dlerp(a.scale, b.scale, t)};
}

Affine to_affine(const Pose &p)
{
  const dvec3 x = kernels::dscale(p.scale.x, rotate(p.rotation, {1, 0, 0})),
              y = kernels::dscale(p.scale.y, rotate(p.rotation, {0, 1, 0})),
              z = kernels::dscale(p.scale.z, rotate(p.rotation, {0, 0, 1}));
  return {{{x.x, y.x, z.x, p.translation.x}, {x.y, y.y, z.y, p.translation.y}, {x.z, y.z, z.z, p.translation.z}}};
}

dvec3 vector(const aiVector3D &v) { return {v.x, v.y, v.z}; }

/// Value of a key list at a time (file ticks), constant before the first and after the last key.
template <class Key, class Value, class Mix>
Value key_value(const Key *keys, unsigned count, double time, Value (*value)(const Key &), Mix mix)
{
  if (count == 1 || time <= keys[0].mTime) return value(keys[0]);
  if (time >= keys[count - 1].mTime) return value(keys[count - 1]);
  const Key *right = std::upper_bound(keys, keys + count, time, [](double t, const Key &k) { return t < k.mTime; });
  const Key *left = right - 1;
  return mix(value(*left), value(*right), (time - left->mTime) / (right->mTime - left->mTime));
}

struct Node {
  std::string name;
  int parent;
  Affine local;
  Pose pose;
  const aiNodeAnim *channel;
};

class Skinner {
public:
  Skinner(const std::filesystem::path &file, const std::string &clip, const std::filesystem::path &animation_file,
          const std::vector<std::string> &leave_out)
      : file_(file.string())
  {
    scene_ = open_assimp(importer_, file, true);
    add_node(*scene_->mRootNode, -1);
    collect_corners(leave_out);
    if (clip != "bind") choose_clip(clip, animation_file);
  }

  double clip_start() const { return first_; }      // s
  double clip_length() const { return last_ - first_; }
  bool has_clip() const { return animation_ != nullptr; }
  const std::vector<Triangle> &face() const { return face_; }
  std::size_t vertex_count() const { return vertex_.size(); }

  /// Vertices at `time` of the clip (s); `blend` 0: bind pose, 1: clip.
  std::vector<dvec3> positions(double time, double blend) const
  {
    std::vector<Affine> global(node_.size());
    for (std::size_t n = 0; n < node_.size(); ++n) {
      const Affine local = node_[n].channel && blend > 0 ? to_affine(blended(node_[n], time, blend)) : node_[n].local;
      global[n] = node_[n].parent < 0 ? local : multiply(global[node_[n].parent], local);
    }
    std::vector<Affine> bone(bone_.size());
    for (std::size_t b = 0; b < bone.size(); ++b) bone[b] = multiply(global[bone_[b].node], bone_[b].offset);
    std::vector<dvec3> out(vertex_.size());
    for (std::size_t v = 0; v < vertex_.size(); ++v) {
      dvec3 sum{0, 0, 0};
      for (const Influence &i : vertex_[v].influence)
        sum = kernels::daxpy(sum, i.weight, bone[i.bone].apply(vertex_[v].position));
      out[v] = sum;
    }
    return out;
  }

private:
  struct Influence {
    int bone;
    double weight;
  };
  struct Vertex {
    dvec3 position;
    std::vector<Influence> influence;
  };
  struct Bone {
    int node;
    Affine offset;
  };

  void add_node(const aiNode &n, int parent)
  {
    const int here = static_cast<int>(node_.size());
    aiVector3D scale, translation;
    aiQuaternion q;
    n.mTransformation.Decompose(scale, q, translation);
    node_.push_back({n.mName.C_Str(),
                     parent,
                     Affine::from(n.mTransformation),
                     {vector(translation), normalized({q.w, q.x, q.y, q.z}), vector(scale)},
                     nullptr});
    index_.emplace(node_.back().name, here);
    for (unsigned i = 0; i < n.mNumMeshes; ++i) mesh_node_.emplace_back(static_cast<int>(n.mMeshes[i]), here);
    for (unsigned c = 0; c < n.mNumChildren; ++c) add_node(*n.mChildren[c], here);
  }

  /// Joins all meshes; vertices that the file splits at normals or texture seams are merged if position and weights
  /// agree.
  void collect_corners(const std::vector<std::string> &leave_out)
  {
    std::vector<Vertex> corner;
    std::vector<std::string> tag;
    std::vector<Triangle> face;
    for (const auto &[mesh_index, node] : mesh_node_) {
      const aiMesh &m = *scene_->mMeshes[mesh_index];
      const int base = static_cast<int>(corner.size());
      for (unsigned v = 0; v < m.mNumVertices; ++v) corner.push_back({vector(m.mVertices[v]), {}});
      for (unsigned b = 0; b < m.mNumBones; ++b) add_bone(*m.mBones[b], base, corner);
      bone_.push_back({node, Affine()});   // for vertices without bones, which follow the node of the mesh
      const int unmoved = static_cast<int>(bone_.size()) - 1;
      for (unsigned v = 0; v < m.mNumVertices; ++v) {
        Vertex &c = corner[base + v];
        if (c.influence.empty()) c.influence.push_back({unmoved, 1.0});
        double sum = 0;
        for (const Influence &i : c.influence) sum += i.weight;
        std::string key;
        for (Influence &i : c.influence) {
          i.weight /= sum;
          key += node_[bone_[i.bone].node].name + ":" + std::to_string(static_cast<float>(i.weight)) + ";";
        }
        tag.push_back(std::move(key));
      }
      for (unsigned f = 0; f < m.mNumFaces; ++f)
        if (is_triangle(m, f))
          face.push_back({base + static_cast<int>(m.mFaces[f].mIndices[0]),
                          base + static_cast<int>(m.mFaces[f].mIndices[1]),
                          base + static_cast<int>(m.mFaces[f].mIndices[2])});
    }
    leave_out_limbs(leave_out, corner, face);
    std::vector<dvec3> position;
    for (const Vertex &c : corner) position.push_back(c.position);
    const Weld weld = weld_equal(position, tag);
    std::vector<int> place(weld.first.size(), -1);
    for (const Triangle &t : face) {
      Triangle w{weld.index[t[0]], weld.index[t[1]], weld.index[t[2]]};
      if (w[0] == w[1] || w[1] == w[2] || w[2] == w[0]) continue;
      for (int &v : w) {   // leaves out vertices that no triangle uses
        if (place[v] < 0) {
          place[v] = static_cast<int>(vertex_.size());
          vertex_.push_back(std::move(corner[weld.first[v]]));
        }
        v = place[v];
      }
      face_.push_back(w);
    }
    if (face_.empty()) throw FileError(file_ + ": holds no triangles");
  }

  /// Removes the triangles with a vertex whose heaviest bone is one of the joints, or below one.
  void leave_out_limbs(const std::vector<std::string> &joints, const std::vector<Vertex> &corner,
                       std::vector<Triangle> &face) const
  {
    if (joints.empty()) return;
    std::set<int> bones;
    for (const Bone &b : bone_) bones.insert(b.node);
    std::vector<char> out(node_.size(), 0);
    for (const std::string &joint : joints) {
      const auto n = index_.find(joint);
      if (n == index_.end()) {
        std::string names;
        for (int b : bones) names += (names.empty() ? "\"" : ", \"") + node_[b].name + "\"";
        throw FileError(file_ + ": leave_out: there is no joint \"" + joint + "\"; there are: " + names);
      }
      out[n->second] = 1;
    }
    for (std::size_t n = 0; n < node_.size(); ++n)
      if (node_[n].parent >= 0 && out[node_[n].parent]) out[n] = 1;
    const auto follows = [&](int v) {
      const std::vector<Influence> &all = corner[v].influence;
      const auto heaviest = std::max_element(
          all.begin(), all.end(), [](const Influence &a, const Influence &b) { return a.weight < b.weight; });
      return out[bone_[heaviest->bone].node] != 0;
    };
    face.erase(std::remove_if(face.begin(), face.end(),
                              [&](const Triangle &t) { return follows(t[0]) || follows(t[1]) || follows(t[2]); }),
               face.end());
    if (face.empty()) throw FileError(file_ + ": leave_out leaves no triangles");
  }

  void add_bone(const aiBone &b, int base, std::vector<Vertex> &corner)
  {
    const auto n = index_.find(b.mName.C_Str());
    if (n == index_.end()) throw FileError(file_ + ": bone \"" + b.mName.C_Str() + "\" has no node of that name");
    bone_.push_back({n->second, Affine::from(b.mOffsetMatrix)});
    for (unsigned w = 0; w < b.mNumWeights; ++w)
      if (b.mWeights[w].mWeight > 0 && b.mWeights[w].mVertexId < corner.size() - static_cast<std::size_t>(base))
        corner[base + b.mWeights[w].mVertexId].influence.push_back(
            {static_cast<int>(bone_.size()) - 1, b.mWeights[w].mWeight});
  }

  void choose_clip(const std::string &clip, const std::filesystem::path &animation_file)
  {
    const aiScene *source = animation_file.empty() ? scene_ : open_assimp(animation_importer_, animation_file, false);
    const std::string from = animation_file.empty() ? file_ : animation_file.string();
    if (source->mNumAnimations == 0)
      throw FileError(from +
                      ": holds no animation; give animation_file, or clip \"bind\" for a mesh that does not move");
    std::string names;
    for (unsigned i = 0; i < source->mNumAnimations; ++i) {
      const aiAnimation *a = source->mAnimations[i];
      if (clip == a->mName.C_Str() || clip == std::to_string(i)) animation_ = a;
      names += (i ? ", \"" : "\"") + std::string(a->mName.C_Str()) + "\"";
    }
    if (clip.empty()) animation_ = source->mAnimations[0];
    if (!animation_) throw FileError(from + ": no clip \"" + clip + "\"; there are: " + names);
    ticks_ = animation_->mTicksPerSecond > 0 ? animation_->mTicksPerSecond : 25;
    int matched = 0;
    double first = 1e300, last = -1e300;
    for (unsigned c = 0; c < animation_->mNumChannels; ++c) {
      const aiNodeAnim *channel = animation_->mChannels[c];
      const auto n = index_.find(channel->mNodeName.C_Str());
      if (n == index_.end() || !channel->mNumPositionKeys || !channel->mNumRotationKeys || !channel->mNumScalingKeys)
        continue;
      node_[n->second].channel = channel;
      ++matched;
      for (const double t : {channel->mPositionKeys[0].mTime, channel->mRotationKeys[0].mTime})
        first = std::min(first, t);
      last = std::max({last, channel->mPositionKeys[channel->mNumPositionKeys - 1].mTime,
                       channel->mRotationKeys[channel->mNumRotationKeys - 1].mTime});
    }
    if (matched == 0) throw FileError(from + ": no animated node has the name of a node in " + file_);
    first_ = first / ticks_;
    last_ = last / ticks_;
  }

  Pose blended(const Node &n, double time, double blend) const
  {
    const double t = time * ticks_;
    const aiNodeAnim &c = *n.channel;
    Pose p;
    p.translation = key_value<aiVectorKey, dvec3>(
        c.mPositionKeys, c.mNumPositionKeys, t, [](const aiVectorKey &k) { return vector(k.mValue); }, kernels::dlerp);
    p.rotation = key_value<aiQuatKey, Quaternion>(
        c.mRotationKeys, c.mNumRotationKeys, t,
        [](const aiQuatKey &k) { return normalized({k.mValue.w, k.mValue.x, k.mValue.y, k.mValue.z}); }, slerp);
    p.scale = key_value<aiVectorKey, dvec3>(
        c.mScalingKeys, c.mNumScalingKeys, t, [](const aiVectorKey &k) { return vector(k.mValue); }, kernels::dlerp);
    return blend < 1 ? mix(n.pose, p, blend) : p;
  }

  std::string file_;
  Assimp::Importer importer_, animation_importer_;
  const aiScene *scene_ = nullptr;
  const aiAnimation *animation_ = nullptr;
  double ticks_ = 1, first_ = 0, last_ = 0;
  std::vector<Node> node_;   // parents before children
  std::map<std::string, int> index_;
  std::vector<std::pair<int, int>> mesh_node_;
  std::vector<Bone> bone_;
  std::vector<Vertex> vertex_;
  std::vector<Triangle> face_;
};

/// Repeats the samples from `first` on, each time displaced by the distance that the clip travels.
void repeat(Motion::Sampled &s, std::size_t first, double length, int loops)
{
  const std::size_t last = s.time.size() - 1;
  dvec3 travel{0, 0, 0};
  for (std::size_t v = 0; v < s.position[last].size(); ++v)
    travel = kernels::daxpy(travel, 1.0 / static_cast<double>(s.position[last].size()),
                            kernels::dsub(s.position[last][v], s.position[first][v]));
  for (int l = 1; l < loops; ++l)
    for (std::size_t i = first + 1; i <= last; ++i) {
      s.time.push_back(s.time[i] + l * length);
      s.position.push_back(s.position[i]);
      for (dvec3 &x : s.position.back()) x = kernels::daxpy(x, l, travel);
    }
}

}  // namespace

Character load_character(const std::filesystem::path &file, const std::string &clip,
                         const std::filesystem::path &animation_file, double scale, double samples_per_second,
                         bool y_up, double lead_in, int loops, const std::vector<std::string> &leave_out)
{
  if (!(samples_per_second > 0)) throw FileError(file.string() + ": samples_per_second must be greater than 0");
  const Skinner skinner(file, clip, animation_file, leave_out);
  auto sampled = std::make_shared<Motion::Sampled>();
  const auto add = [&](double time, double clip_time, double blend) {
    sampled->time.push_back(time);
    sampled->position.push_back(skinner.positions(clip_time, blend));
    for (dvec3 &x : sampled->position.back()) x = kernels::dscale(scale, y_up ? y_up_to_z_up(x) : x);
  };
  Character character;
  if (!skinner.has_clip())
    add(0, 0, 0);
  else {
    const double start = skinner.clip_start(), length = skinner.clip_length();
    const double samples = (length * std::max(1, loops) + std::max(0.0, lead_in)) * samples_per_second;
    if (!(length >= 0) || !(samples * static_cast<double>(skinner.vertex_count()) < most_sampled_positions))
      throw FileError(file.string() + ": the clip of " + std::to_string(length) + " s, " + std::to_string(loops) +
                      " times, would have too many samples; give a clip, fewer loops or lower samples_per_second");
    const int lead = lead_in > 0 ? std::max(1, static_cast<int>(std::ceil(lead_in * samples_per_second))) : 0;
    for (int i = 0; i < lead; ++i) {
      const double t = static_cast<double>(i) / lead, eased = t * t * t * (10 + t * (6 * t - 15));
      add(lead_in * t, start, eased);
    }
    const int count = std::max(1, static_cast<int>(std::ceil(length * samples_per_second - 1e-9)));
    for (int i = 0; i <= count; ++i) add((lead ? lead_in : 0) + length * i / count, start + length * i / count, 1);
    repeat(*sampled, static_cast<std::size_t>(lead), length, loops);
    character.duration = (lead ? lead_in : 0) + std::max(1, loops) * length;
  }
  character.mesh.face = skinner.face();
  character.mesh.position = sampled->position.front();
  character.motion.sampled = std::move(sampled);
  return character;
}

#else

Character load_character(const std::filesystem::path &file, const std::string &, const std::filesystem::path &, double,
                         double, bool, double, int, const std::vector<std::string> &)
{
  throw FileError(
      file.string() +
      ": this build of cama cannot read characters; install assimp (Debian: libassimp-dev) and configure again");
}

#endif

}  // namespace cama
