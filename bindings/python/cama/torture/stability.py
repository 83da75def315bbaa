# SPDX-License-Identifier: Apache-2.0
"""Runs the checks of `cama.torture.table`, each in a process of its own, and writes what was seen."""

import csv
import json
import multiprocessing
import os
import time
import warnings
from dataclasses import asdict, dataclass, fields
from multiprocessing.connection import wait
from pathlib import Path

import cama

from . import judge, table
from .probe import Probe, Wrong

__all__ = ["Outcome", "perform", "read", "run", "write"]

COLUMNS = (
    "number",
    "check",
    "backend",
    "precision",
    "accuracy",
    "outcome",
    "good",
    "known",
    "steps",
    "intersections",
    "strain",
    "energy_ratio",
    "error",
    "note",
    "seconds",
)


CUT_OFF = "did not end within"


@dataclass
class Outcome:
    """What one check did on one backend in one precision."""

    number: int
    check: str
    backend: str
    precision: str
    accuracy: str
    outcome: str = ""  #: "ok", "ok: CollisionError", or what went wrong
    good: bool = False  #: as expected
    known: str = ""  #: where it is not: the fault that the table knows of
    steps: int = 0
    intersections: int = 0  #: most in a step, by any judge
    strain: float = 0.0  #: largest
    energy_ratio: float = None  #: kinetic energy at the end over its peak; None: nothing moved
    error: str = ""  #: class and text of an error of cama
    note: str = ""
    seconds: float = 0.0

    @property
    def cut_off(self):
        """Whether it was ended because of its wall time: nothing is known of it."""
        return self.outcome.startswith(CUT_OFF)

    @property
    def excused(self):
        """Whether it is good, or not good as the table knows."""
        return self.good or bool(self.known)


def perform(check, backend="cpu", precision="double", accuracy="production", threads=1):
    """Runs one check in this process. Returns an Outcome; only an interrupt is passed on."""
    probe = Probe(backend, precision, accuracy, threads)
    result = Outcome(check.number, check.name, backend, precision, accuracy)
    begin = time.perf_counter()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", cama.PlausibilityWarning)  # the checks are about such values
            check.body(probe)
        result.outcome, result.good = (
            ("ok", True) if not check.error else (f"expected {check.error}, nothing was thrown", False)
        )
    except Wrong as problem:
        result.outcome = str(problem)
    except cama.Error as problem:
        probe.seen.error = f"{type(problem).__name__}: {problem}"
        result.good = type(problem).__name__ == check.error and check.words in str(problem)
        other = f" (expected {check.error} with {check.words!r})" if check.error else ""
        result.outcome = f"ok: {check.error}" if result.good else probe.seen.error + other
    except Exception as problem:  # a bare exception of Python is a failure too
        result.outcome = f"not an error of cama: {type(problem).__name__}: {problem}"
    result.seconds = time.perf_counter() - begin
    seen = probe.seen
    result.steps, result.intersections, result.strain = seen.steps, seen.intersections, float(seen.strain)
    result.energy_ratio, result.error, result.note = seen.energy_ratio, seen.error, seen.note
    result.known = "" if result.good else check.known(result.outcome, precision)
    return result


def _work(pipe, name, *where):
    """What a process of its own does."""
    pipe.send(perform(table.select([name])[0], *where))
    pipe.close()


def _context():
    methods = multiprocessing.get_all_start_methods()
    if "forkserver" not in methods:
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["cama.torture.table", "cama.torture.probe"])
    return context


def run(
    checks,
    backends=("cpu",),
    precisions=("double", "mixed", "single"),
    accuracy="production",
    limit=120.0,
    jobs=1,
    long=False,
    each=None,
):
    """Runs checks on backends in precisions; returns Outcomes in the order of checks.

    limit: s of wall time for one.  jobs: processes at once.  long: the long ones too.  each: called with every Outcome.
    A process that dies or does not end in time is an Outcome too. Ctrl-C ends the processes and gives what is done.
    """
    tasks = [
        (c, b, p) for b in backends for p in precisions for c in checks if c.applies(b, p) and (long or not c.long)
    ]
    context, waiting, running, done = _context(), list(tasks), {}, {}
    try:
        while waiting or running:
            while waiting and len(running) < jobs:
                task = waiting.pop(0)
                check, backend, precision = task
                here, there = context.Pipe(duplex=False)
                process = context.Process(
                    target=_work, args=(there, check.name, backend, precision, accuracy), daemon=True
                )
                process.start()
                there.close()
                running[here] = (task, process, time.perf_counter())
            ready = wait(list(running), timeout=0.2)
            for pipe in list(running):
                task, process, begin = running[pipe]
                seconds = time.perf_counter() - begin
                if pipe not in ready and seconds < limit:
                    continue
                done[_key(task)] = outcome = _result(pipe, pipe in ready, task, process, accuracy, seconds, limit)
                del running[pipe]
                if each:
                    each(outcome)
    except KeyboardInterrupt:
        pass
    finally:
        for _, process, _ in running.values():
            process.kill()
    return [done[_key(task)] for task in tasks if _key(task) in done]


def _key(task):
    return task[0].name, *task[1:]


def _result(pipe, ready, task, process, accuracy, seconds, limit):
    """What a process sent, or how it ended."""
    check, backend, precision = task
    try:
        result = pipe.recv() if ready else None
    except EOFError:
        result = None
    if not ready:
        process.kill()
    process.join()
    pipe.close()
    if result is None:
        result = Outcome(check.number, check.name, backend, precision, accuracy, seconds=seconds)
        result.outcome = f"ended with code {process.exitcode}" if ready else f"{CUT_OFF} {limit:g} s"
    return result


def write(outcomes, folder, page=None, checks=None):
    """Writes folder/stability.csv, .json and .md; page: where else the page goes. Returns the folder."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    rows = [asdict(o) for o in outcomes]
    with open(folder / "stability.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(rows)
    skipped = [
        {"number": c.number, "check": c.name, "reason": c.reason} for c in checks or table.CHECKS if c.body is None
    ]
    described = {"cama": cama.__version__, "checks": rows, "not_run": skipped}
    (folder / "stability.json").write_text(json.dumps(described, indent=1), encoding="utf-8")
    text = markdown(outcomes, checks or table.CHECKS)
    for path in (folder / "stability.md", *([page] if page else [])):
        Path(path).write_text(text, encoding="utf-8")
    return folder


def read(path):
    """The Outcomes of a stability.json, as `write` left it, here or on another machine. Raises FileError.

    Whether a fault is known is asked of the table of now.
    """
    try:
        rows = json.loads(Path(path).read_text(encoding="utf-8"))["checks"]
        outcomes = [Outcome(**row) for row in rows]
        for field in fields(Outcome):
            for o in outcomes:
                value = getattr(o, field.name)
                if type(value) is not field.type and not (field.type is float and type(value) in (int, type(None))):
                    raise TypeError(f"{field.name} of {o.check!r} is {value!r}")
    except (OSError, ValueError, KeyError, TypeError) as problem:
        raise cama.FileError(
            f"{path}: not the results of cama stability ({type(problem).__name__}: {problem}); "
            "give a stability.json that it wrote"
        ) from problem
    checks = {check.name: check for check in table.CHECKS}
    for o in outcomes:
        if o.check in checks and not o.good and not o.cut_off:
            o.known = checks[o.check].known(o.outcome, o.precision)
    return outcomes


def _number(value):
    return "-" if value is None else f"{value:.2g}"


def _cell(check, backend, precision, outcome):
    """Of the matrix."""
    if outcome is None:
        return "not run" if check.applies(backend, precision) else "-"
    if outcome.good:
        return (
            outcome.error.split(":")[0] if outcome.error and not outcome.steps else outcome.outcome.replace("ok: ", "")
        )
    return "**known**" if outcome.known else "cut off" if outcome.cut_off else "**fails**"


def _plain(text):
    return " ".join(text.replace("|", "/").split())


def _largest(values):
    values = [v for v in values if v is not None]
    return max(values) if values else None


def markdown(outcomes, checks):
    """The page: a matrix of checks and configurations, what was seen, what did not hold, what was not run."""
    configurations = list(dict.fromkeys((o.backend, o.precision) for o in outcomes))
    of = {(o.check, o.backend, o.precision): o for o in outcomes}
    levels = ", ".join(dict.fromkeys(o.accuracy for o in outcomes))
    good, known, cut = (
        (sum(test) for test in zip(*((o.good, bool(o.known), o.cut_off) for o in outcomes))) if outcomes else (0, 0, 0)
    )
    lines = [
        "# Stability: every check on every backend",
        "",
        "<!-- written by `cama stability --page results/stability-DATE.md` -->",
        "",
        "Cases that break cloth simulators, on each backend and in each precision.",
        "[Stability](../docs/reference/stability.md) says what is checked and where the expectations come from. Every",
        f"step of every run is checked for values that are not finite and for intersections, by {judge.JUDGES}.",
        "",
        f"cama {cama.__version__}, {time.strftime('%Y-%m-%d')}, accuracy {levels}: {good} of {len(outcomes)} as "
        f"expected, {known} known to fail, {cut} cut off, {len(outcomes) - good - known - cut} failed otherwise.",
        "",
        "- *ok*, or the name of the expected error; **known**: a fault that is listed below; **fails**: anything else.",
        "- *cut off*: did not end within its wall time, which other runs on the same machine shared.",
        "- *-*: does not apply there. *not run*: long, or see the end of the page.",
        "- *steps* is of one configuration; *intersections*, *strain* (largest principal stretch minus one) and",
        "  *energy* (kinetic energy at the end over its peak) are the largest of all configurations. Checks that start",
        "  with intersections intentionally (`exempt`) and those without contact show how many there were.",
        "",
        "| | check | "
        + " | ".join(f"{b} {p}" for b, p in configurations)
        + " | steps | intersections | strain | energy |",
        "|---|---|" + "---|" * (len(configurations) + 4),
    ]
    for check in checks:
        own = [of[check.name, b, p] for b, p in configurations if (check.name, b, p) in of]
        cells = (
            [_cell(check, b, p, of.get((check.name, b, p))) for b, p in configurations]
            if check.body
            else ["not run"] + [""] * (len(configurations) - 1)
        )
        figures = (
            [
                max(o.steps for o in own),
                max(o.intersections for o in own),
                _number(_largest(o.strain for o in own)),
                _number(_largest(o.energy_ratio for o in own)),
            ]
            if own and any(o.steps for o in own)
            else [""] * 4
        )
        lines.append(f"| {check.number} | `{check.name}` | " + " | ".join(str(c) for c in [*cells, *figures]) + " |")
    lines += ["", "## What is expected", "", "| | about | check | expected | seen |", "|---|---|---|---|---|"]
    last = None
    for check in checks:
        notes = list(dict.fromkeys(o.note for o in outcomes if o.check == check.name and o.note))
        about = table.NUMBERS[check.number] if check.number != last else ""
        lines.append(
            f"| {check.number} | {about} | `{check.name}` | {_plain(check.expected)} | "
            f"{_plain(notes[0]) if notes else ''} |"
        )
        last = check.number
    wrong = [o for o in outcomes if not o.good]
    if wrong:
        lines += ["", "## What does not hold", "", "| check | where | seen | why |", "|---|---|---|---|"]
        texts = {}
        for o in wrong:
            texts.setdefault((o.check, o.known), []).append(o)
        for (name, why), own in texts.items():
            places = ", ".join(f"{o.backend} {o.precision}" for o in own)
            lines.append(
                f"| `{name}` | {places} | {_plain(own[0].outcome)[:300]} | "
                f"{_plain(why) or ('cut off' if own[0].cut_off else 'not known')} |"
            )
    ran = {o.check for o in outcomes}
    idle = [c for c in checks if c.body is None] + [
        c for c in checks if c.body is not None and c.long and c.name not in ran
    ]
    if idle:
        lines += ["", "## What was not run", "", "| | check | why |", "|---|---|---|"]
        lines += [f"| {c.number} | `{c.name}` | {_plain(c.reason) or 'long: with `--long`'} |" for c in idle]
    return "\n".join(lines) + "\n"


def default_jobs():
    """Processes at once: one for two processors."""
    return max(1, (os.cpu_count() or 1) // 2)
