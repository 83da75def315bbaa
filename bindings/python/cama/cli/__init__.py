# SPDX-License-Identifier: Apache-2.0
"""The command line: `main` has the application, the other modules have its commands."""

from .main import app

__all__ = ["app"]
