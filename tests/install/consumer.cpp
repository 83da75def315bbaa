// SPDX-License-Identifier: Apache-2.0
// One triangle in free fall, through the installed headers: z = -g dt^2 (n^2 / 2 + 3/4 (1 - 3^-n)) for BDF2
// after one step of backward Euler.
#include <cmath>
#include <cstdio>

#include "cama/simulation.hpp"

int main()
{
  cama::Scene scene;
  scene.time_step = 1.0 / 200;
  cama::Cloth cloth;
  cloth.name = "triangle";
  cloth.mesh.position = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  cloth.mesh.face = {{0, 1, 2}};
  cloth.material = cama::Material::fabric("cotton");
  scene.cloths.push_back(cloth);
  cama::Simulation simulation(scene);
  for (int i = 0; i < 10; ++i) simulation.step();
  const double z = simulation.positions()[0].z,
               exact = -9.81 * scene.time_step * scene.time_step * (50 + 0.75 * (1 - std::pow(3.0, -10)));
  std::printf("z = %.12f, exact %.12f\n", z, exact);
  return std::abs(z - exact) < 1e-12 ? 0 : 1;
}
