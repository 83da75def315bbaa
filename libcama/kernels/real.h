/* SPDX-License-Identifier: Apache-2.0 */
/* The kernels that exist once per precision: the file that includes this defines `real` and ATOMIC_ADD_REAL. */
#include "dialect/vec3.h"
#include "elements/bending.h"
#include "elements/elasticity.h"
#include "elements/external.h"
#include "elements/plasticity.h"
#include "elements/plate.h"
#include "solver/conjugate_gradient.h"
#include "solver/factors.h"
#include "solver/gas_operator.h"
#include "solver/packing.h"
#include "solver/schwarz.h"
#include "system/abrupt.h"
#include "system/assembly.h"
#include "system/linear_system.h"
#include "system/newton.h"
#include "system/reactions.h"
#include "system/term.h"

/* The next precision includes the same headers again. */
#undef CAMA_KERNELS_DIALECT_VEC3_H
#undef CAMA_KERNELS_ELEMENTS_ELASTICITY_H
#undef CAMA_KERNELS_ELEMENTS_BENDING_H
#undef CAMA_KERNELS_ELEMENTS_EXTERNAL_H
#undef CAMA_KERNELS_ELEMENTS_PLATE_H
#undef CAMA_KERNELS_ELEMENTS_PLASTICITY_H
#undef CAMA_KERNELS_SYSTEM_TERM_H
#undef CAMA_KERNELS_SYSTEM_ABRUPT_H
#undef CAMA_KERNELS_SYSTEM_ASSEMBLY_H
#undef CAMA_KERNELS_SYSTEM_LINEAR_SYSTEM_H
#undef CAMA_KERNELS_SOLVER_CONJUGATE_GRADIENT_H
#undef CAMA_KERNELS_SOLVER_FACTORS_H
#undef CAMA_KERNELS_SOLVER_GAS_OPERATOR_H
#undef CAMA_KERNELS_SOLVER_PACKING_H
#undef CAMA_KERNELS_SOLVER_SCHWARZ_H
#undef CAMA_KERNELS_SYSTEM_NEWTON_H
#undef CAMA_KERNELS_SYSTEM_REACTIONS_H
