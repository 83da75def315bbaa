// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "cama/mesh.hpp"

namespace cama {

/// Placement: x -> translation + scale * rotation * (x - center) + center. Rotation is a unit quaternion (w, x, y, z).
struct RigidTransform {
  dvec3 translation{0, 0, 0};
  std::array<double, 4> rotation{1, 0, 0, 0};
  double scale = 1;
  dvec3 center{0, 0, 0};
  dvec3 apply(const dvec3 &x) const;
};

/// A prescribed motion, continuous in time: rigid keys, steady rates, oscillation, or sampled vertex positions.
struct Motion {
  struct Key {
    double time = 0;
    RigidTransform transform;
  };
  /// translation and scale are interpolated linearly, rotation spherically; constant before the first and after the
  /// last
  std::vector<Key> keys;
  dvec3 velocity{0, 0, 0};  ///< steady translation, m/s
  dvec3 rotation_rate{0, 0, 0};  ///< steady rotation about `center`, rad/s (axis times rate)
  dvec3 oscillation{0, 0, 0};  ///< amplitude of a sine translation, m
  double period = 1;  ///< of the oscillation, s
  dvec3 center{0, 0, 0};
  double start = 0, stop = 1e300;  ///< velocity, rotation rate and oscillation act between these times, s

  /// Vertex animation (skinned characters, sequences): positions at given times, interpolated linearly, constant before
  /// the first and after the last.
  struct Sampled {
    std::vector<double> time;
    std::vector<std::vector<dvec3>> position;
  };
  std::shared_ptr<const Sampled> sampled;

  bool is_static() const;
  bool is_rigid() const { return !sampled; }
  RigidTransform at(double time) const;  ///< rigid part
  void evaluate(double time, const std::vector<dvec3> &rest, std::vector<dvec3> &position) const;  ///< all vertices
};

/// A skinned character: the mesh at the clip's first frame and its sampled motion.
struct Character {
  Mesh mesh;
  Motion motion;
  double duration = 0;
};

/// Loads a mesh with skeletal animation through assimp (glTF, FBX, DAE). Throws FileError.
/// @param clip Name or index of the animation ("" or "0": the first; "bind": none).
/// @param animation_file Another file to take the clip from; nodes are matched by name.
/// @param scale Metres per file unit.
/// @param samples_per_second Density of the sampled vertex motion.
/// @param y_up Turn y-up files to z-up.
/// @param lead_in Seconds in which the bind pose eases into the clip before it starts; 0: no lead-in.
/// @param loops How often the clip is played.
/// @param leave_out Names of joints: triangles with a vertex that follows one of them, or a joint below, more than any
///   other joint are left out.
Character load_character(const std::filesystem::path &file, const std::string &clip = "",
                         const std::filesystem::path &animation_file = {}, double scale = 1.0,
                         double samples_per_second = 60, bool y_up = true, double lead_in = 0, int loops = 1,
                         const std::vector<std::string> &leave_out = {});

}  // namespace cama
