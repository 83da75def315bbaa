# SPDX-License-Identifier: Apache-2.0
"""Damages files of every kind that cama reads, and looks what becomes of them: python tests/fuzz/fuzz.py --cases 10000.

No case may crash its process, take more than 10 s, raise what is not a `cama.Error`, or give a number that is not
finite. Processes run many cases each; where one dies or hangs, the case is noted and the next process goes on behind
it. The cases of a seed are always the same; `--first N --cases 1` repeats one, and `--keep DIR` keeps the files of
those that fail.
"""

import argparse
import collections
import json
import os
import queue
import resource
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
SLOW = 10.0  # s of processor time
HANG = 300.0  # s of wall time, after which a process is stopped; a busy machine may take long over a case
MEMORY = 6 * 2**30  # bytes of address space of a process
CHUNK = 250  # cases of a process


def work(seed, first, last, seed_folder, folder):
    """Runs cases in this process; prints one line before and one after each."""
    import cases
    import seeds

    limit = resource.getrlimit(resource.RLIMIT_AS)[1]
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, limit))
    files = seeds.listed(seed_folder)

    def spent():
        return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))

    for number in range(first, last):
        print(json.dumps({"case": number}), flush=True)
        before = spent()
        kind, outcome, problem = cases.run(seed, number, files, folder)
        took = spent() - before
        if not problem and took > SLOW:
            problem = f"took {took:.0f} s of processor time"
        print(json.dumps({"case": number, "kind": kind, "outcome": outcome, "problem": problem[:300]}), flush=True)


class Supervisor:
    """Runs all cases in processes of CHUNK cases each."""

    def __init__(self, seed, first, count, jobs, keep):
        self.seed, self.keep = seed, keep
        self.outcomes = collections.Counter()  #: of (kind, outcome)
        self.problems = []  #: dicts with case, kind and problem
        self._chunks = queue.Queue()
        for start in range(first, first + count, CHUNK):
            self._chunks.put((start, min(start + CHUNK, first + count)))
        self._jobs, self._lock = jobs, threading.Lock()

    def run(self):
        with tempfile.TemporaryDirectory(prefix="cama-fuzz-") as folder:
            import seeds

            seeds.write(Path(folder) / "seeds")
            threads = [threading.Thread(target=self._serve, args=(Path(folder), k)) for k in range(self._jobs)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            self.problems.sort(key=lambda row: row["case"])
            if self.keep:
                self._write(Path(folder) / "seeds")

    def _serve(self, folder, number):
        while True:
            try:
                first, last = self._chunks.get_nowait()
            except queue.Empty:
                return
            while first < last:
                first = self._chunk(first, last, folder, folder / f"case{number}")

    def _chunk(self, first, last, folder, place):
        """Runs cases until they are done or their process ends; returns the case to go on with."""
        words = [sys.executable, str(HERE / "fuzz.py"), "--worker", str(first), str(last), str(folder / "seeds")]
        process = subprocess.Popen(
            [*words, str(place), "--seed", str(self.seed)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        lines = queue.Queue()
        reader = threading.Thread(target=lambda: [lines.put(line) for line in process.stdout] + [lines.put("")])
        reader.start()
        number, hung = first - 1, False
        while True:
            try:
                line = lines.get(timeout=HANG)
            except queue.Empty:
                hung = True
                process.kill()
                break
            if not line:
                break
            row = json.loads(line)
            number = row["case"]
            if "kind" in row:
                self._note(row)
        process.wait()
        reader.join()
        if process.returncode == 0 and not hung:
            return last
        how = f"no answer within {HANG:.0f} s" if hung else f"the process ended with {process.returncode}"
        if number < first:
            raise RuntimeError(f"no case was begun: {how}")
        kind = next((path.name for path in sorted(place.glob("*.*"))), "?")
        self._note({"case": number, "kind": kind, "outcome": "crash", "problem": how})
        return number + 1

    def _note(self, row):
        with self._lock:
            self.outcomes[row["kind"], row["outcome"]] += 1
            if row["problem"]:
                self.problems.append(row)
                print(f"case {row['case']}, {row['kind']}: {row['problem']}", flush=True)

    def _write(self, seed_folder):
        """Writes the files of the cases with a problem."""
        import cases
        import seeds

        files = seeds.listed(seed_folder)
        for row in self.problems:
            cases.make(self.seed, row["case"], files, self.keep / str(row["case"]))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=min(2, os.cpu_count() or 1))
    parser.add_argument("--keep", type=Path, help="folder for the files of cases that fail")
    parser.add_argument("--worker", nargs=4, metavar=("FIRST", "LAST", "SEEDS", "FOLDER"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.worker:
        work(given.seed, int(given.worker[0]), int(given.worker[1]), given.worker[2], given.worker[3])
        return 0
    began = time.time()
    supervisor = Supervisor(given.seed, given.first, given.cases, given.jobs, given.keep)
    supervisor.run()
    for (kind, outcome), count in sorted(supervisor.outcomes.items()):
        print(f"{kind:12s} {outcome:16s} {count:6d}")
    total = sum(supervisor.outcomes.values())
    print(f"{total} cases of seed {given.seed} in {time.time() - began:.0f} s, {len(supervisor.problems)} problems")
    return 1 if supervisor.problems else 0


if __name__ == "__main__":
    sys.path.insert(0, str(HERE))
    sys.exit(main())
