// SPDX-License-Identifier: Apache-2.0
#include "cama/scene.hpp"

#include "bindings.hpp"

namespace cama::python {
namespace {

constexpr const char *shape_names[] = {"mesh", "sphere", "capsule", "box", "plane"};  // in the order of ObstacleShape

using Matrix4 = std::array<std::array<double, 4>, 4>;

dvec3 transformed(const Matrix4 &m, const dvec3 &x)
{
  const auto row = [&](int i) { return m[i][0] * x.x + m[i][1] * x.y + m[i][2] * x.z + m[i][3]; };
  return dvec3{row(0), row(1), row(2)};
}

void transform(std::vector<dvec3> &points, const Matrix4 &m)
{
  for (dvec3 &x : points) x = transformed(m, x);
}

/// Transforms every sample of a vertex animation; rigid motions are unchanged.
void transform(Motion &motion, const Matrix4 &m)
{
  if (!motion.sampled) return;
  auto samples = std::make_shared<Motion::Sampled>(*motion.sampled);
  for (auto &positions : samples->position) transform(positions, m);
  motion.sampled = std::move(samples);
}

std::shared_ptr<const Motion::Sampled> samples(const Doubles &times, const Doubles &positions)
{
  auto sampled = std::make_shared<Motion::Sampled>();
  sampled->time.assign(times.data(), times.data() + times.size());
  const py::ssize_t count = positions.shape(1);
  const dvec3 *first = reinterpret_cast<const dvec3 *>(positions.data());
  for (py::ssize_t k = 0; k < positions.shape(0); ++k)
    sampled->position.emplace_back(first + k * count, first + (k + 1) * count);
  return sampled;
}

void bind_mesh(py::module_ &m)
{
  py::class_<Mesh>(m, "Mesh")
      .def(py::init(
          [](const Doubles &position, const Ints &face, const Doubles &material_position, const Ints &material_face) {
            return Mesh{to_vector<dvec3>(position), to_vector<Triangle>(face),
                        to_vector<MaterialPoint>(material_position), to_vector<Triangle>(material_face)};
          }))
      .def_property_readonly("vertices", [](const Mesh &mesh) { return to_array<double>(mesh.position); })
      .def_property_readonly("faces", [](const Mesh &mesh) { return to_array<int>(mesh.face); })
      .def_property_readonly("material_vertices",
                             [](const Mesh &mesh) { return to_array<double>(mesh.material_position); })
      .def_property_readonly("material_faces", [](const Mesh &mesh) { return to_array<int>(mesh.material_face); })
      .def("transform", [](Mesh &mesh, const Matrix4 &matrix) { transform(mesh.position, matrix); })
      .def("scale_material",
           [](Mesh &mesh, double scale) {
             for (MaterialPoint &u : mesh.material_position) u = {scale * u[0], scale * u[1]};
           })
      .def("validate", &Mesh::validate);
  m.def(
      "load_mesh",
      [](const std::filesystem::path &file, double scale, bool uv, double material_scale) {
        return load_mesh(file, scale, uv ? RestShape::uv : RestShape::start, material_scale);
      },
      py::call_guard<py::gil_scoped_release>());
  m.def("weld_distances", [](const Mesh &mesh) {
    const WeldDistances d = weld_distances(mesh);
    return std::pair(d.coincident, d.largest);
  });
  m.def("weld", [](const Mesh &mesh, double distance) {
    WeldedMesh welded = weld(mesh, distance);
    return std::pair(std::move(welded.mesh), to_array<int>(welded.vertex));
  });
  m.def("save_obj", &save_obj);
  m.def("load_stitches", [](const std::filesystem::path &file, const std::optional<Ints> &vertex) {
    py::list rows;
    std::vector<MeshStitch> stitches = load_stitches(file);
    if (vertex) stitches = renumber(stitches, to_vector<int>(*vertex));
    for (const MeshStitch &s : stitches) rows.append(py::make_tuple(s.a, s.b, s.c, s.ratio));
    return rows;
  });
}

void bind_material(py::module_ &m)
{
  py::class_<Material>(m, "Material")
      .def(py::init<>())
      .def(py::init<const Material &>())
      .def_readwrite("name", &Material::name)
      .def_readwrite("source", &Material::source)
      .def_readwrite("density", &Material::density)
      .def_readwrite("stretching", &Material::stretching)
      .def_readwrite("bending", &Material::bending)
      .def_readwrite("damping", &Material::damping)
      .def_readwrite("mass_damping", &Material::mass_damping)
      .def_readwrite("strain_limit", &Material::strain_limit)
      .def_readwrite("limit_stiffening", &Material::limit_stiffening)
      .def_readwrite("yield_curvature", &Material::yield_curvature)
      .def_readwrite("hardening", &Material::hardening)
      .def_readwrite("friction", &Material::friction)
      .def_readwrite("static_friction", &Material::static_friction)
      .def_readwrite("thickness", &Material::thickness)
      .def_readwrite("contact_stiffness", &Material::contact_stiffness)
      .def("validate", &Material::validate)
      .def_static("isotropic", &Material::isotropic)
      .def_static("orthotropic", &Material::orthotropic)
      .def_static("fabric", &Material::fabric)
      .def_static("fabric_names", &Material::fabric_names)
      .def_static("load", &Material::load)
      .def_static("parse", &Material::parse);
}

void bind_motion(py::module_ &m)
{
  py::class_<Motion> motion(m, "Motion");
  vector_property(motion, "velocity", &Motion::velocity);
  vector_property(motion, "rotation_rate", &Motion::rotation_rate);
  vector_property(motion, "oscillation", &Motion::oscillation);
  vector_property(motion, "center", &Motion::center);
  motion.def(py::init<>())
      .def(py::init<const Motion &>())
      .def_readwrite("period", &Motion::period)
      .def_readwrite("start", &Motion::start)
      .def_readwrite("stop", &Motion::stop)
      .def_property_readonly("is_static", &Motion::is_static)
      .def_property_readonly("is_rigid", &Motion::is_rigid)
      .def("add_key",
           [](Motion &o, double time, const std::array<double, 3> &translation, const std::array<double, 4> &rotation,
              double scale, const std::array<double, 3> &center) {
             o.keys.push_back({time, {to_vec(translation), rotation, scale, to_vec(center)}});
           })
      .def("set_samples",
           [](Motion &o, const Doubles &times, const Doubles &positions) { o.sampled = samples(times, positions); })
      .def("transform", [](Motion &o, const Matrix4 &matrix) { transform(o, matrix); })
      .def("evaluate", [](const Motion &o, double time, const Doubles &rest) {
        std::vector<dvec3> position;
        o.evaluate(time, to_vector<dvec3>(rest), position);
        return to_array<double>(std::move(position));
      });
  py::class_<Character>(m, "Character")
      .def_readwrite("mesh", &Character::mesh)
      .def_readwrite("motion", &Character::motion)
      .def_readonly("duration", &Character::duration);
  m.def("load_character", &load_character, py::call_guard<py::gil_scoped_release>());
}

void bind_parts(py::module_ &m)
{
  py::class_<Gas>(m, "Gas")
      .def(py::init<>())
      .def_readwrite("pressure", &Gas::pressure)
      .def_readwrite("volume", &Gas::volume)
      .def_readwrite("ambient", &Gas::ambient);
  py::class_<Cloth> cloth(m, "Cloth");
  vector_property(cloth, "velocity", &Cloth::velocity);
  cloth.def(py::init<>())
      .def(py::init<const Cloth &>())
      .def_readwrite("name", &Cloth::name)
      .def_readwrite("mesh", &Cloth::mesh)
      .def_readwrite("material", &Cloth::material)
      .def_readwrite("source", &Cloth::source)
      .def_readwrite("pressure", &Cloth::pressure)
      .def_readwrite("gas", &Cloth::gas)
      .def_property_readonly("enclosed_volume", &Cloth::enclosed_volume)
      .def_property(
          "shrinkage", [](const Cloth &c) { return to_array<double>(c.shrinkage); },
          [](Cloth &c, const Doubles &shrinkage) { c.shrinkage = to_vector<Shrinkage>(shrinkage); })
      .def_property_readonly("rest_corners",
                             [](const Cloth &c) {
                               std::vector<std::array<double, 6>> corners;
                               for (std::size_t f = 0; f < c.mesh.face.size(); ++f) {
                                 const auto u = c.rest_corners(f);
                                 corners.push_back({u[0][0], u[0][1], u[1][0], u[1][1], u[2][0], u[2][1]});
                               }
                               return to_array<double>(std::move(corners));
                             })
      .def_readwrite("material_scale", &Cloth::material_scale);
  auto rigid = py::class_<Rigid>(m, "Rigid")
                   .def(py::init<>())
                   .def(py::init<const Rigid &>())
                   .def_readwrite("mass", &Rigid::mass)
                   .def_readwrite("density", &Rigid::density)
                   .def_property(
                       "center",
                       [](const Rigid &r) {
                         return r.center ? py::object(py::tuple(py::cast(to_tuple(*r.center)))) : py::none();
                       },
                       [](Rigid &r, const std::optional<std::array<double, 3>> &v) {
                         r.center.reset();
                         if (v) r.center = to_vec(*v);
                       })
                   .def_readwrite("inertia", &Rigid::inertia);
  vector_property(rigid, "velocity", &Rigid::velocity);
  vector_property(rigid, "angular_velocity", &Rigid::angular_velocity);
  py::class_<Obstacle>(m, "Obstacle")
      .def(py::init<>())
      .def(py::init<const Obstacle &>())
      .def_readwrite("name", &Obstacle::name)
      .def_readwrite("mesh", &Obstacle::mesh)
      .def_readwrite("motion", &Obstacle::motion)
      .def_readwrite("rigid", &Obstacle::rigid)
      .def_readwrite("friction", &Obstacle::friction)
      .def_readwrite("static_friction", &Obstacle::static_friction)
      .def_property(
          "shape", [](const Obstacle &o) { return shape_names[static_cast<int>(o.shape)]; },
          [](Obstacle &o, const std::string &name) {
            for (int k = 0; k < 5; ++k)
              if (name == shape_names[k]) o.shape = static_cast<ObstacleShape>(k);
          })
      .def_readwrite("radius", &Obstacle::radius)
      .def_readwrite("thickness", &Obstacle::thickness)
      .def_readwrite("contact_stiffness", &Obstacle::contact_stiffness)
      .def_readwrite("source", &Obstacle::source);
  py::class_<Contact>(m, "Contact")
      .def_readwrite("enabled", &Contact::enabled)
      .def_readwrite("self", &Contact::self)
      .def_readwrite("thickness", &Contact::thickness)
      .def_readwrite("stiffness", &Contact::stiffness)
      .def_readwrite("friction", &Contact::friction)
      .def_readwrite("static_friction", &Contact::static_friction);
  py::class_<Wind> wind(m, "Wind");
  vector_property(wind, "velocity", &Wind::velocity);
  wind.def(py::init<>()).def_readwrite("density", &Wind::density).def_readwrite("drag", &Wind::drag);
}

}  // namespace

void bind_scene(py::module_ &m)
{
  bind_mesh(m);
  bind_material(m);
  bind_motion(m);
  bind_parts(m);
  py::class_<Scene> scene(m, "Scene");
  vector_property(scene, "gravity", &Scene::gravity);
  // Elements are returned as references into vectors that add_* may move: callers use them at once and do not keep
  // them.
  const auto inside = py::return_value_policy::reference_internal;
  scene.def(py::init<>())
      .def(py::init<const Scene &>())
      .def_static("load", &Scene::load, py::call_guard<py::gil_scoped_release>())
      .def_static("parse", &Scene::parse, py::call_guard<py::gil_scoped_release>())
      .def("save", &Scene::save)
      .def("validate", &Scene::validate)
      .def_readwrite("name", &Scene::name)
      .def_readwrite("description", &Scene::description)
      .def_readwrite("time_step", &Scene::time_step)
      .def_readwrite("frame_time", &Scene::frame_time)
      .def_property_readonly("seconds_per_frame", &Scene::seconds_per_frame)
      .def_readwrite("frames", &Scene::frames)
      .def_readwrite("wind", &Scene::wind)
      .def_readwrite("options", &Scene::options)
      .def_property_readonly(
          "contact", [](Scene &s) -> Contact & { return s.contact; }, inside)
      .def_property_readonly("cloth_count", [](const Scene &s) { return s.cloths.size(); })
      .def_property_readonly("obstacle_count", [](const Scene &s) { return s.obstacles.size(); })
      .def_property_readonly("stitch_count", [](const Scene &s) { return s.stitches.size(); })
      .def_property_readonly("cloth_vertex_count", &Scene::cloth_vertex_count)
      .def_property_readonly("cloth_triangle_count", &Scene::cloth_triangle_count)
      .def(
          "cloth", [](Scene &s, std::size_t i) -> Cloth & { return s.cloths.at(i); }, inside)
      .def(
          "obstacle", [](Scene &s, std::size_t i) -> Obstacle & { return s.obstacles.at(i); }, inside)
      .def("pins",
           [](const Scene &s) {
             py::list rows;
             for (const Pin &p : s.pins)
               rows.append(py::make_tuple(p.cloth, to_array<int>(p.vertices), p.obstacle, p.release));
             return rows;
           })
      .def("add_cloth",
           [](Scene &s, const Cloth &c) {
             s.cloths.push_back(c);
             return s.cloths.size() - 1;
           })
      .def("add_obstacle",
           [](Scene &s, const Obstacle &o) {
             s.obstacles.push_back(o);
             return s.obstacles.size() - 1;
           })
      .def("add_pin",
           [](Scene &s, int cloth, const Ints &vertices, const Motion &motion, std::optional<int> obstacle,
              double release) { s.pins.push_back({cloth, to_vector<int>(vertices), motion, obstacle, release}); })
      .def("add_stitch",
           [](Scene &s, int cloth_a, int vertex_a, int cloth_b, int vertex_b, int vertex_c, double ratio,
              double stiffness) {
             s.stitches.push_back({cloth_a, vertex_a, cloth_b, vertex_b, vertex_c, ratio, stiffness});
           })
      .def("add_elastic", [](Scene &s, int cloth, const Ints &vertices, double share,
                             double stiffness) { s.add_elastic(cloth, to_vector<int>(vertices), share, stiffness); })
      .def("add_crease", [](Scene &s, int cloth, const Ints &vertices,
                            double angle) { s.creases.push_back({cloth, to_vector<int>(vertices), angle}); })
      .def("vertices_along",
           [](const Scene &s, int cloth, const std::array<double, 3> &from, const std::array<double, 3> &to) {
             return to_array<int>(s.vertices_along(cloth, to_vec(from), to_vec(to)));
           });
}

}  // namespace cama::python
