/* SPDX-License-Identifier: Apache-2.0 */
/* The kernels that exist once per precision: `real` and ATOMIC_ADD_REAL are defined by whoever includes this. */
#include "vec3.h"
#include "elasticity.h"
#include "bending.h"
#include "external.h"
#include "term.h"
#include "assembly.h"
#include "solver.h"
#include "conjugate_gradient.h"
#include "factors.h"
#include "schwarz.h"
#include "newton.h"
