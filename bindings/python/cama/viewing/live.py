# SPDX-License-Identifier: Apache-2.0
"""The page of a simulation: run, pause, step, restart, change the level, drag the cloth."""

from __future__ import annotations

import time

import numpy as np

from .. import _core
from ..options import nested, option_table
from ..simulation import Simulation
from .page import Page
from .panel import Panel, facts_of, table_of, text_of
from .quantities import contact_counts
from .surface import Moment, Surface
from .viewer import Viewer

AUDITED = 50_000  # cloth triangles up to which intersections are counted in every frame unless the user says otherwise
FASTEST = 3.0  # m/s: speed of a vertex that follows a handle


class Grip:
    """Cloth vertices that follow a handle.

    Args:
        vertices: Vertices [k]; the first is the one that was clicked.
        positions: Their positions [k, 3], m.
        handle: viser's transform handle.
    """

    def __init__(self, vertices, positions, handle):
        self.vertices, self.handle = vertices, handle
        self._at, self._offsets = positions[0].copy(), positions - positions[0]

    def move(self, simulation):
        """Sets the targets of the next step, on the way to the handle, at most at FASTEST."""
        way = np.asarray(self.handle.position) - self._at
        distance, most = float(np.linalg.norm(way)), FASTEST * simulation.time_step
        if distance == 0:
            return
        self._at = self._at + way * min(1.0, most / distance)
        simulation.set_targets(self.vertices, self._at + self._offsets, duration=simulation.time_step)


class Live(Viewer):
    """A viewer of a simulation.

    The page's thread computes the steps while it runs. Other threads may read the simulation at any time, and step it
    while the page is paused; `update` shows what they computed.

    Args:
        simulation: The Simulation.
        host, port: Address to serve at; None: a free port.

    Attributes:
        simulation: The Simulation; another one after the level was changed in the page.

    Raises:
        BackendError: viser is not installed, or the address cannot be served.
    """

    def __init__(self, simulation: Simulation, host: str = "127.0.0.1", port: int | None = None) -> None:
        self.simulation, self.surface = simulation, Surface.of_simulation(simulation)
        super().__init__(host, port, f"cama: {simulation.scene.name or 'scene'}")
        self._start = simulation._core.checkpoint()
        self._given = {
            row["name"]: simulation.options[row["name"]] for row in simulation.chosen_options if row["origin"] == "user"
        }
        self._running, self._frames, self._left = False, 0, 0
        self._next, self._milliseconds, self._grips = 0.0, [], []
        self._page = Page(self._server, self.surface, self.surface.seen(simulation.positions))
        self._add_controls()
        self._panel = Panel(self._server, self.surface, self._page, lambda: self._post(self._show))
        self._add_timings()
        self._server.scene.on_click()(self._clicked)
        self._show()
        self._thread.start()

    def _add_controls(self):
        gui, level = self._server.gui, self.simulation.options["accuracy"]
        with gui.add_folder("Simulation"):
            self._problem = gui.add_markdown("", visible=False)
            self._button = gui.add_button("Run")
            step = gui.add_button("Step one frame")
            restart = gui.add_button("Restart")
            self._level = gui.add_dropdown("accuracy", tuple(_core.accuracy_levels()), initial_value=level)
            self._audit = gui.add_checkbox(
                "count intersections", self.simulation.cloth_triangle_count <= AUDITED, hint="in every frame, exactly"
            )
        with gui.add_folder("Hold cloth"):
            gui.add_markdown("Click on cloth, then drag the arrows.")
            self._radius = gui.add_number(
                "radius, m", float(f"{0.02 * self._page.size:.2g}"), min=0.0, step=0.001, hint="of what a click holds"
            )
            release = gui.add_button("Let go of all")
        self._button.on_click(lambda _: self.pause() if self._running else self.run())
        step.on_click(lambda _: self._post(self._step_once))
        restart.on_click(lambda _: self._post(self._restart))
        release.on_click(lambda _: self._post(self._let_go))
        self._level.on_update(
            lambda event: event.client is not None and self._post(self._set_level, event.target.value)
        )

    def _add_timings(self):
        with self._server.gui.add_folder("Timings", expand_by_default=False):
            self._timings = self._server.gui.add_markdown("")

    def run(self) -> None:
        """Computes frames until `pause`, at most in real time, as the button does."""
        self._post(self._set_running, True)

    def pause(self) -> None:
        """Stops after the step that is computed now, as the button does."""
        self._running = False
        self._post(self._set_running, False)
        self._post(self._show)

    def update(self) -> None:
        """Shows the present state, after steps of your own."""
        self._post(self._show)

    def _set_running(self, running):
        self._running, self._button.label = running, "Pause" if running else "Run"
        self._next = time.monotonic()
        if running:
            self._problem.visible = False

    def _tick(self):
        if not self._running:
            return None
        ahead = self._next - time.monotonic()
        if ahead > 0:
            return ahead
        if self._compute(lambda: self._running and not self._closed):
            self._show()
            self._next = max(self._next + self.simulation.scene.seconds_per_frame, time.monotonic())
        return 0.0

    def _step_once(self):
        self._set_running(False)
        self._compute(lambda: not self._closed)
        self._show()

    def _compute(self, wanted):
        """Computes steps to the end of a frame, while they are wanted; returns whether the frame is done."""
        simulation = self.simulation
        if not self._left:
            self._left, self._milliseconds = simulation.steps_per_frame or -1, []
        while self._left and wanted():
            for grip in self._grips:
                grip.move(simulation)
            simulation.step()
            self._milliseconds.append(simulation.report["milliseconds"])
            if self._left > 0:
                self._left -= 1
            elif simulation._core.frame_ended():
                self._left = 0
        self._frames += not self._left
        return not self._left

    def _restart(self):
        """Puts the state back to that when the viewer was opened."""
        self._let_go()
        self.simulation._core.restore(self._start)
        self._frames = self._left = 0
        self._milliseconds = []
        self._problem.visible = False
        self._show()

    def _set_level(self, level):
        """Goes on with another level, from the present state."""
        before = self.simulation
        kept = {row["name"] for row in option_table() if not row["trades"] and len({*row["levels"].values()}) == 1}
        kept -= {"accuracy", "backend"}
        given = nested({**{name: before.options[name] for name in kept}, **self._given})
        try:
            simulation = Simulation(before.scene, backend=before.backend, accuracy=level, **given)
            simulation._core.restore(before._core.checkpoint())
        except BaseException:
            self._level.value = before.options["accuracy"]
            raise
        simulation.before_step = before.before_step
        self.simulation, self._left = simulation, 0
        self._show()

    def _clicked(self, event):
        self._post(self._hold, event.ray_origin, event.ray_direction)

    def _hold(self, origin, direction):
        """Pins the cloth around the place that a ray meets, and shows a handle there."""
        simulation, x = self.simulation, self.simulation.positions
        vertex = self._page.pick(self._moment(), origin, direction)
        if vertex is None:
            return
        first, last = next(r for r in simulation.cloth_ranges if r[0] <= vertex < r[1])
        near = first + np.flatnonzero(np.linalg.norm(x[first:last] - x[vertex], axis=1) <= self._radius.value)
        vertices = np.concatenate([[vertex], near[near != vertex]])
        simulation.pin(vertices)
        handle = self._server.scene.add_transform_controls(
            f"/hold {vertex}",
            scale=0.12 * self._page.size,
            disable_rotations=True,
            depth_test=False,
            position=x[vertex],
        )
        self._grips = [grip for grip in self._grips if grip.vertices[0] != vertex]
        self._grips.append(Grip(vertices, x[vertices], handle))

    def _let_go(self):
        """Releases what handles hold."""
        for grip in self._grips:
            self.simulation.release(grip.vertices)
            grip.handle.remove()
        self._grips = []

    def _moment(self):
        simulation = self.simulation
        return Moment(
            simulation.time,
            simulation.positions,
            lambda: simulation.velocities,
            lambda: contact_counts(simulation.contacts, simulation.cloth_vertex_count),
            simulation.report["contacts"] if simulation.step_count else 0,
            simulation.count_intersections() if self._audit.value else None,
        )

    def _show(self):
        simulation, moment = self.simulation, self._moment()
        with self._server.atomic():
            self._panel.show(moment)
            self._panel.facts.content = facts_of(moment, self._more())
            self._timings.content = table_of(
                [(name, f"{value:.3g}") for name, value in simulation.timings.items() if "/" not in name],
                ("stage of the last step", "ms"),
            )

    def _more(self):
        simulation, times = self.simulation, self._milliseconds
        rows = [
            ("scene", text_of(simulation.scene.name or "scene")),
            ("computed on", f"{simulation.backend}, {simulation.options['accuracy']}"),
            ("triangles", f"{simulation.cloth_triangle_count:,}"),
            ("frame", f"{self._frames:,}"),
        ]
        if times:
            rows.append(("steps", f"{len(times)} of {np.mean(times):.3g} ms in {np.sum(times):.4g} ms a frame"))
        return rows

    def _say(self, problem):
        self._set_running(False)
        self._problem.content, self._problem.visible = f"**{type(problem).__name__}:** {text_of(problem)}", True
