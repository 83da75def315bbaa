# SPDX-License-Identifier: Apache-2.0
"""The command line of cama: `main` has the application, the other modules its commands."""

from .main import app

__all__ = ["app"]
