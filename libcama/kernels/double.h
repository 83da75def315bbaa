/* SPDX-License-Identifier: Apache-2.0 */
/* The kernels that exist once, all in double: geometry, collision, motion. Order matters; lang.h and dvec3.h come before. */
#include "scalars.h"
#include "incidence.h"
#include "motion.h"
#include "distance.h"
#include "ccd.h"
#include "bounds.h"
#include "tree.h"
#include "query.h"
#include "contact.h"
#include "impact.h"
#include "commit.h"
#include "measure.h"
