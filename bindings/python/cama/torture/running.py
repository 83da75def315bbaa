# SPDX-License-Identifier: Apache-2.0
"""Checks of how runs go on: lists that grow, solves that fail, memory that runs out, restarts, threads."""

import sys
import tempfile
from pathlib import Path

import numpy as np

import cama

from . import shapes
from .meshes import cloth_scene


def stack(sheets=4, triangles=60, gap=2e-3):
    """Sheets above each other over a floor."""
    scene = cama.Scene(thickness=1.5e-3, time_step=1 / 200)
    scene.add_obstacle(shape={"plane": {"size": [1, 1], "triangles": 8}}, name="floor", translate=(0.0131, 0.0177, 0))
    random = np.random.default_rng(5)
    for k in range(sheets):
        vertices, faces = shapes.sheet(0.2, 0.2, triangles)
        scene.add_cloth(
            vertices @ shapes.rotation((0, 0, 1), random.uniform(-0.2, 0.2)).T + [0, 0, 2e-3 + gap * k], faces
        )
    return scene


def lists_from_nothing(p):
    """Contacts by the hundred after none: the same bits as with lists that were large before."""
    scene = stack()
    options = dict(preconditioner="block_jacobi", precision="double" if p.precision == "mixed" else p.precision)
    simulation = p.simulation(scene, **options)
    start = simulation.positions[: simulation.cloth_vertex_count]
    low, still = start.copy(), np.zeros_like(start)
    low[:, 2] = 1e-3 + 0.4 * (low[:, 2] - low[:, 2].min())
    high = start + [0, 0, 50]
    used = p.simulation(scene, **options)
    used.set_state(low, still)
    p.run(used, 1)
    grown = used.report["contacts"]
    p.run(used, 2)
    results = []
    for s in (used, simulation):
        s.set_state(high * [3, 3, 1], still)
        p.run(s, 1)
        none = s.report["contacts"]
        s.set_state(low, still)
        p.run(s, 3)
        results.append(s.state_hash)
    p.seen.note = f"{none} contacts, then {grown}"
    p.require(none == 0 and grown > 100, p.seen.note)
    p.require(results[0] == results[1], f"{results[1]} from small lists, {results[0]} from large ones")


def _capped(p, iterations):
    """Five steps of a stiff sheet with so many iterations a step; a residual above the tolerance must say that they
    were not enough.
    """
    vertices, faces = shapes.sheet(0.2, 0.2, 200)
    scene, cloth = cloth_scene(vertices, faces, material=cama.Material.isotropic(1e6, 0.3, 1e-3, 0.2))
    scene.pin(cloth, [0])
    simulation = p.run(scene, 5, max_iterations=iterations, tolerance=1e-10)
    residual = simulation.report["residual"]
    p.seen.note = f"residual {residual:.2g} after {simulation.report['iterations']} iterations"
    p.require(residual > 1e-10, f"not flagged: {p.seen.note}")


def solve_cap(p):
    _capped(p, 5)


def solve_cap_of_one(p):
    _capped(p, 1)


def out_of_memory(p):
    """Address space runs out in a step: DeviceMemoryError, the state stays, and a later step gives the bits of a run
    that had enough.

    In a fresh process: memory that an earlier run gave back to the allocator would do for the step.
    """
    if not sys.platform.startswith("linux"):
        p.seen.note = "needs RLIMIT_AS"
        return
    import resource

    scene = stack(6, 3000)
    simulation = p.simulation(scene)
    before = simulation.state_hash
    with open("/proc/self/statm", encoding="ascii") as file:
        used = int(file.read().split()[0]) * resource.getpagesize()
    limits = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (used + (1 << 20), limits[1]))
    try:
        p.refused(cama.DeviceMemoryError, ["memory"], simulation.step, "one MiB left")
    finally:
        resource.setrlimit(resource.RLIMIT_AS, limits)
    p.require(simulation.state_hash == before and simulation.step_count == 0, "the state changed")
    p.run(simulation, 1)
    p.require(simulation.state_hash == p.run(scene, 1).state_hash, "another state than with enough memory")


def _restarted(p, scene, steps, **options):
    """Hashes of a run of 2 x steps, and of one that takes it over half way through from its checkpoint."""
    whole = p.run(scene, steps, **options)
    second = p.simulation(scene, **options)
    with tempfile.TemporaryDirectory() as folder:
        whole.save_checkpoint(Path(folder) / "checkpoint.h5")
        second.load_checkpoint(folder)
    p.run(whole, steps)
    p.run(second, steps)
    p.near(second.positions, whole.positions, p.per_precision(1e-2, 1e-2, 1e-2), "restarted run")
    return whole.state_hash, second.state_hash


def restart(p):
    """Without contact: a run goes on bit by bit."""
    vertices, faces = shapes.sheet(0.2, 0.2, 60)
    scene, cloth = cloth_scene(vertices, faces, contact=False)
    scene.pin(cloth, [0])
    whole, second = _restarted(p, scene, 20)
    p.require(whole == second, f"{second} after the restart, {whole} without")


def restart_in_contact(p):
    """With contact, by default options."""
    whole, second = _restarted(p, stack(), 10)
    p.require(whole == second, f"{second} after the restart, {whole} without")


def restart_in_contact_block_jacobi(p):
    """With contact and a preconditioner that keeps nothing."""
    whole, second = _restarted(
        p, stack(), 10, preconditioner="block_jacobi", precision="double" if p.precision == "mixed" else p.precision
    )
    p.require(whole == second, f"{second} after the restart, {whole} without")


def thread_counts(p):
    """1, 2, 7 and 64 threads: the same bits."""
    hashes = {n: p.run(stack(), 10, threads=n).state_hash for n in (1, 2, 7, 64)}
    p.require(len(set(hashes.values())) == 1, f"hashes {hashes}")


def same_as_cpu(p):
    """The same bits as on the CPU."""
    here = p.run(stack(), 10).state_hash
    there = p.run(stack(), 10, backend="cpu").state_hash
    p.require(here == there, f"{here} here, {there} on the CPU")
