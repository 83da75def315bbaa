# SPDX-License-Identifier: Apache-2.0
"""Runs independent tasks in a pool of processes on this machine, or on an existing Ray cluster."""

import itertools
import multiprocessing
import multiprocessing.connection
import socket
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass

from ..errors import ArrayError, BackendError
from ..hints import require
from ..processes import follow_parent, submit, terminate

_shared = None


@dataclass
class Failure:
    """What a task that failed gives in place of a result."""

    text: str  #: "CollisionError: ..."


def _receive(shared):
    """Starts a new process: it ignores Ctrl-C, which is for the parent, and ends with its parent."""
    global _shared
    _shared = shared
    follow_parent()


def _call(function, task):
    return guarded(function, task, _shared)


def guarded(function, task, shared):
    """Returns function(task, shared), or the Failure that its exception becomes."""
    try:
        return function(task, shared)
    except Exception as problem:  # whatever a task throws ends that task alone
        return Failure(f"{type(problem).__name__}: {problem}")


class Local:
    """Processes of this machine. jobs: how many at once; 0: in this process, one after the other."""

    def __init__(self, jobs=1):
        if jobs < 0:
            raise ArrayError(f"jobs: {jobs} is negative")
        self.jobs = jobs

    def run(self, function, tasks, shared=None, jobs=None):
        """Yields (index, result or Failure) in the order in which tasks end.

        A process that dies (out of memory, a crash) is a Failure of its task.

        function(task, shared) is importable from the top of a module; tasks, shared and results can be pickled; shared
        goes to a process once.
        """
        jobs = self.jobs if jobs is None else jobs
        if jobs == 0:
            for index, task in enumerate(tasks):
                yield index, guarded(function, task, shared)
            return
        left, suspects = list(enumerate(tasks)), []
        while left:
            suspects += yield from self._pool(function, left, shared, jobs)
        for suspect in suspects:  # alone, the one to blame is known
            yield from self._pool(function, [suspect], shared, 1)

    def _pool(self, function, left, shared, jobs):
        """Runs the tasks of `left`, which it empties, and yields what ends.

        Returns the tasks that were running when a process died. If there was only one, it caused that and is a Failure.
        """
        running, dead = {}, []
        pool = ProcessPoolExecutor(min(jobs, len(left)), multiprocessing.get_context("spawn"), _receive, (shared,))
        try:
            while left or running:
                while left and len(running) < jobs and not dead:
                    try:
                        future = submit(pool, _call, function, left[0][1])
                    except BrokenProcessPool:
                        if not running:  # a process ended between tasks: another pool takes what is left
                            terminate(pool)
                            return []
                        break
                    running[future] = left.pop(0)
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    index, task = running.pop(future)
                    try:
                        result = future.result()
                    except BrokenProcessPool:
                        dead.append((index, task))
                        continue
                    yield index, result
                if dead:
                    terminate(pool)
                    dead += running.values()
                    running.clear()
                    break
        except BaseException:  # Ctrl-C, or a caller that wants no more results: what runs is ended
            terminate(pool)
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
        if len(dead) == 1:
            yield dead[0][0], Failure("ProcessDied: the process that ran this ended without a result")
            return []
        return dead

    def close(self):
        """Does nothing."""


def answers(address, seconds=5.0):
    """Raises OSError if nothing listens at HOST:PORT or ray://HOST:PORT; Ray itself would try for minutes."""
    host, colon, port = address.rpartition("//")[2].rpartition(":")
    if colon and port.isdigit():
        socket.create_connection((host.strip("[]"), int(port)), seconds).close()


class Cluster:
    """An existing Ray cluster.

    A task takes one CPU, and one GPU if the cluster has some and `gpu` is set. Raises BackendError if Ray is not
    installed (`pip install ray`) or there is no cluster.

    Args:
        address: "auto", "host:6379" or "ray://host:10001".
        jobs: Tasks at once; 0: as many as the cluster has room for.
        gpu: Whether tasks use a GPU.
    """

    def __init__(self, address, jobs=0, gpu=False):
        require("cluster: running on Ray", "ray")
        import ray

        self._ray, self._own = ray, not ray.is_initialized()
        try:
            if self._own:
                answers(address)
                ray.init(address=address, log_to_driver=False, logging_level="error", configure_logging=False)
        except Exception as problem:
            raise BackendError(f"cluster: no Ray cluster at {address!r}: {problem}") from None
        there = ray.cluster_resources()
        self.gpus = int(there.get("GPU", 0)) if gpu else 0
        self.jobs = jobs or max(1, self.gpus or int(there.get("CPU", 1)))

    def run(self, function, tasks, shared=None, jobs=None):
        """As Local.run."""
        ray = self._ray
        remote = ray.remote(num_cpus=1, num_gpus=1 if self.gpus else 0, max_retries=0)(guarded)
        place, waiting, running = ray.put(shared), iter(enumerate(tasks)), {}
        jobs = jobs if jobs else self.jobs
        try:
            while True:
                for index, task in itertools.islice(waiting, jobs - len(running)):
                    running[remote.remote(function, task, place)] = index
                if not running:
                    return
                done, _ = ray.wait(list(running), num_returns=1)
                for reference in done:
                    index = running.pop(reference)
                    try:
                        yield index, ray.get(reference)
                    except ray.exceptions.RayError as problem:
                        yield index, Failure(f"{type(problem).__name__}: {str(problem).strip().splitlines()[-1]}")
        finally:
            for reference in running:
                ray.cancel(reference, force=True)

    def close(self):
        """Leaves the cluster, which continues to run."""
        if self._own:
            self._ray.shutdown()


def make(cluster=None, jobs=1, gpu=False):
    """Returns a Cluster at an address, or Local without one."""
    return Cluster(cluster, 0, gpu) if cluster else Local(jobs)
