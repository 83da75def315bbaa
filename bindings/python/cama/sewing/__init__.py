# SPDX-License-Identifier: Apache-2.0
"""Sewing patterns: read, meshed, placed around a body, sewn and draped."""

from .dressing import dress
from .pattern import Edge, Elastic, Panel, Seam, SewingPattern
from .result import Dressed, Verdict

__all__ = ["Dressed", "Edge", "Elastic", "Panel", "Seam", "SewingPattern", "Verdict", "dress"]
