# SPDX-License-Identifier: Apache-2.0
"""A process of its own that reads foreign files once, so that a crash or hang in their reader ends this process only.

Run as a script, by its path and with nothing but the standard library, so that it starts within a few hundredths of a
second. Its argument is the path of the compiled module. Each line of standard input is a request in JSON:
{"call": [function of the compiled module, arguments...], "memory": bytes or null, "seconds": s or null}. Each line
of standard output is the answer to one: {} if the file was read or refused as it should be, else {"problem": words}.
"""

import contextlib
import importlib.machinery
import importlib.util
import json
import os
import sys

try:
    import resource
except ImportError:  # not a system of the Unix kind: the parent's time limit is the only one
    resource = None

NO_MEMORY = "needs more memory than the limit"


def compiled(path):
    """Returns the compiled module without the package around it."""
    loader = importlib.machinery.ExtensionFileLoader("cama._core", path)
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader("cama._core", loader))
    loader.exec_module(module)
    return module


def limit(memory, seconds):
    """Limits the address space and the processor time that the next request may take beyond what is used now."""
    if resource is None:
        return
    if memory is not None:
        with contextlib.suppress(OSError, ValueError):
            with open("/proc/self/statm", encoding="ascii") as file:
                used = int(file.read().split()[0]) * resource.getpagesize()
            resource.setrlimit(resource.RLIMIT_AS, (used + memory, resource.getrlimit(resource.RLIMIT_AS)[1]))
    if seconds is not None:
        with contextlib.suppress(OSError, ValueError):
            used = sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
            resource.setrlimit(
                resource.RLIMIT_CPU, (int(used + seconds + 1), resource.getrlimit(resource.RLIMIT_CPU)[1])
            )


def answer(core, call):
    """Returns the answer to a request; an error of cama is one that the caller will raise by itself."""
    function, *arguments = call
    try:
        getattr(core, function)(*arguments)
    except core.Error as problem:
        return {"problem": NO_MEMORY} if "bad_alloc" in str(problem) else {}
    except MemoryError:
        return {"problem": NO_MEMORY}
    except Exception as problem:
        return {"problem": f"its reader failed ({type(problem).__name__}: {problem})"}
    return {}


def main():
    with contextlib.suppress(OSError), open("/proc/self/oom_score_adj", "w", encoding="ascii") as file:
        file.write("1000")  # where memory ends, this process is to end before the one that asked
    if resource is not None:
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    core = compiled(sys.argv[1])
    print(json.dumps({"process": os.getpid()}), flush=True)
    for line in sys.stdin:
        request = json.loads(line)
        limit(request["memory"], request["seconds"])
        print(json.dumps(answer(core, request["call"])), flush=True)


if __name__ == "__main__":
    main()
