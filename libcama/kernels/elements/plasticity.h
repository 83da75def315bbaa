/* SPDX-License-Identifier: Apache-2.0 */
/* Plastic bending of the plate: a triangle keeps the curvature beyond the yield curvature, and the angles at rest
   follow (docs/theory/elasticity.md; Gingold et al. 2004, Narain et al. 2013). Curvatures are (11, 22, 2 12) along warp
   and weft, 1/m. */
#ifndef CAMA_KERNELS_ELEMENTS_PLASTICITY_H
#define CAMA_KERNELS_ELEMENTS_PLASTICITY_H
#include "bending.h"

typedef struct {
  double yield_curvature; /* 1/m; 0: none */
  double hardening;       /* share of the bending stiffness that is left beyond it, in [0, 1) */
} plastic_material;

typedef struct {
  int material;
  int hinge[3];           /* opposite its corners; -1: none */
  double curvature[3][3]; /* elastic curvature for the scaled moment of each hinge over its scale */
} plastic_triangle;

typedef struct {
  int triangle[2];
  double rest_angle;  /* before any yielding */
  double angle[2][3]; /* for the plastic curvature of each triangle, m */
} plastic_hinge;

/* The plastic curvature after the closest-point projection onto the yield surface |elastic - back| = yield in the norm
   of tensors; the back curvature is that of linear kinematic hardening. */
DEVICE dvec3 return_curvature(dvec3 elastic, dvec3 plastic, plastic_material m)
{
  dvec3 beyond = daxpy(elastic, -m.hardening / (1.0 - m.hardening), plastic);
  double size = sqrt(beyond.x * beyond.x + beyond.y * beyond.y + 0.5 * beyond.z * beyond.z);
  if (!(m.yield_curvature > 0.0) || !(size > m.yield_curvature)) return plastic;
  return daxpy(plastic, (1.0 - m.hardening) * (1.0 - m.yield_curvature / size), beyond);
}

/* Plastic curvature [n] of all triangles from the moments that fit the angles (plate.h), and their scales. */
KERNEL yield_triangles(int n, GLOBAL const plastic_triangle *triangle, GLOBAL const plastic_material *material,
                       GLOBAL const real *scales, GLOBAL const real *moment, GLOBAL const dvec3 *plastic,
                       GLOBAL dvec3 *plastic_next)
{
  FOR_EACH(i, n) {
    plastic_triangle t = triangle[i];
    dvec3 elastic = dvec3_make(0.0, 0.0, 0.0);
    int k;
    for (k = 0; k < 3; ++k)
      if (t.hinge[k] >= 0 && scales[t.hinge[k]] > (real)0)
        elastic = daxpy(elastic, (double)moment[t.hinge[k]] / (double)scales[t.hinge[k]],
                        dvec3_make(t.curvature[k][0], t.curvature[k][1], t.curvature[k][2]));
    plastic_next[i] = return_curvature(elastic, plastic[i], material[t.material]);
  }
}

#define FOLDED 3.1 /* largest angle at rest: beyond a half turn the hinge would turn to the other side */

/* The angles at rest of all hinges for the plastic curvature of their triangles. */
KERNEL set_rest_angles(int n, GLOBAL const plastic_hinge *hinge, GLOBAL const dvec3 *plastic, GLOBAL hinge_rest *rest)
{
  FOR_EACH(i, n) {
    plastic_hinge h = hinge[i];
    double angle = h.rest_angle;
    int k;
    for (k = 0; k < 2; ++k) {
      dvec3 c = plastic[h.triangle[k]];
      angle += h.angle[k][0] * c.x + h.angle[k][1] * c.y + h.angle[k][2] * c.z;
    }
    rest[i].rest_angle = (real)max_double(-FOLDED, min_double(angle, FOLDED));
  }
}

#endif
