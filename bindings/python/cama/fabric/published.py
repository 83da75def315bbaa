# SPDX-License-Identifier: Apache-2.0
"""Published values for cloths of the kinds that ship with cama, as ranges over samples."""

from __future__ import annotations

from dataclasses import dataclass

KES = "KES-F"  # Kawabata Evaluation System: pure bending, shear to 0.5-2.5 degrees, extension at 490 N/m
FAST = "FAST"  # Fabric Assurance by Simple Testing: extension at 98 N/m


@dataclass(frozen=True)
class Published:
    """A range of published values, which is the scatter over samples of the kind, not of one cloth."""

    low: float  #: SI
    high: float  #: SI
    source: str


def _kes(low: float, high: float) -> Published:
    return Published(low, high, KES)


# {fabric: {(quantity, direction): range}}; quantities as in report.py.
RANGES: dict[str, dict[tuple[str, str], Published]] = {
    "cotton": {
        ("flexural rigidity", "warp"): _kes(4e-6, 1.5e-5),
        ("flexural rigidity", "weft"): _kes(4e-6, 1.5e-5),
        ("tensile stiffness", "warp"): _kes(6000, 12000),
        ("tensile stiffness", "weft"): _kes(3500, 6000),
        ("shear rigidity", ""): _kes(28, 84),
        ("drape coefficient", ""): Published(0.60, 0.76, "around the 68.4 % of Gan, Ly & Steven 1991"),
    },
    "denim": {
        ("flexural rigidity", "warp"): Published(1.4e-5, 2.2e-5, "KES-F, lighter denims: J. Textiles 2016, 4614168"),
        ("tensile stiffness", "warp"): Published(8600, 10400, "KES-F, lighter denims: J. Textiles 2016, 4614168"),
        ("shear rigidity", ""): Published(84, 191, "KES-F, lighter denims: J. Textiles 2016, 4614168"),
        ("drape coefficient", ""): Published(0.70, 0.90, "heavy twills, Cusick"),
    },
    "jersey": {
        ("flexural rigidity", "warp"): _kes(1e-6, 4e-6),
        ("flexural rigidity", "weft"): _kes(1e-6, 4e-6),
        ("tensile stiffness", "warp"): Published(300, 1000, FAST),
        ("tensile stiffness", "weft"): Published(100, 670, f"{FAST}; courses extend 1.5 to 3 times as far as wales"),
        ("shear rigidity", ""): _kes(22, 73),
    },
    "leather": {
        ("tensile stiffness", "warp"): Published(14000, 56000, "20 to 80 MPa at 0.7 mm: Efendioglu 2025, ISO 3376"),
        ("tensile stiffness", "weft"): Published(14000, 56000, "20 to 80 MPa at 0.7 mm: Efendioglu 2025, ISO 3376"),
        ("drape coefficient", ""): Published(0.47, 0.70, "sheep leather, Memon et al. 2021, Materials 14, 4553"),
    },
    "linen": {
        ("flexural rigidity", "warp"): _kes(1.5e-5, 4e-5),
        ("flexural rigidity", "weft"): _kes(1.5e-5, 4e-5),
        ("tensile stiffness", "warp"): _kes(8000, 16000),
        ("tensile stiffness", "weft"): _kes(8000, 16000),
        ("shear rigidity", ""): _kes(39, 84),
    },
    "polyester": {
        ("flexural rigidity", "warp"): _kes(2e-6, 6e-6),
        ("flexural rigidity", "weft"): _kes(2e-6, 6e-6),
        ("tensile stiffness", "warp"): _kes(8000, 16000),
        ("tensile stiffness", "weft"): _kes(8000, 16000),
        ("shear rigidity", ""): _kes(17, 34),
        ("drape coefficient", ""): Published(0.20, 0.40, "limp synthetic wovens, ISO 9073-9"),
    },
    "silk": {
        ("flexural rigidity", "warp"): _kes(1e-6, 5e-6),
        ("flexural rigidity", "weft"): _kes(1e-6, 5e-6),
        ("tensile stiffness", "warp"): _kes(3000, 10000),
        ("tensile stiffness", "weft"): _kes(3000, 10000),
        ("shear rigidity", ""): _kes(11, 22),
        ("drape coefficient", ""): Published(0.20, 0.40, "Matsudaira & Yang 2003; Hu et al. 2020"),
    },
    "wool": {
        ("flexural rigidity", "warp"): _kes(6e-6, 1.5e-5),
        ("flexural rigidity", "weft"): _kes(6e-6, 1.5e-5),
        ("tensile stiffness", "warp"): Published(2500, 5000, FAST),
        ("tensile stiffness", "weft"): Published(2500, 5000, FAST),
        ("shear rigidity", ""): _kes(28, 56),
        ("drape coefficient", ""): Published(0.40, 0.70, "worsted suitings, Cusick"),
    },
}


def published(fabric: str, quantity: str, direction: str = "") -> Published | None:
    """Returns the published range of a quantity of a shipped fabric, or None."""
    return RANGES.get(fabric, {}).get((quantity, direction))
