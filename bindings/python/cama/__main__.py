# SPDX-License-Identifier: Apache-2.0
"""`python -m cama` is the command `cama`."""

from .cli.main import main

if __name__ == "__main__":
    main()
