# SPDX-License-Identifier: Apache-2.0
"""The meshes of the page: one for each part in plain colours; for values, one for each band of the scale.

viser's meshes have one colour each. Cloth that is coloured by values is therefore split by the band of every triangle.
The arrays of a band have spare places, so that the browser keeps its buffers as bands grow and shrink.
"""

import numpy as np

from ..io.rendering.camera import VIEW_ANGLE, frame_camera
from ..io.rendering.look import CLOTHS, OBSTACLE
from ..io.tessellation import drawn
from . import colors

LINES, SHADE = (205, 206, 212), 0.25
SHADOWED = 50_000  # cloth triangles up to which shadows are drawn unless the user says otherwise
BANDED = "/cloth"


def rgb(text):
    """Returns (red, green, blue) of "#rrggbb"."""
    return tuple(int(text[k : k + 2], 16) for k in (1, 3, 5))


def room_for(count):
    """Returns a number of places for `count` rows, at most a quarter more, that seldom changes when it does."""
    return int(np.ceil(64 * 1.25 ** np.ceil(np.log(max(count, 64) / 64) / np.log(1.25))))


class Band:
    """Triangles of one colour."""

    def __init__(self, scene, index, color):
        self._scene, self._name, self._color, self._handle = scene, f"{BANDED}/band {index}", color, None

    def show(self, positions, faces, wireframe):
        """Shows triangles [m, 3] of the positions [n, 3]; none: hides the mesh."""
        if not len(faces):
            self.hide()
            return
        used = np.zeros(len(positions), bool)
        used[faces.ravel()] = True
        kept = np.flatnonzero(used)
        number = np.empty(len(positions), np.uint32)
        number[kept] = np.arange(len(kept))
        vertices = np.empty((room_for(len(kept)), 3), np.float32)
        triangles = np.zeros((room_for(len(faces)), 3), np.uint32)
        vertices[: len(kept)], vertices[len(kept) :] = positions[kept], positions[kept[0]]
        triangles[: len(faces)] = number[faces]
        if self._handle is None:
            self._handle = self._scene.add_mesh_simple(
                self._name, vertices, triangles, color=self._color, side="double", wireframe=wireframe
            )
            return
        self._handle.vertices, self._handle.faces = vertices, triangles
        self._handle.wireframe, self._handle.visible = wireframe, True

    def hide(self):
        """Hides the mesh."""
        if self._handle is not None:
            self._handle.visible = False


class Page:
    """What is seen of a Surface.

    Args:
        server: The viser.ViserServer.
        surface: The Surface.
        seen: Positions [n, 3] that the camera frames at first.
    """

    def __init__(self, server, surface, seen):
        self._server, self._scene, self._surface = server, server.scene, surface
        low, high = seen.min(axis=0), seen.max(axis=0)
        self.size = max(float(np.linalg.norm(high - low)), 1e-3)  #: of what is shown, m
        self._seen = (low + high) / 2, self.size
        self._handles, self._bands = {}, None
        self.hidden, self.wireframe = set(), False  #: numbers of parts; whether edges alone are drawn
        self._scene.set_up_direction("+z")
        self.set_shadows(len(surface.faces) <= SHADOWED)
        self._place_camera(seen)
        self._add_floor(low, high)

    def set_shadows(self, shadows):
        """Draws shadows, or none."""
        self.shadows = shadows
        self._scene.configure_default_lights(cast_shadow=shadows)

    def _place_camera(self, seen):
        position, focus, up = frame_camera(seen, -60.0, 22.0, 1.2)  # the panel covers a part of the width
        camera = self._server.initial_camera
        camera.position, camera.look_at, camera.up = position, focus, up
        camera.fov, camera.near, camera.far = np.radians(VIEW_ANGLE), self.size / 500, 100 * self.size

    def _add_floor(self, low, high):
        cell = colors.round_up(self.size / 12)
        width = cell * 2 * np.ceil(1.6 * self.size / cell)
        center = np.round((low + high) / 2 / cell) * cell
        self._scene.add_grid(
            "/floor",
            width,
            width,
            cell_size=cell,
            section_size=5 * cell,
            cell_color=LINES,
            section_color=LINES,
            shadow_opacity=SHADE,
            fade_distance=5 * self.size,
            fade_strength=1.5,
            position=(center[0], center[1], low[2] - 0.004 * self.size),
        )

    def show(self, moment, values=None, low=0.0, high=1.0):
        """Shows a Moment; values [cloth triangles] colour the cloth by a scale from low to high."""
        surface, x = self._surface, moment.positions.astype(np.float32)
        with self._server.atomic():
            for index, part in enumerate(surface.parts):
                cloth = index < len(surface.cloths)
                color = CLOTHS[index % len(CLOTHS)] if cloth else OBSTACLE
                visible = index not in self.hidden and not (cloth and values is not None)
                self._show_part(index, part, x, rgb(color), visible)
            if values is not None:
                self._show_bands(x[: surface.cloth_count], colors.bands_of(values, low, high))
            elif self._bands:
                for band in self._bands:
                    band.hide()

    def _show_part(self, index, part, x, color, visible):
        """Shows a part in one colour, or hides it."""
        handle = self._handles.get(index)
        if not visible:
            if handle is not None:
                handle.visible = False
            return
        vertices, faces = drawn(part, x, self._seen)
        if handle is None:
            self._handles[index] = self._scene.add_mesh_simple(
                f"/parts/{index} {part.name.replace('/', ' ')}",
                vertices,
                faces,
                color=color,
                side="double",
                wireframe=self.wireframe,
                cast_shadow=part.shape != "plane",
            )
            return
        handle.vertices, handle.wireframe, handle.visible = vertices, self.wireframe, True

    def _show_bands(self, x, bands):
        surface = self._surface
        if self._bands is None:
            self._bands = [Band(self._scene, k, color) for k, color in enumerate(colors.band_colors())]
        shown = self._visible_faces()
        order = np.argsort(bands, kind="stable")
        order = order[shown[order]]
        ends = np.searchsorted(bands[order], np.arange(len(self._bands) + 1))
        for k, band in enumerate(self._bands):
            band.show(x, surface.faces[order[ends[k] : ends[k + 1]]], self.wireframe)

    def _visible_faces(self):
        """Whether each cloth triangle is visible."""
        surface = self._surface
        return np.array([k not in self.hidden for k in range(len(surface.cloths))], bool)[surface.cloth_of_face]

    def pick(self, moment, origin, direction):
        """Returns the vertex of visible cloth nearest to where a ray first meets it; None: it meets none.

        The ray is an origin [3] and a direction [3].
        """
        surface, x = self._surface, moment.positions
        faces, origin, direction = surface.faces[self._visible_faces()], np.asarray(origin), np.asarray(direction)
        a, b, c = (x[faces[:, k]] for k in range(3))
        first, second = b - a, c - a
        across = np.cross(direction, second)
        volume = (first * across).sum(1)
        with np.errstate(divide="ignore", invalid="ignore"):
            u = ((origin - a) * across).sum(1) / volume
            turned = np.cross(origin - a, first)
            v, along = turned @ direction / volume, (turned * second).sum(1) / volume
            met = (u >= 0) & (v >= 0) & (u + v <= 1) & (along > 0)
        if not met.any():
            return None
        at = np.flatnonzero(met)[along[met].argmin()]
        point = origin + along[at] * direction
        return int(faces[at][np.linalg.norm(x[faces[at]] - point, axis=1).argmin()])
