# SPDX-License-Identifier: Apache-2.0
"""What pictures look like: the options of a user, checked before any work."""

from dataclasses import dataclass
from pathlib import Path
from typing import Optional

import numpy as np

from ...errors import FileError, SceneError
from ...hints import similar

CLOTHS = ["#5b7fa6", "#c98b5e", "#6f9a7c", "#b06a72", "#8a79a8", "#bda45a", "#5f9aa0", "#94795f"]
OBSTACLE, BACKGROUND = "#cdc6bc", "#eceaea"
SHOWN = ("cloth", "strain")
FORMATS = ("mp4", "webp", "png")
#: Words for --quality: pixels drawn for each one of the picture in each direction, samples of ambient occlusion.
QUALITIES = {"draft": (1.0, 0), "good": (1.25, 8), "best": (2.0, 32)}


@dataclass
class Look:
    """How a recording is drawn.

    Args:
        size: Width and height of a picture, pixels.
        azimuth: Direction of the camera, degrees from the x axis.
        elevation: Of the camera, degrees above the ground.
        target: The point that the camera looks at, [3] m; None: the middle of what is seen.
        distance: Of the camera from the target, m; None: such that everything is in the picture.
        turntable: Rate at which the camera turns about the target, degrees per second of film.
        follow: The camera moves with the middle of the cloth; it then stands where all cloth, and what is near it, is
            in the picture. The target is that of the first image.
        colors: Colours of the cloths: names or #rrggbb in the order of the cloths, taken again from the first where
            there are fewer, or `NAME=COLOR` for a cloth of this name.
        background: Colour of the ground and of what is behind it.
        obstacle_opacity: 0 to 1; None: 1, and less where obstacles would hide most of the cloth.
        wireframe: Draw the edges of the triangles.
        texture: An image file, put on cloths by their texture coordinates.
        show: "cloth", or "strain": colours for the largest strain since the first frame.
        smooth: Draw coarse cloth as a smooth surface through its vertices; layers that touch may then show through each
            other.
        quality: "draft", "good" or "best".
    """

    size: tuple = (1280, 720)
    azimuth: float = -60.0
    elevation: float = 22.0
    target: Optional[tuple] = None
    distance: Optional[float] = None
    turntable: float = 0.0
    follow: bool = False
    colors: tuple = ()
    background: str = BACKGROUND
    obstacle_opacity: Optional[float] = None
    wireframe: bool = False
    texture: Optional[Path] = None
    show: str = "cloth"
    smooth: bool = False
    quality: str = "good"


def check(look, recording):
    """Raises SceneError or FileError if a Look cannot be drawn with a Recording."""
    color(look.background)
    cloth_colors(look, recording)
    for name, value, words in (("show", look.show, SHOWN), ("quality", look.quality, QUALITIES)):
        if value not in words:
            raise SceneError(f"{name} {value!r}: is not one of {', '.join(words)}{similar(value, words)}")
    if look.obstacle_opacity is not None and not 0 <= look.obstacle_opacity <= 1:
        raise SceneError(f"obstacle_opacity {look.obstacle_opacity:g}: is not from 0 to 1")
    if look.distance is not None and not 0 < look.distance < np.inf:
        raise SceneError(f"distance {look.distance:g}: is not a length above 0")
    if look.target is not None and (len(look.target) != 3 or not np.isfinite(look.target).all()):
        raise SceneError(f"target {look.target}: is not a point of three coordinates")
    if not abs(look.elevation) < 90:
        raise SceneError(f"elevation {look.elevation:g}: is not between -90 and 90 degrees")
    if look.texture is not None:
        _check_texture(look, recording)


def _check_texture(look, recording):
    if not Path(look.texture).is_file():
        raise FileError(f"{look.texture}: no such file")
    if look.show != "cloth":
        raise SceneError(f"texture: cannot be shown with the colours of {look.show}; leave one of them out")
    if all(getattr(part, "uv", None) is None for part in recording.cloths):
        raise SceneError(
            f"texture {look.texture}: no cloth of the recording has texture coordinates; read the cloth from a mesh "
            "file that has them, and record again"
        )
    import imageio.v2 as imageio

    try:
        imageio.imread(look.texture)
    except Exception as problem:  # each reader of a format has its own
        raise FileError(f"{look.texture}: is no image that can be read ({problem})") from None


def color(text):
    """Red, green and blue, 0 to 1, of a name or #rrggbb. Raises SceneError."""
    import pyvista

    try:
        return np.array(pyvista.Color(text).float_rgb)
    except (ValueError, TypeError):
        known = vars(pyvista.plotting.colors).get("hex_colors", ())
        raise SceneError(
            f"color {text!r}: is no colour; give a name such as steelblue, or #rrggbb{similar(str(text), known)}"
        ) from None


def cloth_colors(look, recording):
    """A colour [3] for each cloth of a recording. Raises SceneError."""
    names = [part.name for part in recording.cloths]
    palette, own = [], {}
    for text in look.colors:
        name, mark, value = str(text).rpartition("=")
        if mark and name not in names:
            raise SceneError(f"color {text}: no cloth {name!r}; there are: {', '.join(names)}{similar(name, names)}")
        if mark:
            own[name] = color(value)
        else:
            palette.append(color(text))
    palette = palette or [color(text) for text in CLOTHS]
    return [own.get(name, palette[index % len(palette)]) for index, name in enumerate(names)]
