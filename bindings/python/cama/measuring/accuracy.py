# SPDX-License-Identifier: Apache-2.0
"""Error measures of simulations.

    reference = cama.accuracy.reference("drape")                          # converged, on the same mesh
    error = cama.accuracy.restart_error(reference, "drape", tolerance=1e-2)
    print(error.rms_edges, error.uncertainty)

Cloth buckles: trajectories that start equal separate within a second, whatever the options. Position errors are
therefore measured over short windows that start from states of the reference. Lengths are in m. Measures of surfaces
need SciPy, which the extra `tradeoff` of the package installs.
"""

from .motion import (
    Drift,
    PositionError,
    accelerations,
    angular_momentum,
    drift,
    friction_angle,
    momentum,
    nonlinear_residual,
    position_error,
    residual_speed,
)
from .reference import Reference, RestartError, reference, restart_error, start_times
from .surface import (
    Strain,
    SurfaceDistance,
    distance_to_surface,
    drape_coefficient,
    edge_length,
    missed_contacts,
    rest_shapes,
    shadow_area,
    smallest_gap,
    strain,
    surface_distance,
)

__all__ = [
    "Drift",
    "PositionError",
    "Reference",
    "RestartError",
    "Strain",
    "SurfaceDistance",
    "accelerations",
    "angular_momentum",
    "distance_to_surface",
    "drape_coefficient",
    "drift",
    "edge_length",
    "friction_angle",
    "missed_contacts",
    "momentum",
    "nonlinear_residual",
    "position_error",
    "reference",
    "residual_speed",
    "rest_shapes",
    "restart_error",
    "shadow_area",
    "smallest_gap",
    "start_times",
    "strain",
    "surface_distance",
]
