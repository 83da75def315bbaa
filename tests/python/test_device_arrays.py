# SPDX-License-Identifier: Apache-2.0
"""Arrays shared with other libraries on the host: views, what they show after steps, lifetimes, inputs, errors."""

import gc
import threading
import time

import numpy as np
import pytest

import cama
from conftest import grid

STEP = 1 / 200


def scene(cells=6):
    made = cama.Scene(time_step=STEP)
    made.add_cloth(*grid(cells, 0.3, 0.12), name="sheet", material="cotton")
    made.add_obstacle(shape={"sphere": {"radius": 0.1, "triangles": 80}}, name="ball")
    return made


def simulate(**options):
    return cama.Simulation(scene(), **{"backend": "cpu", "accuracy": "interactive", "time_step": STEP, **options})


def address(array):
    return array.__array_interface__["data"][0]


class Foreign:
    """An array of a library that knows DLPack and nothing else."""

    def __init__(self, values, version=(1, 0), device=(1, 0)):
        self.values, self.version, self.device = np.asarray(values), version, device

    def __dlpack_device__(self):
        return self.device

    def __dlpack__(self, *, stream=None, max_version=None, **others):
        return self.values.__dlpack__(max_version=max_version)


def test_numpy_reads_the_memory_of_the_simulation():
    simulation = simulate()
    simulation.step(2)
    for array in (np.asarray(simulation.device_positions), np.from_dlpack(simulation.device_positions)):
        np.testing.assert_array_equal(array, simulation.positions)
        assert array.dtype == np.float64 and array.shape == (simulation.vertex_count, 3)
        assert not array.flags.writeable
        assert address(array) == address(np.asarray(simulation.device_positions)), "copied"
    np.testing.assert_array_equal(simulation.device_velocities, simulation.velocities)
    given = simulation.device_positions
    assert len(given) == simulation.vertex_count and given.device == "cpu" and given.dtype == np.float64
    assert given.__dlpack_device__() == (1, 0) and not hasattr(given, "__cuda_array_interface__")
    assert repr(given) == f"<cama.DeviceArray [{simulation.vertex_count}, 3] float64 on cpu>"
    assert np.asarray(given, dtype=np.float32).dtype == np.float32
    assert address(given.numpy()) == address(np.asarray(given))


def test_an_array_shows_the_moment_at_which_it_was_taken():
    simulation, undisturbed = simulate(), simulate()
    arrays, moments = [], []
    for _ in range(5):
        arrays.append((np.asarray(simulation.device_positions), np.from_dlpack(simulation.device_velocities)))
        moments.append((simulation.positions, simulation.velocities))
        simulation.step()
        undisturbed.step()
        assert simulation.state_hash == undisturbed.state_hash
    for array, moment in zip(arrays, moments):
        np.testing.assert_array_equal(array, moment)
    taken = np.asarray(simulation.device_positions)
    before = taken.copy()
    cloth = simulation.cloth_vertex_count
    simulation.set_state(simulation.positions[:cloth] + [0, 0, 0.5], simulation.velocities[:cloth])
    np.testing.assert_array_equal(taken, before)
    assert (np.asarray(simulation.device_positions)[:cloth, 2] > before[:cloth, 2] + 0.4).all()


def test_a_restored_checkpoint_leaves_arrays_as_they_are(tmp_path):
    simulation = simulate()
    simulation.save_checkpoint(tmp_path / "start.h5")
    simulation.step(3)
    taken, moment = np.asarray(simulation.device_positions), simulation.positions
    simulation.load_checkpoint(tmp_path / "start.h5")
    np.testing.assert_array_equal(taken, moment)
    assert (simulation.positions != moment).any()


def test_memory_is_only_copied_for_arrays_that_somebody_holds():
    simulation = simulate(integrator="backward_euler")
    simulation.step(60)  # the sheet has landed: lists of contacts grow no more
    dropped, held = set(), []
    for _ in range(8):
        dropped.add(address(np.asarray(simulation.device_positions)))
        simulation.step()
    assert len(dropped) == 2, "positions at both ends of a step change places"
    for _ in range(8):
        held.append(np.asarray(simulation.device_positions))
        simulation.step()
    assert len({address(array) for array in held}) == 8
    peak = simulation.peak_memory_bytes
    del held
    for _ in range(40):
        held = [np.asarray(simulation.device_positions)]
        simulation.step()
    assert held and simulation.peak_memory_bytes == peak, "memory that came back is used again"


def test_arrays_outlive_their_simulation():
    simulation = simulate(forces=True)
    simulation.step(30)
    given, forces = simulation.device_positions, simulation.device_forces
    array, moment, force = np.from_dlpack(given), simulation.positions, simulation.forces
    late = np.asarray(simulation.device_velocities)
    velocities = simulation.velocities
    del simulation
    gc.collect()
    np.testing.assert_array_equal(array, moment)
    np.testing.assert_array_equal(np.from_dlpack(given), moment)
    np.testing.assert_array_equal(np.from_dlpack(given, copy=True), moment)
    np.testing.assert_array_equal(forces, force)
    np.testing.assert_array_equal(late, velocities)
    assert np.abs(force).max() > 0


def test_forces_are_those_of_the_host():
    simulation = simulate(forces=True)
    simulation.step(30)
    taken, moment = np.asarray(simulation.device_forces), simulation.forces
    np.testing.assert_array_equal(taken, moment)
    simulation.step(5)
    np.testing.assert_array_equal(taken, moment)
    with pytest.raises(cama.SceneError, match="set the option forces"):
        print(simulate().device_forces)


def test_a_copy_may_be_written_to_and_changes_nothing():
    simulation = simulate()
    before = simulation.positions
    mine = np.from_dlpack(simulation.device_positions, copy=True)
    mine[:] = 7
    old = np.from_dlpack(Unversioned(simulation.device_positions))  # a library before DLPack 1.0
    assert address(old) != address(np.asarray(simulation.device_positions))
    np.testing.assert_array_equal(old, before)
    np.testing.assert_array_equal(simulation.positions, before)


class Unversioned:
    """Asks for a capsule as libraries before DLPack 1.0 do."""

    def __init__(self, array):
        self.array = array

    def __dlpack_device__(self):
        return self.array.__dlpack_device__()

    def __dlpack__(self, **_):
        return self.array.__dlpack__()


def test_taking_arrays_again_and_again_costs_no_more():
    simulation = simulate()

    def cost():
        start = time.perf_counter()
        for _ in range(500):
            np.asarray(simulation.device_positions)
        return time.perf_counter() - start

    first = min(cost() for _ in range(3))
    for _ in range(20):
        last = cost()
    assert last < 10 * first


def test_capsules_that_nobody_takes_give_the_memory_back():
    simulation = simulate()
    for _ in range(3):
        simulation.device_positions.__dlpack__(max_version=(1, 0))
        simulation.device_positions.__dlpack__()
    addresses = set()
    for _ in range(6):
        addresses.add(address(np.asarray(simulation.device_positions)))
        simulation.device_positions.__dlpack__(max_version=(1, 1))
        simulation.step()
    assert len(addresses) < 6


def test_bad_requests_are_named():
    given = simulate().device_positions
    for arguments, text in [
        ({"stream": 1}, "stream: 1 given, but memory of the host"),
        ({"copy": False}, "copy: the array is read-only"),
        ({"dl_device": (2, 0), "max_version": (1, 0)}, "dl_device: the array is on cpu"),
    ]:
        with pytest.raises(cama.DeviceArrayError, match=text):
            given.__dlpack__(**arguments)
    assert issubclass(cama.DeviceArrayError, BufferError) and issubclass(cama.DeviceArrayError, cama.BackendError)
    with pytest.raises(ValueError, match="only by a copy"):
        np.asarray(given, dtype=np.float32, copy=False)
    with pytest.raises(TypeError, match="comes from device_positions"):
        cama.DeviceArray()


def test_memory_without_addresses_is_refused():
    if not any(row["name"] == "opencl" and row["available"] for row in cama.backends()):
        pytest.skip("no opencl here")
    simulation = simulate(backend="opencl", forces=True)
    simulation.step()
    for name in ("device_positions", "device_velocities", "device_forces"):
        with pytest.raises(cama.BackendError, match="opencl has no address.*use positions"):
            getattr(simulation, name)
    simulation.step()


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_arrays_of_other_libraries_are_taken(dtype):
    ours, theirs = simulate(), simulate()
    cloth = ours.cloth_vertex_count
    ball = ours.positions[cloth:]
    rng = np.random.default_rng(3)
    state = (ours.positions[:cloth] + [0, 0, 0.25]).astype(dtype), rng.normal(size=(cloth, 3)).astype(dtype)
    targets = ours.positions[[0, 6]].astype(dtype) + dtype(0.25)
    forces = rng.normal(size=(4, 3)).astype(dtype) * dtype(1e-3)
    moved = ball.astype(dtype) - dtype(0.01)
    for simulation, wrap in ((ours, np.asarray), (theirs, Foreign)):
        simulation.set_state(*map(wrap, state))
        simulation.pin([0, 6], wrap(targets))
        simulation.set_targets([0, 6], wrap(targets + dtype(0.01)))
        simulation.set_force([1, 2, 3, 9], wrap(forces))
        simulation.set_obstacle_vertices("ball", wrap(moved))
        simulation.step(4)
    assert ours.state_hash == theirs.state_hash
    np.testing.assert_allclose(theirs.positions[cloth:], moved, rtol=1e-12)


def test_an_array_of_a_simulation_is_taken_by_another():
    first, second = simulate(), simulate()
    first.step(5)
    cloth = first.cloth_vertex_count
    second.set_state(np.asarray(first.device_positions)[:cloth], np.asarray(first.device_velocities)[:cloth])
    assert first.state_hash == second.state_hash


class OnCuda:
    """An array on a CUDA device, of which only the description is looked at."""

    def __init__(self, **interface):
        self.__cuda_array_interface__ = {"shape": (49, 3), "typestr": "<f8", "data": (16, False), **interface}


def test_wrong_arrays_are_named_and_change_nothing():
    simulation = simulate()
    cloth = simulation.cloth_vertex_count
    before = simulation.state_hash
    fine = np.zeros((cloth, 3))
    holed = fine.copy()
    holed[5, 1] = np.nan
    for bad, text in [
        (Foreign(np.zeros((3, 3))), r"set_state: velocities: shape \[3, 3\], expected \[49, 3\]"),
        (Foreign(fine.astype(complex)), "set_state: velocities: type complex128, expected numbers"),
        (Foreign(holed), "set_state: velocities: row 5 is not finite"),
        (Foreign(fine, device=(2, 0)), "velocities: is on cuda:0, and the simulation computes on the host"),
        (Foreign(fine, device=(13, 1)), "velocities: is on cuda:1, and the simulation computes on the host"),
        (Foreign(fine, device=(9, 0)), "velocities: is on a device of kind 9"),
        (OnCuda(), "velocities: is on a CUDA device, and the simulation computes on the host"),
        (object(), "set_state: velocities: "),
    ]:
        with pytest.raises(cama.ArrayError, match=text):
            simulation.set_state(fine, bad)
    with pytest.raises(cama.ArrayError, match="set_force: forces: is on cuda:0"):
        simulation.set_force(range(cloth), Foreign(fine, device=(2, 0)))
    assert simulation.state_hash == before
    broken = Foreign(fine)
    broken.__class__ = type("Broken", (Foreign,), {"__dlpack__": lambda self, **_: 1 / 0})
    with pytest.raises(cama.ArrayError, match="ZeroDivisionError"):
        simulation.set_force(range(cloth), broken)


def test_arrays_are_dropped_in_other_threads_while_the_simulation_steps():
    simulation, undisturbed = simulate(), simulate()
    held, stop = [], threading.Event()

    def drop():
        while not stop.is_set() or held:
            if held:
                array, moment = held.pop()
                assert (array == moment).all()
                del array

    droppers = [threading.Thread(target=drop) for _ in range(2)]
    for dropper in droppers:
        dropper.start()
    for _ in range(60):
        held.append((np.from_dlpack(simulation.device_positions), simulation.positions))
        simulation.step()
    stop.set()
    for dropper in droppers:
        dropper.join()
    undisturbed.step(60)
    assert simulation.state_hash == undisturbed.state_hash


def test_worlds_lend_their_arrays():
    worlds = cama.Worlds(scene(), 3, backend="cpu", accuracy="interactive", time_step=STEP)
    worlds.step(3)
    arrays, moment = [np.asarray(world.device_positions) for world in worlds], worlds.positions
    worlds.step(2)
    worlds.reset([1])
    np.testing.assert_array_equal(arrays, moment)
    del worlds
    gc.collect()
    np.testing.assert_array_equal(arrays, moment)


def test_jax_reads_and_writes():
    jax = pytest.importorskip("jax", reason="JAX is not installed")
    simulation = simulate()
    simulation.step(2)
    with jax.enable_x64(True):
        array = jax.dlpack.from_dlpack(simulation.device_positions)
        moment = simulation.positions
        simulation.step(3)
        np.testing.assert_array_equal(array, moment)
        cloth = simulation.cloth_vertex_count
        simulation.set_state(array[:cloth] + 0.5, jax.numpy.zeros((cloth, 3)))
        np.testing.assert_array_equal(simulation.positions[:cloth], moment[:cloth] + 0.5)
        simulation.set_force([0, 1], jax.numpy.ones((2, 3), dtype="float32"))
    simulation.step()


def test_torch_reads_and_writes():
    torch = pytest.importorskip("torch", reason="PyTorch is not installed")
    simulation = simulate()
    simulation.step(2)
    array, moment = torch.from_dlpack(simulation.device_positions), simulation.positions
    simulation.step(3)
    np.testing.assert_array_equal(array.numpy(), moment)
    cloth = simulation.cloth_vertex_count
    simulation.set_state(array[:cloth] + 0.5, torch.zeros(cloth, 3))
    np.testing.assert_array_equal(simulation.positions[:cloth], moment[:cloth] + 0.5)
    simulation.set_force([0, 1], torch.ones(2, 3))
    with pytest.raises(cama.ArrayError, match="set_force: forces: .*grad"):
        simulation.set_force([0, 1], torch.ones(2, 3, requires_grad=True))
    simulation.step()
