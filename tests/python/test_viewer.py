# SPDX-License-Identifier: Apache-2.0
"""The page of `cama view`, asked as a browser asks it: over HTTP and its websocket."""

import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request

import numpy as np
import pytest

pytest.importorskip("viser")
import msgspec  # noqa: E402
import viser  # noqa: E402
import zstandard  # noqa: E402
from websockets.sync.client import connect  # noqa: E402

import cama  # noqa: E402
from cama.io.recording import Recording  # noqa: E402
from cama.viewing.player import Player  # noqa: E402
from conftest import grid  # noqa: E402

LIMIT = 30.0  # s until something that should come is missed


class Page:
    """What a browser does without drawing: it knows the control panel and the arrays that came, and sends back."""

    def __init__(self, viewer):
        self.controls, self.nodes, self.arrays, self._ended = {}, {}, [], False
        self._socket = connect(
            viewer.url.replace("http", "ws"),
            subprotocols=[f"viser-v{viser.__version__}"],
            max_size=None,
            compression=None,
        )
        self._thread = threading.Thread(target=self._read)
        self._thread.start()
        lens = dict(fov=0.5, near=0.01, far=100.0, image_height=480, image_width=640)
        place = dict(position=(3.0, 0.0, 0.0), look_at=(0.0, 0.0, 0.0), up_direction=(0.0, 0.0, 1.0))
        self.send("ViewerCameraMessage", wxyz=(1.0, 0.0, 0.0, 0.0), **lens, **place)  # from here on viser listens

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._ended = True
        self._thread.join()
        self._socket.close()

    def _read(self):
        while not self._ended:
            try:
                raw = self._socket.recv(timeout=0.1)
            except TimeoutError:
                continue
            size = int.from_bytes(raw[8:16], "little")
            content = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(raw[16 : 16 + size]))
            self.arrays = [*self.arrays[-200:], raw[16 + size :]]
            for message in content["messages"]:
                kind, props = message["type"], message.get("props", message.get("updates", {}))
                if kind.startswith("Gui") and "uuid" in message:
                    self.controls.setdefault(message["uuid"], {"kind": kind}).update(props)
                elif "name" in message:
                    node = self.nodes.setdefault(message["name"], {})
                    node.update(props)
                    if "visibility" in message or "visible" in message:
                        node["visible"] = message.get("visibility", message.get("visible"))

    def wait(self, condition):
        """Waits for what a condition returns that is true."""
        end = time.monotonic() + LIMIT
        while time.monotonic() < end:
            found = condition()
            if found:
                return found
            time.sleep(0.02)
        raise AssertionError(f"not within {LIMIT:g} s")

    def control(self, label):
        """Identifier of a part of the control panel."""
        return self.wait(lambda: next((k for k, c in list(self.controls.items()) if c.get("label") == label), None))

    def send(self, kind, **fields):
        self._socket.send(msgspec.msgpack.encode({"type": kind, **fields}))

    def set(self, label, value=True):
        """Sets a value of the control panel, or presses a button."""
        self.send("GuiUpdateMessage", uuid=self.control(label), updates={"value": value})

    def shows(self, positions):
        """Waits until exactly these positions [n, 3] were sent."""
        wanted = np.ascontiguousarray(positions, np.float32).tobytes()
        self.wait(lambda: any(wanted in array for array in list(self.arrays)))

    def says(self, pattern):
        """Waits for a text in the control panel; returns the match."""

        def found():
            texts = (str(c.get(k, "")) for c in list(self.controls.values()) for k in ("_markdown", "content", "label"))
            return next(filter(None, (re.search(pattern, text) for text in texts)), None)

        return self.wait(found)


@pytest.fixture
def simulation(falling):
    return cama.Simulation(falling, accuracy="preview", threads=1)


@pytest.fixture
def recording(simulation, tmp_path):
    cama.record(simulation, tmp_path, frames=6, store="single")
    return tmp_path


def test_record_writes_what_run_writes(falling, tmp_path):
    def driven(simulation):
        simulation.gravity = (0, 0, -1)

    simulation = cama.Simulation(falling, accuracy="preview", threads=1)
    simulation.step(2)
    start, time_before = simulation.positions, simulation.time
    simulation.before_step = driven
    summary = cama.record(simulation, tmp_path, frames=3)
    assert summary["intersections"] == 0 and {p.name for p in tmp_path.iterdir()} == {
        "frames.h5",
        "summary.json",
        "checkpoint.h5",
    }
    with Recording(tmp_path) as recording:
        np.testing.assert_array_equal(recording.frame(0), start)
        np.testing.assert_array_equal(recording.frame(3), simulation.positions)
        assert len(recording) == 4
        assert recording.times[-1] == pytest.approx(time_before + 3 * simulation.steps_per_frame * simulation.time_step)
        sides = [np.linalg.norm(np.roll(c, 1, 1) - c, axis=2) for c in (recording.rest_corners, grid(8)[0][grid(8)[1]])]
        np.testing.assert_allclose(*sides, atol=1e-6)
    assert simulation.gravity == (0, 0, -1)
    cama.record(simulation, tmp_path, frames=1)
    with Recording(tmp_path / "previous") as before, Recording(tmp_path) as after:
        assert (len(before), len(after)) == (4, 2)
    with pytest.raises(cama.SceneError, match='store is "half"|store is'):
        cama.record(simulation, tmp_path, store="half")


def test_a_recording_is_served_and_played(recording):
    with Recording(recording) as recorded:
        frames, first = [recorded.frame(i) for i in range(len(recorded))], recorded.obstacles[0].vertices.start
    with Player(recording) as viewer, Page(viewer) as page:
        assert re.fullmatch(r"http://127\.0\.0\.1:\d+", viewer.url)
        with urllib.request.urlopen(viewer.url) as answer:
            assert not re.search(r"""(src|href)=["']?https?:""", answer.read().decode())
        page.shows(frames[0][:first])
        page.shows(frames[0][first:])
        page.set("repeat", False)
        page.set("Play")
        page.says(r"frame \| 6 of 6")
        page.shows(frames[6][:first])
        page.says("^Play$")
        page.set("frame", 3)
        page.says(r"frame \| 3 of 6")
        page.shows(frames[3][:first])


def test_colours_layers_and_wireframe(recording):
    with Player(recording) as viewer, Page(viewer) as page:
        page.set("colour by", "speed")
        page.says(r"speed \(m/s\)")
        banded = page.wait(lambda: [n for name, n in list(page.nodes.items()) if name.startswith("/cloth/band")])
        assert all(len(set(node["color"])) > 1 for node in banded)
        page.wait(lambda: page.nodes["/parts/0 sheet"].get("visible") is False)
        page.set("wireframe")
        page.wait(lambda: all(node["wireframe"] for node in banded))
        page.set("ball", False)
        page.wait(lambda: page.nodes["/parts/1 ball"].get("visible") is False)
        for quantity, words in (
            ("strain", r"strain \(%\)"),
            ("gaps", r"gap \(mm\)"),
            ("curvature", r"curvature \(1/m\)"),
        ):
            page.set("colour by", quantity)
            page.says(words)
        page.set("to", 500.0)
        page.says("<span>500</span>")


def test_a_simulation_runs_is_restarted_and_changes_its_level(simulation):
    start, hashed = simulation.positions, simulation.state_hash
    with simulation.show() as viewer, Page(viewer) as page:
        cloth = simulation.cloth_vertex_count
        page.shows(start[:cloth])
        page.set("Step one frame")
        page.wait(lambda: simulation.step_count == simulation.steps_per_frame)
        page.says(r"linear solve \| [\d.e-]+")
        page.shows(simulation.positions[:cloth])
        page.set("Run")
        page.wait(lambda: simulation.time > 3 * simulation.scene.seconds_per_frame)
        page.set("Pause")
        page.says("^Run$")
        page.set("Restart")
        page.wait(lambda: simulation.state_hash == hashed)
        assert simulation.step_count == 0
        simulation.step(3)
        viewer.update()
        page.shows(simulation.positions[:cloth])
        page.set("accuracy", "interactive")
        page.wait(lambda: viewer.simulation is not simulation)
        assert viewer.simulation.options["accuracy"] == "interactive"
        assert viewer.simulation.state_hash == simulation.state_hash
        assert viewer.url in viewer._repr_html_()
    viewer.close()
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(viewer.url)


def test_what_is_clicked_is_held_and_follows_its_handle():
    scene = cama.Scene(gravity=(0, 0, 0))
    scene.add_cloth(*grid(8), name="sheet")
    simulation = cama.Simulation(scene, accuracy="preview", threads=1)
    corner = 0  # at (-0.5, -0.5, 0)
    with simulation.show() as viewer, Page(viewer) as page:
        page.wait(lambda: page.nodes)
        page.send(
            "ScenePointerMessage",
            event_type="click",
            ray_origin=(-0.49, -0.48, 1.0),
            ray_direction=(0.0, 0.0, -1.0),
            screen_pos=((0.5, 0.5),),
            modifier=None,
        )
        handle = page.wait(lambda: next((name for name in list(page.nodes) if name.startswith("/hold")), None))
        assert handle == f"/hold {corner}"
        page.send(
            "TransformControlsUpdateMessage",
            name=handle,
            wxyz=(1.0, 0.0, 0.0, 0.0),
            position=(-0.5, -0.5, 0.1),
        )
        time.sleep(0.3)
        page.set("Run")
        page.wait(lambda: np.allclose(simulation.positions[corner], (-0.5, -0.5, 0.1), atol=1e-6))
        assert simulation.time >= 0.1 / 3.0 - 1e-9  # at the largest speed of a handle
        page.set("Let go of all")
        page.wait(lambda: not np.allclose(simulation.positions[corner], (-0.5, -0.5, 0.1), atol=1e-5))


def test_an_error_of_a_step_is_said_in_the_page(simulation):
    def fail(_):
        raise cama.SolverError("no luck")

    simulation.before_step = fail
    with simulation.show() as viewer, Page(viewer) as page:
        page.set("Run")
        page.says("SolverError:.* no luck")
        page.says("^Run$")
        simulation.before_step = None
        page.set("Run")
        page.wait(lambda: simulation.step_count > 0)


def view(*words):
    """A running `cama view`."""
    return subprocess.Popen(
        [sys.executable, "-m", "cama", "view", *map(str, words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "COLUMNS": "120"},
    )


@pytest.mark.parametrize("what", ["recording", "scene"])
def test_the_command_says_where_and_ends_by_ctrl_c(what, request, fall):
    words = [request.getfixturevalue("recording")] if what == "recording" else [fall, "--accuracy", "preview"]
    running = view(*words)
    try:
        said = running.stdout.readline() + running.stdout.readline()
        url = re.match(r"open (http://127\.0\.0\.1:(\d+)) in a browser; Ctrl-C ends\n", said)
        assert f"ssh -L {url[2]}:127.0.0.1:{url[2]} " in said
        with urllib.request.urlopen(url[1]) as answer:
            assert answer.status == 200
        running.send_signal(signal.SIGINT)
        rest, problems = running.communicate(timeout=LIMIT)
        assert (running.returncode, rest, problems) == (0, "", "")
    finally:
        running.kill()
        running.wait()


def test_what_cannot_be_served_is_a_named_error(recording, tmp_path):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(cama.BackendError, match=f"port {taken.getsockname()[1]}: Address already in use"):
            Player(recording, port=taken.getsockname()[1])
    with pytest.raises(cama.BackendError, match="host 'no.such.host' is no address"):
        Player(recording, host="no.such.host")
    with pytest.raises(cama.FileError, match="no such file"):
        Player(tmp_path / "nothing")
    (tmp_path / "empty").mkdir()
    done = view(tmp_path / "empty")
    assert done.wait(LIMIT) == 2 and "neither scene.json nor frames.h5" in done.stderr.read()
