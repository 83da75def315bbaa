# SPDX-License-Identifier: Apache-2.0
"""Runs extreme cases over seeds and backends; prints a table, writes CSV and pictures. The work is done by `cama.torture.seeds`.

python tests/extremes/run.py                          all cases, one seed, cpu
python tests/extremes/run.py knot pile --seeds 10 --jobs 2 --csv out.csv --pictures out/
python tests/extremes/run.py sphere --resolution 20000 --backend cuda --option tolerance=1e-4
"""

import os
import sys

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before the compiled module is loaded: --jobs runs processes at once

from cama.torture import seeds  # noqa: E402

if __name__ == "__main__":
    sys.exit(seeds.main())
