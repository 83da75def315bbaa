// SPDX-License-Identifier: Apache-2.0
// The compliance of a cloth in bending: moments at hinges against the angles of hinges.
#pragma once
#include <array>
#include <vector>

#include "model/topology.hpp"

namespace cama {

/// The hinge's row of the compliance, scaled to a diagonal of ones; hinge_coupling of kernels/elements/plate.h.
struct HingeCoupling {
  std::array<int, 4> neighbour;
  int cloth = 0;
  std::array<double, 4> coupling{};
  double scale = 0, bound = 0, reference = 0;
};

/// Chebyshev's iteration for the moments of a cloth: the eigenvalues of the scaled compliance between which it is made,
/// and its length.
struct MomentIteration {
  double least = 0.3, largest = 2;
  int count = 0;
};

struct Plate {
  std::vector<HingeCoupling> hinge;
  std::vector<int> side;  // [hinges] 1 or -1: the angle's sign on one side of the cloth
  std::vector<std::array<int, 3>> opposite;  // [triangles] the hinge opposite each corner; -1: none
  std::vector<MomentIteration> iteration;  // [cloths]; of length 0 without hinges
};

/// A step of it, moment_step of kernels/elements/plate.h.
struct MomentStep {
  double momentum = 0, share = 0;
};

/// [longest iteration + 1][cloths]: the share that the moments begin with, then the steps.
std::vector<std::vector<MomentStep>> moment_steps(const std::vector<MomentIteration> &iteration);

/// The bending stiffness of a plate, N m: moments are D11 c11 + D12 c22, D12 c11 + D22 c22 and D33 c12 for the
/// curvatures c along the warp, along the weft and of the twist.
struct PlateStiffness {
  double d11, d12, d22, d33;
};

/// From the hinge stiffnesses of the unstrained material, at a fifth each, and its Poisson ratio.
PlateStiffness plate_stiffness(const Material &material);

/// What plastic bending needs of the plate: plastic_triangle and plastic_hinge of kernels/elements/plasticity.h.
struct PlasticTriangle {
  std::array<int, 3> hinge;
  std::array<std::array<double, 3>, 3> curvature;
};
struct PlasticHinge {
  std::array<std::array<double, 3>, 2> angle;
};
struct PlasticPlate {
  std::vector<PlasticTriangle> triangle;
  std::vector<PlasticHinge> hinge;
};

PlasticPlate plastic_plate(const Scene &scene, const Topology &t, const Plate &plate);

Plate couple_hinges(const Scene &scene, const Topology &t);

}  // namespace cama
