# SPDX-License-Identifier: Apache-2.0
"""The server of the page and the thread that feeds it."""

from __future__ import annotations

import atexit
import contextlib
import getpass
import html
import io
import queue
import socket
import threading
import time
import traceback
from typing import TYPE_CHECKING

from ..errors import BackendError, Error
from ..hints import require

if TYPE_CHECKING:
    from typing_extensions import Self

PORT, PORTS = 8080, 100  # the first that is tried, and how many
LOOPBACK = ("127.0.0.1", "::1", "localhost")


def free_port(host, port=None):
    """Returns the port to serve on: the given one, or the first free one from 8080 on.

    Raises BackendError if the host is no address of this machine, or the port is taken.
    """
    try:
        family, kind, protocol, _, _ = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)[0]
    except OSError as problem:
        raise BackendError(
            f"host {host!r} is no address: {problem.strerror}; 127.0.0.1 is this machine alone"
        ) from None
    for wanted in [port] if port else range(PORT, PORT + PORTS):
        with socket.socket(family, kind, protocol) as test:
            test.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                test.bind((host, wanted))
                return wanted
            except OSError as problem:
                reason = problem.strerror
    raise BackendError(
        f"cannot serve at {host}, port {port or f'{PORT} to {PORT + PORTS - 1}'}: {reason}; choose another host or port"
    )


def open_server(host, port, label):
    """Starts a viser server, without words on the terminal. Raises BackendError."""
    require("the viewer", "viser")
    import viser

    with contextlib.redirect_stdout(io.StringIO()):  # viser prints a box
        server = viser.ViserServer(host=host, port=free_port(host, port), label=label, verbose=False)
    server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="medium")
    return server


def addresses(host, port):
    """Returns (URL of the page, the command that makes it reachable from another machine, or None).

    A server on the loopback address is reached through ssh; the command goes to that machine.
    """
    shown = {"0.0.0.0": socket.gethostname(), "::": socket.gethostname()}.get(host, host)
    url = f"http://{f'[{shown}]' if ':' in shown else shown}:{port}"
    if host not in LOOPBACK:
        return url, None
    to = f"[{host}]" if ":" in host else host
    try:
        user = getpass.getuser()
    except (ImportError, KeyError, OSError):  # a user without a name, as in a container
        user = "user"
    return url, f"ssh -L {port}:{to}:{port} {user}@{socket.gethostname()}"


class Viewer:
    """A page in the browser, served by threads of this process until it is closed.

    In a notebook it shows itself as the value of a cell.

    Attributes:
        url: Address of the page.
        tunnel: Command that makes the page reachable from another machine; None: it is reachable without.
    """

    def __init__(self, host: str, port: int | None, label: str) -> None:
        self._server = open_server(host, port, label)
        self.url: str
        self.tunnel: str | None
        self.url, self.tunnel = addresses(host, self._server.get_port())
        self._posted, self._closed = queue.SimpleQueue(), False
        atexit.register(self.close)  # else the thread would step while Python ends
        self._thread = threading.Thread(target=self._run, name="cama viewer", daemon=True)

    def _tick(self):
        """Does what is due; returns in how many seconds to be called again, None: when something is posted."""
        raise NotImplementedError

    def _say(self, problem):
        """Shows an error in the page."""
        raise NotImplementedError

    def _post(self, work, *arguments):
        """Lets the viewer's thread call a function: it alone touches the file, the simulation and the meshes."""
        self._posted.put((work, arguments))

    def _run(self):
        while not self._closed:
            wait = self._guarded(self._tick)
            with contextlib.suppress(queue.Empty):
                work, arguments = self._posted.get(timeout=wait)
                self._guarded(work, *arguments)
                while True:
                    work, arguments = self._posted.get_nowait()
                    self._guarded(work, *arguments)

    def _guarded(self, work, *arguments):
        """Calls a function; an error is shown in the page, and one that is not cama's on standard error too."""
        try:
            return work(*arguments)
        except Exception as problem:
            if not isinstance(problem, Error):
                traceback.print_exc()
            self._say(problem)
            return None

    def wait(self) -> None:
        """Waits until the viewer is closed; Ctrl-C raises KeyboardInterrupt."""
        while not self._closed:
            time.sleep(0.1)

    def close(self) -> None:
        """Ends the server; the page stays as it is, without connection. More calls do nothing."""
        if self._closed:
            return
        self._closed = True
        atexit.unregister(self.close)
        self._post(lambda: None)
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout=10)
        with contextlib.redirect_stdout(io.StringIO()):  # viser prints that it stopped
            self._server.stop()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _repr_html_(self) -> str:
        """The page in a notebook's cell."""
        return f'<iframe src="{html.escape(self.url)}" width="100%" height="640" style="border:0"></iframe>'

    def __repr__(self) -> str:
        return f"<cama viewer at {self.url}{', closed' if self._closed else ''}>"
