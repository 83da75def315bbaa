# SPDX-License-Identifier: Apache-2.0
"""Textile tests of fabrics, simulated, and fabrics from measurements.

`test` runs the cantilever, strip tensile, picture frame and drape tests on a material and puts the results beside
closed forms and published values; `fit` finds a material from measured values.
"""

from .bending import Cantilever, cantilever
from .draping import Drape, drape
from .fitting import Fit, Measured, fit
from .published import Published, published
from .report import TESTS, Report, Row, test
from .shear import PictureFrame, picture_frame
from .stretching import Tensile, tensile

__all__ = [
    "TESTS",
    "Cantilever",
    "Drape",
    "Fit",
    "Measured",
    "PictureFrame",
    "Published",
    "Report",
    "Row",
    "Tensile",
    "cantilever",
    "drape",
    "fit",
    "picture_frame",
    "published",
    "tensile",
    "test",
]
