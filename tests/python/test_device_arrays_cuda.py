# SPDX-License-Identifier: Apache-2.0
"""Arrays shared with CuPy, PyTorch and JAX on a CUDA device. Without a device these tests are skips."""

import gc

import numpy as np
import pytest

import cama
import test_worlds_driving
from conftest import grid

STEP = 1 / 200
AVAILABLE = any(row["name"] == "cuda" and row["available"] for row in cama.backends())
pytestmark = pytest.mark.skipif(not AVAILABLE, reason="no cuda here")


def simulate(backend="cuda", **options):
    scene = cama.Scene(time_step=STEP)
    scene.add_cloth(*grid(6, 0.3, 0.12), name="sheet", material="cotton")
    scene.add_obstacle(shape={"sphere": {"radius": 0.1, "triangles": 80}}, name="ball")
    return cama.Simulation(scene, **{"backend": backend, "accuracy": "interactive", "time_step": STEP, **options})


class Asked:
    """Hands on an array by DLPack alone, and keeps which version its reader knows."""

    def __init__(self, array):
        self.array, self.version = array, (0, 0)

    def __dlpack__(self, **wishes):
        self.version = wishes.get("max_version") or (0, 0)
        return self.array.__dlpack__(**wishes)

    def __dlpack_device__(self):
        return self.array.__dlpack_device__()


class Library:
    """What the tests ask of a library: to read an array in place, to make one, to bring one to the host."""

    def __init__(self, name):
        self.name = name
        self.module = pytest.importorskip(name, reason=f"{name} is not installed")
        if name == "torch" and not self.module.cuda.is_available():
            pytest.skip("PyTorch has no CUDA here")
        if name == "jax":
            self.module.config.update("jax_enable_x64", True)
            if not any(device.platform == "gpu" for device in self.module.devices()):
                pytest.skip("JAX has no GPU here")

    def read(self, array):
        return (self.module.dlpack if self.name == "jax" else self.module).from_dlpack(array)

    def make(self, values):
        if self.name == "torch":
            return self.module.tensor(values, device="cuda")
        return self.module.numpy.asarray(values) if self.name == "jax" else self.module.asarray(values)

    def host(self, array):
        if self.name == "torch":
            return array.cpu().numpy()
        return array.get() if self.name == "cupy" else np.asarray(array)

    def address(self, array):
        if self.name == "torch":
            return array.data_ptr()
        return array.unsafe_buffer_pointer() if self.name == "jax" else array.data.ptr


@pytest.fixture(params=["cupy", "torch", "jax"])
def library(request):
    return Library(request.param)


def test_what_a_library_reads_is_the_moment_at_which_it_was_taken(library):
    simulation, undisturbed = simulate(forces=True), simulate(forces=True)
    arrays, moments = [], []
    for _ in range(6):
        for given, moment in (
            (simulation.device_positions, simulation.positions),
            (simulation.device_velocities, simulation.velocities),
            (simulation.device_forces, simulation.forces),
        ):
            assert given.device == "cuda:0" and given.__dlpack_device__() == (2, 0)
            np.testing.assert_array_equal(given.numpy(), moment)
            arrays.append(library.read(given))
            moments.append(moment)
        simulation.step(4)
        undisturbed.step(4)
    assert simulation.state_hash == undisturbed.state_hash
    del simulation
    gc.collect()
    for array, moment in zip(arrays, moments):
        np.testing.assert_array_equal(library.host(array), moment)


def test_reading_does_not_copy(library):
    simulation = simulate()
    given = simulation.device_positions
    own = given.__cuda_array_interface__["data"][0]
    asked = Asked(given)
    array = library.read(asked)
    assert (library.address(array) == own) == (tuple(asked.version) >= (1, 0))  # an earlier one gets a copy


def test_arrays_of_a_library_act_as_those_of_the_host(library):
    ours, theirs = simulate(), simulate()
    cloth = ours.cloth_vertex_count
    rng = np.random.default_rng(3)
    x = ours.positions[:cloth] + [0, 0, 0.25]
    for dtype in (np.float64, np.float32):
        v = rng.normal(size=(cloth, 3)).astype(dtype)
        f = 1e-3 * rng.normal(size=(4, 3)).astype(dtype)
        for simulation, wrap in ((ours, np.asarray), (theirs, library.make)):
            simulation.set_state(wrap(x.astype(dtype)), wrap(v))
            simulation.pin([0, 6], wrap(x[[0, 6]].astype(dtype)))
            simulation.set_targets([0, 6], wrap((x[[0, 6]] + 0.01).astype(dtype)))
            simulation.set_force([1, 2, 3, 9], wrap(f))
            simulation.set_obstacle_vertices("ball", wrap(simulation.positions[cloth:].astype(dtype)))
            simulation.step(3)
        assert ours.state_hash == theirs.state_hash


def test_the_order_of_streams_holds():
    """What a library computes, on its own stream and not waited for, comes before the simulation reads it."""
    torch = Library("torch").module
    ours, theirs = simulate(), simulate()
    cloth = ours.cloth_vertex_count
    big = torch.randn(4096, 4096, device="cuda")
    stream = torch.cuda.Stream()
    for k in range(4):
        with torch.cuda.stream(stream):
            slow = big
            for _ in range(20):
                slow = torch.tanh(slow @ big)  # keeps the stream busy
            force = torch.full((cloth, 3), 1e-4 * (k + 1), dtype=torch.float64, device="cuda") + 0 * slow[0, 0].double()
            theirs.set_force(range(cloth), force)
        ours.set_force(range(cloth), np.full((cloth, 3), 1e-4 * (k + 1)))
        ours.step(2)
        theirs.step(2)
        with torch.cuda.stream(stream):
            seen = torch.from_dlpack(theirs.device_positions).clone()
        moment = theirs.positions
        theirs.step()
        ours.step()
        stream.synchronize()
        np.testing.assert_array_equal(seen.cpu().numpy(), moment)
        assert ours.state_hash == theirs.state_hash


def test_a_dropped_array_is_not_overwritten_before_it_was_read():
    torch = Library("torch").module
    simulation = simulate()
    big = torch.randn(4096, 4096, device="cuda")
    stream = torch.cuda.Stream()
    seen, moments = [], []
    for _ in range(6):
        moments.append(simulation.positions)
        with torch.cuda.stream(stream):
            slow = big
            for _ in range(20):
                slow = torch.tanh(slow @ big)
            array = torch.from_dlpack(simulation.device_positions)
            seen.append(array + 0 * slow[0, 0].double())
            del array
        simulation.step(3)
    torch.cuda.synchronize()
    for got, moment in zip(seen, moments):
        np.testing.assert_array_equal(got.cpu().numpy(), moment)


def test_the_cuda_array_interface_is_read_and_taken():
    cupy = Library("cupy").module
    simulation = simulate()
    simulation.step()
    array = cupy.asarray(simulation.device_positions)
    assert array.data.ptr == simulation.device_positions.__cuda_array_interface__["data"][0]
    np.testing.assert_array_equal(array.get(), simulation.positions)

    class Interface:
        def __init__(self, of):
            self.of, self.__cuda_array_interface__ = of, of.__cuda_array_interface__

    cloth = simulation.cloth_vertex_count
    velocities = np.random.default_rng(1).normal(size=(cloth, 3))
    simulation.set_state(Interface(cupy.asarray(array[:cloth])), Interface(cupy.asarray(velocities)))
    np.testing.assert_array_equal(simulation.velocities[:cloth], velocities)


def test_wrong_arrays_are_named_and_change_nothing():
    cupy = Library("cupy").module
    simulation, host = simulate(), simulate("cpu")
    cloth = simulation.cloth_vertex_count
    fine = cupy.zeros((cloth, 3))
    holed = fine.copy()
    holed[5, 1] = cupy.nan
    before = simulation.state_hash
    for bad, text in [
        (cupy.zeros((3, 3)), r"set_state: velocities: shape \[3, 3\], expected \[49, 3\]"),
        (cupy.zeros((cloth, 3), int), "velocities: type int64, expected float64 or float32"),
        (cupy.zeros((cloth, 6))[:, ::2], "velocities: its rows are not one after the other"),
        (cupy.zeros((3, cloth)).T, "velocities: its rows are not one after the other"),
    ]:
        with pytest.raises(cama.ArrayError, match=text):
            simulation.set_state(fine, bad)
    with pytest.raises(cama.Error, match=r"velocities\[5\] is not finite"):
        simulation.set_state(fine, holed)
    with pytest.raises(cama.ArrayError, match="is on cuda:0, and the simulation computes on the host"):
        host.set_state(fine, fine)
    with pytest.raises(cama.ArrayError, match="vertices: not indices on the host"):
        simulation.set_force(cupy.arange(2), np.zeros((2, 3)))
    assert simulation.state_hash == before
    given = simulation.device_positions
    for stream in (0, -2, "1", True):
        with pytest.raises(cama.DeviceArrayError, match="is no CUDA stream"):
            given.__dlpack__(stream=stream)
    with pytest.raises(cama.DeviceArrayError, match=r"is on cuda:0; numpy\(\) copies it"):
        np.asarray(given)


def test_worlds_lend_their_arrays():
    cupy = Library("cupy").module
    scene = cama.Scene(time_step=STEP)
    scene.add_cloth(*grid(6, 0.3, 0.12), name="sheet", material="cotton")
    worlds = cama.Worlds(scene, 4, backend="cuda", accuracy="interactive", time_step=STEP)
    worlds.step(3)
    arrays, moment = [cupy.from_dlpack(world.device_positions) for world in worlds], worlds.positions
    worlds.step(2)
    worlds.reset([1])
    for array, expected in zip(arrays, moment):
        np.testing.assert_array_equal(array.get(), expected)
    del worlds
    gc.collect()
    for array, expected in zip(arrays, moment):
        np.testing.assert_array_equal(array.get(), expected)


def test_driving_all_worlds_at_once_gives_the_bits_of_driving_each():
    test_worlds_driving.test_driving_all_worlds_at_once_gives_the_bits_of_driving_each("cuda")


def test_arrays_of_all_worlds_on_the_device(library):
    scene = test_worlds_driving.scene()
    worlds = cama.Worlds(scene, 4, backend="cuda", accuracy="interactive", time_step=STEP, forces=True)
    worlds.step(20)
    given = [worlds.device_positions, worlds.device_velocities, worlds.device_forces]
    arrays = [library.read(array) for array in given]
    read = [library.host(array) for array in arrays]  # before anything below waits for the device
    expected = [worlds.positions, worlds.velocities, worlds.forces]
    for own, moment in zip(read, expected):
        np.testing.assert_array_equal(own, moment)
    assert given[0].device == "cuda:0" and tuple(arrays[0].shape) == worlds.positions.shape
    worlds.step(2)
    for array, lent, moment in zip(arrays, given, expected):
        np.testing.assert_array_equal(library.host(array), moment)
        np.testing.assert_array_equal(lent.numpy(), moment)
    cloth = worlds[0].cloth_vertex_count
    worlds.set_force(range(cloth), library.make(np.full((4, cloth, 3), 1e-4)))
    worlds.set_state(library.make(expected[0][:, :cloth]), library.make(expected[1][:, :cloth]))
    np.testing.assert_array_equal(worlds.positions[:, :cloth], expected[0][:, :cloth])
