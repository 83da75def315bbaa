# SPDX-License-Identifier: Apache-2.0
"""A patch on slopes near the angle of friction: what holds, what slides, and how it accelerates beside a block.

    python benchmarks/friction_angle.py [--degrees 10] [--seconds 3] [--step 0.00416667]

Rows of CSV: cells of the slope along each side, degrees by which the patch is turned on it, its speed at the start, the
coefficient as a share of the slope's tangent, how far the patch moved, its speed at the end, and its acceleration in
the last quarter, in parts of g sin(slope), beside that of a block.
"""

import argparse
import math

import numpy as np

import cama

GRAVITY, THICKNESS, DEPTH = 9.81, 1e-3, 0.9e-6  # m/s^2, m, m: by the last the weight presses the penalty


def grid(cells, size):
    """Vertices [n, 3] and faces [m, 3] of a square of triangles around the origin."""
    line = np.linspace(-size / 2, size / 2, cells + 1)
    u, v = np.meshgrid(line, line)
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + cells + 2], 1),
            np.stack([corner, corner + cells + 2, corner + cells + 1], 1),
        ]
    )
    return np.stack([u.ravel(), v.ravel(), 0 * u.ravel()], 1), faces


def slide(degrees, share, cells, turn, speed, seconds, step):
    """Distance, m, speed at the end, m/s, and acceleration in the last quarter, in parts of g sin(slope)."""
    angle, turned = math.radians(degrees), math.radians(turn)
    frame = np.array([[math.cos(angle), 0, -math.sin(angle)], [0, 1, 0], [math.sin(angle), 0, math.cos(angle)]])
    patch, faces = grid(10, 0.05)
    turning = [[math.cos(turned), math.sin(turned), 0], [-math.sin(turned), math.cos(turned), 0], [0, 0, 1]]
    patch = (patch @ turning + [0.0123, 0.0177, THICKNESS - DEPTH]) @ frame
    scene = cama.Scene(thickness=THICKNESS)
    scene.add_cloth(patch, faces, material="cotton", velocity=tuple(speed * frame[0]))
    plane, triangles = grid(cells, 2)
    scene.add_obstacle(plane @ frame, triangles, name="slope", friction=share * math.tan(angle))
    simulation = cama.Simulation(
        scene, time_step=step, integrator="bdf2", newton_iterations=2, tolerance=1e-3, backend="cpu", threads=1
    )
    n, steps = simulation.cloth_vertex_count, round(seconds / step)
    start = (simulation.positions[:n] @ frame[0]).mean()
    simulation.step(steps - steps // 4)
    before = (simulation.velocities[:n] @ frame[0]).mean()
    simulation.step(steps // 4)
    end = (simulation.velocities[:n] @ frame[0]).mean()
    pull = GRAVITY * math.sin(angle) * step * (steps // 4)
    return (simulation.positions[:n] @ frame[0]).mean() - start, end, (end - before) / pull


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--degrees", type=float, default=10)
    parser.add_argument("--seconds", type=float, default=3)
    parser.add_argument("--step", type=float, default=1 / 240, help="s")
    given = parser.parse_args()
    print("cells,turned,starts_at,share,moved_mm,end_speed_mm_s,acceleration,block")
    for cells, turn in ((1, 0), (80, 0), (80, 17), (80, 45)):
        for speed, shares in ((0.0, (1.003, 1.001, 0.999, 0.997, 0.99)), (0.1, (0.95, 0.5))):
            for share in shares:
                seconds = given.seconds if speed == 0 else 0.3  # in motion: before it leaves the slope
                moved, end, acceleration = slide(given.degrees, share, cells, turn, speed, seconds, given.step)
                print(
                    f"{cells},{turn},{speed},{share},{1e3 * moved:.4f},{1e3 * end:.4f},{acceleration:.5f},"
                    f"{max(0.0, 1 - share):.3f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
