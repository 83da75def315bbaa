# SPDX-License-Identifier: Apache-2.0
"""The scale of colours, its bands, and the legend."""

import html

import numpy as np

BANDS = 20
RAMP = ((45, 42, 110), (44, 95, 165), (38, 148, 160), (88, 186, 116), (190, 210, 74), (250, 225, 90))  # low to high


def band_colors(count=BANDS):
    """Returns the colours of the bands, low to high: `count` tuples of red, green, blue from 0 to 255."""
    at = np.linspace(0, len(RAMP) - 1, count)
    channels = [np.interp(at, np.arange(len(RAMP)), [color[k] for color in RAMP]) for k in range(3)]
    return [tuple(int(round(value)) for value in color) for color in zip(*channels)]


def bands_of(values, low, high, count=BANDS):
    """Returns the band [m] of values [m], 0 to count - 1; what lies outside of low and high has the first or last."""
    width = high - low
    if not width > 0:
        return np.where(values > low, count - 1, 0)
    scaled = np.nan_to_num((values - low) / width * count, nan=0.0, posinf=count, neginf=0.0)
    return np.clip(scaled, 0, count - 1).astype(np.uint8)


def round_up(value):
    """Returns the next of 1, 2 and 5 times a power of ten; 1 for what is not positive."""
    if not 0 < value < np.inf:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(f"{next(step * power for step in (1, 2, 5, 10) if step * power >= value * (1 - 1e-9)):.12g}")


def legend(title, low, high, unit, count=BANDS):
    """Returns HTML: the bands as a bar, with title, unit and five numbers below."""
    cells = "".join(
        f'<div style="flex:1;height:14px;background:rgb({r},{g},{b})"></div>' for r, g, b in band_colors(count)
    )
    numbers = "".join(f"<span>{value:.3g}</span>" for value in np.linspace(low, high, 5))
    return (
        '<div style="padding:2px 12px 8px;font-size:12px">'
        f"<div>{html.escape(title)}{f' ({html.escape(unit)})' if unit else ''}</div>"
        f'<div style="display:flex;margin:4px 0 2px">{cells}</div>'
        f'<div style="display:flex;justify-content:space-between">{numbers}</div></div>'
    )
