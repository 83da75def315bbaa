// SPDX-License-Identifier: Apache-2.0
// The cost of each feature of a scene: medians of steps of the scene without it and with it, taken alternately. One CSV
// row per feature.
//   build/benchmarks/features [CELLS [STEPS [BACKEND]]]
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <string>
#include <vector>

#include "cama/simulation.hpp"

using namespace cama;

namespace {

Mesh grid(int cells, double side, const dvec3 &corner)
{
  Mesh m;
  for (int j = 0; j <= cells; ++j)
    for (int i = 0; i <= cells; ++i)
      m.position.push_back({corner.x + side * i / cells, corner.y + side * j / cells, corner.z});
  for (int j = 0; j < cells; ++j)
    for (int i = 0; i < cells; ++i) {
      const int a = j * (cells + 1) + i, b = a + 1, c = a + cells + 1, d = c + 1;
      m.face.insert(m.face.end(), {{a, b, d}, {a, d, c}});
    }
  return m;
}

Material fabric(double bending = 0) { return Material::isotropic(200, 0.3, bending, 0.15); }

/// A sheet of 0.5 m that hangs by two corners.
Scene hanging(int cells)
{
  Scene s;
  s.time_step = 1.0 / 200;
  s.contact.enabled = s.contact.self = false;
  Cloth cloth;
  cloth.name = "sheet";
  cloth.mesh = grid(cells, 0.5, {-0.25, -0.25, 0});
  cloth.material = fabric();
  s.cloths.push_back(std::move(cloth));
  Pin pin;
  pin.vertices = {0, cells};
  s.pins.push_back(pin);
  return s;
}

/// The same sheet on the ground, slightly wavy, without friction.
Scene lying(int cells)
{
  Scene s = hanging(cells);
  for (dvec3 &x : s.cloths[0].mesh.position) x.z += 4e-4 * std::sin(40 * x.x) * std::cos(30 * x.y);
  s.pins.clear();
  s.contact.enabled = true;
  s.contact.thickness = 2e-3;
  Obstacle ground = exact_plane({0, 0, -1.5e-3}, {0, 0, 1});
  ground.name = "ground";
  ground.friction = 0;
  s.obstacles.push_back(std::move(ground));
  return s;
}

void add_far(Scene &s, const dvec3 &velocity)
{
  Obstacle o;
  o.name = "far";
  o.mesh = grid(100, 2, {10, 10, -5});  // 20,000 triangles
  o.motion.velocity = velocity;
  s.obstacles.push_back(std::move(o));
}

struct Feature {
  const char *name;
  std::function<Scene(int)> base;
  std::function<void(Scene &)> add;
  std::function<void(Options &)> set;
};

const std::vector<Feature> features = {
    {"nothing", hanging, [](Scene &) {}, {}},
    {"bending", hanging, [](Scene &s) { s.cloths[0].material = fabric(1e-5); }, {}},
    {"damping", hanging, [](Scene &s) { s.cloths[0].material.damping = 0.01; }, {}},
    {"mass damping", hanging, [](Scene &s) { s.cloths[0].material.mass_damping = 1; }, {}},
    {"table of stiffness",
     hanging,
     [](Scene &s) {
       for (std::size_t k = 1; k < 6; ++k) s.cloths[0].material.stretching[k][0] *= 1.0 + 0.05 * static_cast<double>(k);
     },
     {}},
    {"wind", hanging, [](Scene &s) { s.wind = Wind{{2, 0, 0}, 1.2, 0}; }, {}},
    {"a stitch", hanging, [](Scene &s) { s.stitches.push_back({0, 5, 0, 9, 9, 0, 10}); }, {}},
    {"contact with a plane that is not touched",
     hanging,
     [](Scene &s) {
       s.contact.enabled = true;
       s.obstacles.push_back(exact_plane({0, 0, -5}, {0, 0, 1}));
       s.obstacles.back().name = "ground";
     },
     {}},
    {"a mesh at rest, not touched",
     hanging,
     [](Scene &s) {
       s.contact.enabled = true;
       add_far(s, {0, 0, 0});
     },
     {}},
    {"a mesh that moves, not touched",
     hanging,
     [](Scene &s) {
       s.contact.enabled = true;
       add_far(s, {0, 0, 0.1});
     },
     {}},
    {"cloth against cloth, not touched", hanging, [](Scene &s) { s.contact.enabled = s.contact.self = true; }, {}},
    {"a mesh at rest beside contact", lying, [](Scene &s) { add_far(s, {0, 0, 0}); }, {}},
    {"cloth against cloth beside contact", lying, [](Scene &s) { s.contact.self = true; }, {}},
    {"friction", lying, [](Scene &s) { s.obstacles[0].friction = 0.3; }, {}},
    {"guarantee", lying, [](Scene &) {}, [](Options &o) { o.commit = true; }},
};

double median(std::vector<double> values)
{
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

struct Side {
  Side(const Scene &scene, const Options &options) : simulation(scene, options) {}
  void step()
  {
    simulation.step();
    milliseconds.push_back(simulation.report().milliseconds);
    launches.push_back(static_cast<double>(simulation.report().launches));
    iterations.push_back(simulation.report().iterations);
  }
  double blocks() const
  {
    for (const StreamInfo &s : simulation.streams())
      if (std::string(s.name) == "block") return static_cast<double>(s.size);
    return 0;
  }
  Simulation simulation;
  std::vector<double> milliseconds, launches, iterations;
};

}  // namespace

int main(int argc, char **argv)
{
  const int cells = argc > 1 ? std::atoi(argv[1]) : 64, steps = argc > 2 ? std::atoi(argv[2]) : 40, warm = 8;
  std::printf(
      "feature,triangles,ms_without,ms_with,ms_ratio,launches_without,launches_with,iterations_without,iterations_"
      "with,mib_without,mib_with,"
      "blocks_a_row_without,blocks_a_row_with\n");
  for (const Feature &term : features) {
    Options options = Options::at(Accuracy::production);
    options.threads = 1;
    if (argc > 3) options.backend = argv[3];
    Scene scene = term.base(cells);
    Options with_options = options;
    if (term.set) {
      options.commit = false;
      term.set(with_options);
    }
    Side without(scene, options);
    term.add(scene);
    Side with(scene, with_options);
    for (int i = 0; i < warm + steps; ++i) {
      without.step();
      with.step();
    }
    for (Side *s : {&without, &with})
      for (std::vector<double> *v : {&s->milliseconds, &s->launches, &s->iterations})
        v->erase(v->begin(), v->begin() + warm);
    const double rows = without.simulation.cloth_vertex_count(), mib = 1.0 / (1 << 20);
    const double a = median(without.milliseconds), b = median(with.milliseconds);
    std::printf("%s,%d,%.3f,%.3f,%.3f,%.0f,%.0f,%.0f,%.0f,%.2f,%.2f,%.2f,%.2f\n", term.name,
                without.simulation.cloth_triangle_count(), a, b, b / a, median(without.launches), median(with.launches),
                median(without.iterations), median(with.iterations),
                static_cast<double>(without.simulation.peak_memory_bytes()) * mib,
                static_cast<double>(with.simulation.peak_memory_bytes()) * mib, without.blocks() / rows,
                with.blocks() / rows);
    std::fflush(stdout);
  }
}
