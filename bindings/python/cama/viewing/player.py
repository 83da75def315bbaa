# SPDX-License-Identifier: Apache-2.0
"""The page of a recording: play, pause, scrub."""

import time

import numpy as np

from ..io.recording import Recording
from .page import Page
from .panel import Panel, facts_of, text_of
from .quantities import velocities_between
from .surface import Moment, Surface
from .viewer import Viewer

SPEEDS = {"1/16": 1 / 16, "1/8": 1 / 8, "1/4": 1 / 4, "1/2": 1 / 2, "1": 1.0, "2": 2.0, "4": 4.0}
MOST = 30.0  # frames a second that are sent


class Player(Viewer):
    """A viewer of a recording.

    Args:
        path: frames.h5 or its folder.
        host, port: Address to serve at; None: a free port.

    Raises:
        FileError: It is no recording.
        BackendError: viser is not installed, or the address cannot be served.
    """

    def __init__(self, path, host="127.0.0.1", port=None):
        self._recording = Recording(path)
        try:
            self.surface = Surface.of_recording(self._recording)
            name = self._recording.attributes.get("scene", "") or "recording"
            super().__init__(host, port, f"cama: {name}")
        except BaseException:
            self._recording.close()
            raise
        self._playing, self._frame, self._shown, self._sent = False, 0, None, 0.0
        self._clock = 0.0  # time.monotonic() at the recording's first frame, while it plays
        page = Page(self._server, self.surface, self._seen())
        self._add_playback()
        self._panel = Panel(self._server, self.surface, page, lambda: self._post(self._show))
        self._show()
        self._thread.start()

    def _seen(self):
        """What the camera should see over the recording."""
        some = np.unique(np.linspace(0, len(self._recording) - 1, 8).astype(int))
        return np.concatenate([self.surface.seen(self._recording.frame(i)) for i in some])

    def _add_playback(self):
        gui, last = self._server.gui, len(self._recording) - 1
        with gui.add_folder("Playback"):
            self._slider = gui.add_slider("frame", 0, max(last, 1), 1, 0, disabled=last == 0)
            self._speed = gui.add_dropdown("speed", tuple(SPEEDS), initial_value="1")
            self._loop = gui.add_checkbox("repeat", True)
            self._button = gui.add_button("Play", disabled=last == 0)
            step = gui.add_button_group("step", ("◀", "▶"))
        self._button.on_click(lambda _: self._post(self._play, not self._playing))
        self._slider.on_update(lambda event: event.client is not None and self._post(self._scrub, event.target.value))
        self._speed.on_update(lambda _: self._post(self._set_clock))
        step.on_click(lambda event: self._post(self._scrub, self._frame + (1 if event.target.value == "▶" else -1)))

    def _play(self, playing):
        times = self._recording.times
        if playing and self._frame >= len(times) - 1:
            self._frame = 0
        self._playing, self._button.label = playing, "Pause" if playing else "Play"
        self._set_clock()

    def _set_clock(self):
        times = self._recording.times
        self._clock = time.monotonic() - (times[self._frame] - times[0]) / SPEEDS[self._speed.value]

    def _scrub(self, frame):
        self._frame = int(np.clip(frame, 0, len(self._recording) - 1))
        self._set_clock()

    def _tick(self):
        if self._playing:
            self._frame = self._due_frame()
        if self._shown != self._frame:
            self._show()
        if not self._playing:
            return None
        return max(0.0, min(1 / MOST - (time.monotonic() - self._sent), 1 / MOST))

    def _due_frame(self):
        """The frame of this moment; frames that are due while another is sent are left out."""
        times, speed = self._recording.times, SPEEDS[self._speed.value]
        now = times[0] + (time.monotonic() - self._clock) * speed
        if now > times[-1] + 1e-9:
            if not self._loop.value:
                self._play_ends()
                return len(times) - 1
            self._clock = time.monotonic()
            now = times[0]
        return max(0, int(np.searchsorted(times, now + 1e-9, side="right")) - 1)

    def _play_ends(self):
        self._playing, self._button.label = False, "Play"

    def moment(self, frame):
        """Returns the Moment of a frame."""
        recording, times = self._recording, self._recording.times

        def velocities():
            before, after = max(frame - 1, 0), min(frame + 1, len(times) - 1)
            return velocities_between(
                recording.frame(before), recording.frame(after), float(times[after] - times[before])
            )

        return Moment(
            float(times[frame]),
            recording.frame(frame),
            velocities,
            None,
            None if recording.contacts is None else int(recording.contacts[frame]),
            None if recording.intersections is None else int(recording.intersections[frame]),
        )

    def _show(self):
        self._sent = time.monotonic()
        moment = self.moment(self._frame)
        with self._server.atomic():
            self._panel.show(moment)
            self._slider.value = self._frame
            self._panel.facts.content = facts_of(
                moment, [("frame", f"{self._frame:,} of {len(self._recording) - 1:,}")]
            )
        self._shown = self._frame

    def _say(self, problem):
        self._panel.facts.content = f"**{type(problem).__name__}:** {text_of(problem)}"

    def close(self):
        """As Viewer.close; closes the file too."""
        super().close()
        self._recording.close()
