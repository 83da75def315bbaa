// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "cama/material.hpp"
#include "cama/mesh.hpp"
#include "cama/motion.hpp"
#include "cama/options.hpp"
#include "cama/rigid.hpp"

namespace cama {

/// Shares by which cloth shrinks along warp and weft; below 0 it grows.
using Shrinkage = std::array<double, 2>;

/// Gas enclosed by a closed cloth, at constant temperature: absolute pressure times volume is constant.
struct Gas {
  double pressure = 0;  ///< above `ambient` where the gas has the volume `volume`, Pa
  double volume = 0;  ///< m^3; 0: that which the cloth's mesh encloses
  double ambient = 101325;  ///< absolute pressure outside, Pa
};

/// One piece of cloth: a mesh in its starting position, with a rest state in material space.
struct Cloth {
  std::string name;
  Mesh mesh;  ///< mesh.material_position is the rest state; empty: the starting position is the rest state
  Material material;
  dvec3 velocity{0, 0, 0};  ///< starting velocity, m/s
  std::string source;  ///< what it was made from ("grid", a file name)
  /// Length of a unit of the texture coordinates that are the rest state, m; 0: the rest state has another origin.
  double material_scale = 0;
  double pressure = 0;  ///< inside a closed cloth, above that outside, Pa: along the normals of the faces
  std::optional<Gas> gas;  ///< inside a closed cloth whose faces point outwards; not together with `pressure`
  /// The rest state is 1 - shrinkage times that of the mesh; mass stays. Empty: none; one for all triangles; or
  /// [triangles].
  std::vector<Shrinkage> shrinkage;

  double enclosed_volume() const;  ///< of a closed mesh, m^3; below 0: its faces point inwards
  /// Of a triangle; {0, 0} without any.
  Shrinkage shrinkage_of(std::size_t triangle) const;
  /// Corners of a triangle in its rest state, shrunk, m. Without material space the triangle is laid flat, with the
  /// projected x axis as warp.
  std::array<MaterialPoint, 3> rest_corners(std::size_t triangle) const;
};

/// The shape of an obstacle: a mesh, or exact. An exact shape is defined by the vertices of its mesh: the centre of a
/// sphere, both ends of a capsule's axis, eight corners of a box (corner k at the low or high side along axis a by bit
/// a of k; with 12 faces), and three points of a plane whose normal (b - a) x (c - a) points out of the solid half
/// space.
enum class ObstacleShape { mesh, sphere, capsule, box, plane };

/// What cloth collides with; its motion is prescribed and independent of the cloth, unless it is rigid.
struct Obstacle {
  std::string name;
  Mesh mesh;  ///< position at rest of the motion
  Motion motion;  ///< rigid keys or vertex animation
  double friction = 0.3;  ///< Coulomb coefficient against cloth while it slides
  double static_friction = -1;  ///< while it sticks, not below `friction`; -1: equal to it
  double thickness = 0;  ///< contact thickness, m; 0: the scene's
  double contact_stiffness = -1;  ///< penalty, N/m^3; -1: the scene's
  std::string source;
  ObstacleShape shape = ObstacleShape::mesh;
  double radius = 0;  ///< of a sphere or capsule, m
  std::optional<Rigid> rigid;  ///< a body that cloth and gravity move, instead of `motion`; with a mesh or a box

  bool is_static() const { return !rigid && motion.is_static(); }  ///< whether it never moves
};

/// Exact obstacles, without meshing. Lengths are in m; the normal need not have length 1. They throw SceneError.
Obstacle exact_sphere(const dvec3 &center, double radius);
Obstacle exact_capsule(const dvec3 &end_a, const dvec3 &end_b, double radius);
Obstacle exact_box(const dvec3 &center, const dvec3 &size);
Obstacle exact_plane(const dvec3 &point, const dvec3 &normal);

/// Cloth vertices whose motion is prescribed (degrees of freedom eliminated from the system).
struct Pin {
  int cloth = 0;
  std::vector<int> vertices;  ///< indices into the cloth's mesh
  Motion motion;  ///< rigid motion of the starting position; ignored when `obstacle` is set
  std::optional<int> obstacle;  ///< attach: follow the nearest point of this obstacle's surface
  double release = std::numeric_limits<double>::infinity();  ///< time at which the vertices are released, s
};

/// Spring between a vertex and a point on an edge, (1 - ratio) x_b + ratio x_c.
struct Stitch {
  int cloth_a = 0, vertex_a = 0;
  int cloth_b = 0, vertex_b = 0, vertex_c = 0;
  double ratio = 0;
  double stiffness = 1e3;  ///< N/m
  double length = 0;  ///< at rest, m; one above 0 makes it an elastic, which is slack when it is shorter
};

/// A line of edges that is folded at rest, as pressed pleats are.
struct Crease {
  int cloth = 0;
  std::vector<int> vertices;  ///< in order along the line; an edge between two faces joins each to the next
  double angle = 0;  ///< between the normals of the faces, degrees; above 0: a ridge on the side of the normals
};

struct Wind {
  dvec3 velocity{0, 0, 0};  ///< m/s
  double density = 1.2;  ///< of air, kg/m^3
  double drag = 0.0;  ///< tangential drag per area and speed, kg/(m^2 s)
};

struct Contact {
  bool enabled = true;  ///< false: cloth passes through everything, itself included
  bool self = true;  ///< cloth against cloth
  double thickness = 1e-3;  ///< distance below which the penalty acts, m
  double stiffness = 1e6;  ///< penalty stiffness k of Equation 2 per contact area, N/m^3
  double friction = 0.2;  ///< Coulomb coefficient of cloth against cloth, for materials without their own
  double static_friction = -1;  ///< while it sticks, not below `friction`, for the same materials; -1: equal to it
};

/// The contact properties of one cloth or obstacle, with the scene's values where it gives none.
struct ContactProperties {
  double thickness, stiffness, friction, static_friction;
};

/// What is simulated: host data only. Lengths in m, masses in kg, times in s.
struct Scene {
  std::string name = "scene", description;
  double time_step = 0;  ///< s, taken unchanged by the levels production and paper; 0: the level's own
  double frame_time = 0;  ///< s between recorded frames; 0: time_step, and 1/60 s without one
  int frames = 100;
  dvec3 gravity{0, 0, -9.81};  ///< m/s^2
  std::optional<Wind> wind;
  Contact contact;
  std::vector<Cloth> cloths;
  std::vector<Obstacle> obstacles;
  std::vector<Pin> pins;
  std::vector<Stitch> stitches;
  std::vector<Crease> creases;
  OptionOverrides options;       ///< how to compute it, unless the user overrides them

  /// Loads a folder with scene.json, or a JSON file.
  /// @param resolution Approximate total number of cloth triangles of generated meshes; 0: the scene's own default.
  /// Throws FileError, SceneError (which names the field), MeshError or MaterialError.
  static Scene load(const std::filesystem::path &path, int resolution = 0);
  /// The same from JSON text; relative file names are relative to `folder`.
  static Scene parse(const std::string &json, const std::filesystem::path &folder, int resolution = 0);
  /// JSON text of the whole scene with its meshes; parse(save()) gives the same scene.
  std::string save() const;

  /// Sews an elastic to a line of cloth: a spring that only pulls along each edge between `vertices` in order; repeat
  /// the first at the end for a closed line.
  /// @param share Length of the elastic at rest over that of the line in the rest state of the cloth.
  /// @param stiffness Force over strain, EA, N.
  /// Throws SceneError, which names the vertex.
  void add_elastic(int cloth, const std::vector<int> &vertices, double share, double stiffness);

  /// Vertices of a cloth on the straight line between two points, m, in order. Throws SceneError if there are fewer
  /// than two.
  std::vector<int> vertices_along(int cloth, const dvec3 &from, const dvec3 &to) const;

  /// Throws SceneError, MeshError or MaterialError for the first value that cannot be simulated; Simulation calls it
  /// before any kernel runs.
  void validate() const;

  /// Time from one recorded frame to the next, s.
  double seconds_per_frame() const { return frame_time > 0 ? frame_time : time_step > 0 ? time_step : 1.0 / 60; }
  /// Whether anything can touch: contact is enabled, and there is an obstacle or cloth collides with cloth.
  bool has_contact() const { return contact.enabled && (contact.self || !obstacles.empty()); }
  /// Contact properties of cloth `object`, or of obstacle `object` minus the number of cloths.
  ContactProperties contact_properties(std::size_t object) const;
  int cloth_vertex_count() const;
  int cloth_triangle_count() const;
};

}  // namespace cama
