# SPDX-License-Identifier: Apache-2.0
"""Steps in the background: the bits of ordinary steps, readers that wait, errors, order, Ctrl-C."""

import concurrent.futures
import signal
import threading
import time

import numpy as np
import pytest

import cama
from conftest import grid

STEP = 1 / 200


def scene(cells=8):
    made = cama.Scene(time_step=STEP)
    made.add_cloth(*grid(cells, 0.3, 0.12), name="sheet", material="cotton")
    made.add_obstacle(shape={"sphere": {"radius": 0.1, "triangles": 80}}, name="ball")
    return made


def simulate(cells=8):
    return cama.Simulation(scene(cells), backend="cpu", accuracy="interactive", time_step=STEP, threads=1)


def test_steps_in_the_background_are_those_of_step():
    ours, theirs = simulate(), simulate()
    future = ours.step_async(20)
    assert isinstance(future, concurrent.futures.Future)
    assert future.result() is None and future.done()
    theirs.step(20)
    assert ours.state_hash == theirs.state_hash


def test_the_call_returns_at_once_and_readers_wait():
    simulation, reference = simulate(20), simulate(20)
    start = time.perf_counter()
    reference.step(100)
    took = time.perf_counter() - start
    start = time.perf_counter()
    future = simulation.step_async(100)
    returned = time.perf_counter() - start
    assert not future.done() and returned < took / 4
    assert simulation.step_count == 100, "it has waited for the steps"
    assert time.perf_counter() - start > took / 4
    np.testing.assert_array_equal(simulation.positions, reference.positions)
    future.result()


def test_python_goes_on_meanwhile():
    simulation = simulate(20)
    future, turns = simulation.step_async(100), 0
    while not future.done():
        turns += 1
        time.sleep(0.001)
    assert turns > 20, "the GIL is released"


def test_several_calls_are_done_in_order_and_driving_comes_after_them():
    ours, theirs = simulate(), simulate()
    futures = [ours.step_async(3), ours.step_async(2)]
    ours.set_force([0], (0, 0, 1e-3))
    futures.append(ours.step_async(2))
    theirs.step(5)
    theirs.set_force([0], (0, 0, 1e-3))
    theirs.step(2)
    assert ours.state_hash == theirs.state_hash and ours.step_count == 7
    assert all(future.done() or future.result() is None for future in futures)


def test_errors_come_with_the_result_and_the_simulation_stays_usable():
    ours, theirs = simulate(), simulate()
    for simulation in (ours, theirs):
        simulation.step()
        simulation.set_force([0, 1], (1e12, 0, 0))
    future = ours.step_async(4)
    with pytest.raises(cama.SolverError, match="faster than cloth can") as raised:
        future.result()
    with pytest.raises(cama.SolverError) as expected:
        theirs.step(4)
    assert str(raised.value) == str(expected.value) == str(future.exception())
    assert ours.state_hash == theirs.state_hash and ours.step_count == theirs.step_count < 5
    state = np.zeros((ours.cloth_vertex_count, 3))
    ours.set_force([0, 1], (0, 0, 0))
    ours.set_state(scene().cloths[0].vertices, state)
    before = ours.step_count
    ours.step_async().result()
    assert ours.step_count == before + 1
    with pytest.raises(cama.ArrayError, match="step_async: n is negative"):
        ours.step_async(-1)


def test_before_step_reads_and_drives_in_the_background():
    ours, theirs = simulate(), simulate()

    def push(now):
        now.set_force([0], (0, 0, 1e-3 * (1 + now.step_count)))
        assert len(now.positions) == now.vertex_count

    ours.before_step = theirs.before_step = push
    ours.step_async(6).result()
    theirs.step(6)
    assert ours.state_hash == theirs.state_hash
    ours.before_step = lambda now: now.step_async()
    with pytest.raises(cama.SceneError, match="step_async: called by before_step"):
        ours.step_async().result()
    ours.before_step = lambda now: 1 / 0
    with pytest.raises(ZeroDivisionError):
        ours.step_async().result()
    ours.before_step = None
    ours.step()


def test_steps_that_have_not_begun_can_be_cancelled():
    simulation = simulate(20)
    first, second = simulation.step_async(60), simulation.step_async(60)
    assert second.cancel()
    assert simulation.step_count == 60
    first.result()
    simulation.step()


def test_arrays_taken_before_stay_while_steps_run():
    simulation = simulate()
    taken, moment = np.asarray(simulation.device_positions), simulation.positions
    future = simulation.step_async(50)
    while not future.done():
        assert (taken == moment).all()
    assert (np.asarray(simulation.device_positions) != moment).any()


def test_other_threads_wait_too():
    simulation = simulate(20)
    future, seen = simulation.step_async(60), []
    readers = [threading.Thread(target=lambda: seen.append(simulation.step_count)) for _ in range(3)]
    for reader in readers:
        reader.start()
    for reader in readers:
        reader.join()
    assert seen == [60, 60, 60]
    future.result()


def test_the_simulation_may_be_dropped_while_steps_run():
    simulation = simulate(20)
    future = simulation.step_async(40)
    del simulation
    assert future.result() is None


def test_ctrl_c_ends_the_wait_of_a_reader():
    simulation = simulate(30)
    future = simulation.step_async(400)
    timer = threading.Timer(0.2, lambda: signal.raise_signal(signal.SIGINT))
    timer.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            print(simulation.positions)
            time.sleep(5)
        assert not future.done(), "it was the wait that ended"
    finally:
        timer.join()
        future.result()
    assert simulation.step_count == 400


def test_worlds_step_in_the_background():
    ours, theirs = (cama.Worlds(scene(), 4, backend="cpu", accuracy="interactive", time_step=STEP) for _ in range(2))
    future = ours.step_async(20)
    single = ours[2].step_async(3)
    assert ours[1].step_count == 20 and ours[2].step_count == 23
    theirs.step(20)
    theirs[2].step(3)
    np.testing.assert_array_equal(ours.positions, theirs.positions)
    assert future.done() and single.done()
    ours[1].set_force([0, 1], (1e12, 0, 0))
    ours.step_async(2).result()  # the commit may hold the first of them back
    assert ours.frozen == [1], "as of step, what a single world meets freezes it"
