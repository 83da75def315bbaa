# SPDX-License-Identifier: Apache-2.0
"""How wrong a simulation is, in numbers: every measure of docs/accuracy.md.

    reference = cama.accuracy.reference("drape")                          # converged, on the same mesh
    error = cama.accuracy.restart_error(reference, "drape", tolerance=1e-2)
    print(error.rms_edges, error.uncertainty)

Cloth buckles: trajectories that start alike part within a second whatever the settings. Errors of position are therefore taken over short
windows that start from the reference's states. Lengths in m; extra `accuracy` (scipy) of the package is needed for surfaces.
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
