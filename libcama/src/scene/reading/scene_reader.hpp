// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "cama/generators.hpp"
#include "cama/scene.hpp"
#include "scene/reading/json_reader.hpp"

namespace cama {

/// Reads the objects of a scene file, in the order obstacles, cloths, pins, stitches: garments need obstacles, pins
/// need both.
class SceneReader {
public:
  SceneReader(std::filesystem::path folder, int resolution) : folder_(std::move(folder)), resolution_(resolution) {}
  Scene read(const Field &top);

private:
  void read_settings(const Field &f);
  Material read_material(const Field &f, const std::string &name) const;
  Mesh read_mesh_file(const Field &f, Cloth *cloth, std::vector<MeshStitch> *stitches) const;
  std::filesystem::path file_path(const Field &f) const;

  void read_obstacle(const Field &f, std::size_t index);
  Rigid read_rigid(const Field &f) const;
  Mesh obstacle_shape(const Field &f, Motion &motion, std::string &source) const;
  Character read_character(const Field &f) const;

  void plan_cloths(const std::vector<Field> &all);
  void read_cloth(const Field &f, std::size_t index);
  Pattern cloth_shape(const Field &f, int triangles, Cloth &cloth, std::vector<MeshStitch> &stitches) const;
  Pattern read_garment(const Field &f, int triangles) const;

  void read_pin(const Field &f);
  void read_stitch(const Field &f);
  void read_elastic(const Field &f);
  void read_crease(const Field &f);
  /// The vertices of a generated cloth that have a name, such as an edge's, in order.
  const std::vector<int> &named_vertices(const Field &name, int cloth) const;
  int find_cloth(const Field &f) const;
  int find_obstacle(const Field &f) const;

  std::filesystem::path folder_;
  int resolution_ = 0;
  Scene scene_;
  std::map<std::string, Material> materials_;
  std::vector<int> triangles_;                                  // [cloths] approximate number; 0: not generated
  std::vector<std::map<std::string, std::vector<int>>> group_;  // [cloths] named vertices
};

RigidTransform read_transform(const Field &f);
Motion read_motion(const Field &f);
Mesh read_inline_mesh(const Field &f);
void apply_transform(const RigidTransform &transform, std::vector<dvec3> &position);
double cloth_area(const Field &cloth);   // area of a generated cloth, m^2; 0: from a file or inline

}  // namespace cama
