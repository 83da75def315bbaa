// SPDX-License-Identifier: Apache-2.0
// A cotton sheet falls on a ball, from C++. Ends with 0 if the sheet touches the ball and nothing intersects.
#include <algorithm>
#include <cstdio>

#include "cama/error.hpp"
#include "cama/generators.hpp"
#include "cama/simulation.hpp"

int main()
{
  try {
    // What to simulate. Lengths in m, masses in kg, times in s; z is up.
    const double radius = 0.25;
    cama::Scene scene;
    scene.name = "ball";
    scene.time_step = 1.0 / 240;
    scene.contact.thickness = 1.5e-3;

    cama::Cloth sheet;
    sheet.name = "sheet";
    sheet.mesh = cama::make_grid(1, 1, 500).mesh;   // 1 m x 1 m around the origin, about 500 triangles
    for (cama::dvec3 &x : sheet.mesh.position) x.z = radius + 0.01;
    sheet.material = cama::Material::fabric("cotton");
    scene.cloths.push_back(sheet);

    scene.obstacles.push_back(cama::exact_sphere({0, 0, 0}, radius));
    scene.obstacles.back().name = "ball";

    // How to compute it: the defaults are those of the accuracy level `production`. Throws if the scene is wrong.
    cama::Simulation simulation(scene);
    int intersections = 0;
    for (int i = 0; i < 200; ++i) {
      simulation.step();
      if (i % 10 == 9) intersections += simulation.count_intersections();
    }

    // Contacts of the last step: pairs of features that touch, with their distance.
    const cama::ContactArrays contacts = simulation.contacts();
    double closest = scene.contact.thickness;
    for (const double distance : contacts.distance) closest = std::min(closest, distance);

    std::printf("triangles: %d\n", simulation.cloth_triangle_count());
    std::printf("time: %.3f s\n", simulation.time());
    std::printf("contacts: %zu, closest: %.3f mm\n", contacts.distance.size(), closest * 1e3);
    std::printf("intersections: %d\n", intersections);
    return intersections == 0 && !contacts.distance.empty() && closest > 0 ? 0 : 1;
  } catch (const cama::Error &problem) {   // every error of the library; its text says what to do
    std::fprintf(stderr, "%s\n", problem.what());
    return 2;
  }
}
