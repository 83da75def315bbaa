# SPDX-License-Identifier: Apache-2.0
"""Cloths, obstacles, ground, lights and camera in one window that is not on a screen."""

import multiprocessing
from collections import deque
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool

import numpy as np

from ...errors import BackendError
from ...processes import follow_parent, submit, terminate
from ..recording import Recording
from . import look as looks
from . import passes, surfaces
from .camera import VIEW_ANGLE, Orbit, Way, directions
from .moments import positions_at, sample

AMBIENT, DIFFUSE = 0.42, 0.70  # of cloths and obstacles
GROUND_DIFFUSE = 0.45
KEY, FILL = 0.84, 0.30  # intensities of the lights
CLEAR = 0.3  # opacity of obstacles that would hide the cloth
AHEAD = 4  # pictures of a process that may wait to be written
NEAR = 0.4  # of the size of the cloth, up to which something is near it
HIDDEN = 0.5  # share of the visible cloth that obstacles hide at some moment, from which on they are drawn clear


def near(points, low, high):
    """Whether points [n, 3] are near a box, given by its least and greatest coordinates, m."""
    reach = NEAR * np.linalg.norm(high - low)
    return ((points > low - reach) & (points < high + reach)).all(axis=1)


class Stage:
    """Draws moments of a recording.

    Args:
        recording: A Recording.
        moments: Those that will be drawn, s; the camera is placed for them.
        look: A Look.
    """

    def __init__(self, recording, moments, look):
        import pyvista
        from vtkmodules.vtkCommonCore import vtkLogger

        vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
        self._pv, self._recording, self._look = pyvista, recording, look
        self._scale, occlusion = looks.QUALITIES[look.quality]
        window = [round(self._scale * side) for side in look.size]
        self._plotter = pyvista.Plotter(off_screen=True, window_size=window, lighting="none")
        self._plotter.set_background(tuple(looks.color(look.background)))
        self._place(moments)
        self._add_lights()
        start = positions_at(recording, moments[0])
        self._cloths = [self._add_cloth(part, color, start) for part, color in self._cloth_parts()]
        self._obstacles = [self._add_obstacle(part, start) for part in self._solid]
        self._fade_obstacles(moments)
        self._add_ground()
        if look.show == "strain":
            self._add_legend(moments)
        self._passes = passes.set_passes(self._plotter.renderer, occlusion, self._reach)
        self._plotter.render_window.SetMultiSamples(0)

    def _cloth_parts(self):
        """Pairs of a part and a colour; cloths of one colour are one part, but for those with a texture."""
        colors = looks.cloth_colors(self._look, self._recording)
        if self._look.texture is not None:
            return list(zip(self._recording.cloths, colors))
        same = {}
        for part, color in zip(self._recording.cloths, colors):
            same.setdefault(tuple(color), []).append(part)
        return [(surfaces.joined(parts), np.array(color)) for color, parts in same.items()]

    def _place(self, moments):
        """Finds the ground, what must be in the picture, and where the camera and the key light stand."""
        first, last = (positions_at(self._recording, m) for m in (moments[0], moments[-1]))
        floors = [p for p in self._recording.obstacles if surfaces.is_floor(p, first, last)]
        others = [p for p in self._recording.obstacles if p not in floors]
        seen = self._seen(moments, others)
        low, high = seen.min(axis=0), seen.max(axis=0)
        self._middle, self._reach = (low + high) / 2, max(float(np.linalg.norm(high - low)), 1e-6)
        levels = {id(p): first[p.vertices][:, 2].max() for p in floors}
        floors = [p for p in floors if levels[id(p)] <= low[2] + 0.02 * self._reach]
        self._solid = [p for p in self._recording.obstacles if p not in floors and surfaces.has_surface(p)]
        self._level = max((levels[id(p)] for p in floors), default=low[2] - 0.002 * self._reach)
        self._orbit = self._follow(moments, others) if self._look.follow else Orbit(seen, self._look)
        self._key = directions(self._look.azimuth - 62, 50)[0]
        shadow = seen - np.outer((seen[:, 2] - self._level) / self._key[2], self._key)
        both = np.concatenate([seen, shadow])[:, :2]
        self._center = (both.min(axis=0) + both.max(axis=0)) / 2
        self._radius = 1.08 * np.linalg.norm(both - self._center, axis=1).max() + 0.05 * self._reach
        self._top = high[2]

    def _seen(self, moments, obstacles):
        """Points [n, 3] that must be in the picture: all cloth, and obstacles that are not far larger than it."""
        cloth, others = [], [[] for _ in obstacles]
        for moment in sample(moments):
            positions = positions_at(self._recording, moment)
            cloth += [positions[p.vertices] for p in self._recording.cloths]
            for points, part in zip(others, obstacles):
                points.append(surfaces.outline(part, positions))
        cloth = np.concatenate(cloth or sum(others, []))
        low, high = cloth.min(axis=0), cloth.max(axis=0)
        size = np.linalg.norm(high - low)
        shown = [cloth]
        for points in map(np.concatenate, others):
            least, most = points.min(axis=0), points.max(axis=0)
            if np.linalg.norm(most - least) > 2.5 * size:
                shown.append(points[near(points, low, high)])
            elif (most > low - NEAR * size).all() and (least < high + NEAR * size).all():
                shown.append(points)
        return np.concatenate(shown)

    def _follow(self, moments, obstacles):
        """An Orbit that follows the cloth and has it in the picture, with what is near it, at all moments."""
        parts = self._recording.cloths or obstacles
        middles = []
        for moment in moments:
            positions = positions_at(self._recording, moment)
            middles.append(np.mean([positions[p.vertices].mean(axis=0) for p in parts], axis=0))
        way, seen = Way(moments, np.array(middles)), []
        for moment in sample(moments):
            positions, shift = positions_at(self._recording, moment), way.at(moment)
            cloth = np.concatenate([positions[p.vertices] for p in parts])
            low, high = cloth.min(axis=0), cloth.max(axis=0)
            seen.append(cloth - shift)
            for part in obstacles:
                points = surfaces.outline(part, positions)
                seen.append(points[near(points, low, high)] - shift)
        return Orbit(np.concatenate(seen), self._look, way)

    def _add_lights(self):
        far = 1000 * self._reach
        fill = directions(self._look.azimuth + 50, 35)[0]
        # VTK makes shadow maps for lights without a position and for narrow cones, not for a cone of 180 degrees.
        for direction, intensity, wide in ((self._key, KEY, False), (fill, FILL, True)):
            light = self._pv.Light(
                position=self._middle + far * direction,
                focal_point=self._middle,
                intensity=intensity,
                positional=wide,
                cone_angle=180,
                exponent=0,
                light_type="scene light",
            )
            light.shadow_attenuation = 1.0
            self._plotter.add_light(light)
        self._ground_light = KEY * self._key[2] + FILL * fill[2]

    def _add(self, surface, **how):
        """Adds a surface that shadows fall on; `how`: as for pyvista's add_mesh."""
        cloth = dict(ambient=AMBIENT, diffuse=DIFFUSE, specular=0.04, specular_power=12, interpolation="phong")
        actor = self._plotter.add_mesh(surface, smooth_shading=False, show_scalar_bar=False, **{**cloth, **how})
        passes.soften(actor, 2 * self._radius)
        return actor

    def _add_cloth(self, part, color, positions):
        look = self._look
        cloth = surfaces.Cloth(part, positions, not look.wireframe, look.smooth, look.texture is not None)
        how = dict(
            color=tuple(color),
            backface_params=dict(
                color=tuple(0.66 * color + 0.34 * np.array([0.95, 0.93, 0.90])), ambient=AMBIENT, diffuse=DIFFUSE
            ),
        )
        if look.show == "strain":
            cloth.surface.point_data["strain"] = np.zeros(cloth.surface.n_points)
            how = dict(scalars="strain", cmap="viridis")
        elif look.texture is not None and cloth.surface.active_texture_coordinates is not None:
            how = dict(texture=self._pv.read_texture(look.texture))
        if look.wireframe:
            how.update(show_edges=True, edge_color="#2c2c30", line_width=self._scale)
        return part, cloth, self._add(cloth.surface, **how)

    def _add_obstacle(self, part, positions):
        obstacle = surfaces.Obstacle(part, positions, (self._middle, 2.5 * self._reach))
        how = dict(culling="back") if surfaces.is_hollow(part, positions) else {}  # one looks in from outside
        return part, obstacle, self._add(obstacle.surface, color=tuple(looks.color(looks.OBSTACLE)), **how)

    def _add_ground(self):
        """A disc that all shadows fall within. In the light it has the colour of the background, so its rim is unseen.

        Around it is a rim without light, and the scene's bounds stay the same: the shadow map is laid over them.
        """
        color, center = tuple(looks.color(self._look.background)), (*self._center, self._level)
        for inner, outer, diffuse in ((0, self._radius, GROUND_DIFFUSE), (self._radius, 1.1 * self._radius, 0.0)):
            disc = self._pv.Disc(center=center, inner=inner, outer=outer, c_res=96).triangulate()
            ambient = 1 - diffuse * self._ground_light
            self._add(disc, color=color, ambient=ambient, diffuse=diffuse, specular=0, culling="back")
        wide = 1.12 * self._radius
        corners = np.array([(*(self._center - wide), self._level), (*(self._center + wide), self._top)])
        self._plotter.add_mesh(self._pv.PolyData(corners), style="points").visibility = False

    def _fade_obstacles(self, moments):
        """Lets the cloth be seen through obstacles that would hide it, or as the user wishes."""
        opacity = self._look.obstacle_opacity
        if opacity is None and self._obstacles and self._cloths:
            opacity = CLEAR if self._hidden(moments) > HIDDEN else 1.0
        if opacity == 0:  # not only hidden: the shadow map is laid over all that is there
            for _, _, actor in self._obstacles:
                self._plotter.remove_actor(actor)
            self._obstacles = []
        for _, _, actor in self._obstacles:
            actor.prop.opacity = 1.0 if opacity is None else opacity

    def _hidden(self, moments):
        """The largest share of the pixels of cloth that obstacles hide, of a few moments."""
        plotter = self._pv.Plotter(off_screen=True, window_size=(256, 144), lighting="none")
        plotter.set_background("black")
        for _, cloth, _ in self._cloths:
            plotter.add_mesh(cloth.surface, color="white", lighting=False, show_scalar_bar=False)
        hiding = [
            plotter.add_mesh(o.surface, color="black", lighting=False, culling=actor.prop.culling)
            for _, o, actor in self._obstacles
        ]
        share = 0.0
        for moment in sample(moments, 8):
            self._move(moment)
            self._aim(plotter, 0, moment)
            counts = []
            for visible in (False, True):
                for actor in hiding:
                    actor.visibility = visible
                plotter.render()
                counts.append((np.asarray(plotter.screenshot(return_img=True))[..., 0] > 127).sum())
            share = max(share, 1 - counts[1] / max(counts[0], 1))
        plotter.close()
        return share

    def _add_legend(self, moments):
        """Colours from no strain to the largest of the film but for one vertex in a hundred."""
        self._rest = self._recording.frame(0)
        values = [
            self._strain(part, positions_at(self._recording, m)) for m in sample(moments) for part, *_ in self._cloths
        ]
        most = max(float(np.percentile(np.concatenate(values), 99)), 1e-4)
        step = 10 ** np.floor(np.log10(most))
        most = step * np.ceil(most / step - 1e-6)
        for _, _, actor in self._cloths:
            actor.mapper.scalar_range = 0, 100 * most
        letters = self._look.size[1] * self._scale / 720
        bar = self._plotter.add_scalar_bar(
            title="largest strain, %",
            mapper=self._cloths[0][2].mapper,
            n_labels=5,
            fmt="%.3g",
            color="#3a3d42",
            title_font_size=round(16 * letters),
            label_font_size=round(14 * letters),
            width=0.3,
            height=0.11,
            position_x=0.03,
            position_y=0.03,
        )
        bar.SetBarRatio(0.3)  # else the title touches the labels

    def _strain(self, part, positions):
        return surfaces.strain(self._rest[part.vertices], positions[part.vertices], part.faces)

    def _move(self, moment):
        positions = positions_at(self._recording, moment)
        for part, cloth, _ in self._cloths:
            shown = self._look.show == "strain" and hasattr(self, "_rest")
            cloth.move(positions, {"strain": 100 * self._strain(part, positions)} if shown else {})
        for _, obstacle, _ in self._obstacles:
            obstacle.move(positions)
        for _, _, actor in self._cloths:
            actor.Modified()  # else VTK keeps the shadow maps

    def _aim(self, plotter, seconds, moment):
        camera = plotter.camera
        camera.position, camera.focal_point, camera.up = self._orbit.at(seconds, moment)
        camera.view_angle = VIEW_ANGLE
        plotter.renderer.reset_camera_clipping_range()

    def draw(self, moment, caption=None, seconds=0.0):
        """[height, width, 3] uint8 picture of a moment, s; seconds: time of the film, by which the camera turns."""
        from PIL import Image

        self._move(moment)
        self._aim(self._plotter, seconds, moment)
        if caption:
            size = max(6, round(10 * self._scale * self._look.size[1] / 720))
            self._plotter.add_text(caption, position=(16, 12), font_size=size, color="#6d7076", name="caption")
        self._plotter.render()
        picture = np.ascontiguousarray(self._plotter.screenshot(return_img=True)[..., :3])
        if self._scale != 1:
            picture = np.asarray(Image.fromarray(picture).resize(self._look.size, Image.Resampling.HAMMING))
        return picture

    def close(self):
        """Frees the window."""
        for one in self._passes:
            one.ReleaseGraphicsResources(self._plotter.render_window)
        self._plotter.close()


def pictures(path, recording, look, shots, processes=1):
    """Yields the pictures of shots (moment, caption, seconds), as for Stage.draw, drawn by several processes."""
    moments = [shot[0] for shot in shots]
    if processes > 1:
        yield from _drawn_by(processes, (path, look, tuple(moments)), shots)
        return
    stage = Stage(recording, moments, look)
    try:
        for shot in shots:
            yield stage.draw(*shot)
    finally:
        stage.close()


def _drawn_by(processes, job, shots):
    """Yields the pictures of shots, drawn by processes. Raises BackendError where one of them is stopped."""
    pool = ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"), follow_parent)
    ahead = deque()
    try:
        for shot in shots:
            ahead.append(submit(pool, _draw, job, shot))
            if len(ahead) > AHEAD * processes:
                yield ahead.popleft().result()
        while ahead:
            yield ahead.popleft().result()
    except BrokenProcessPool:
        terminate(pool)
        raise BackendError(
            "render: a process that draws images was stopped, most often by the system for lack of memory; draw "
            "smaller images (--width, --height, --quality draft), or end other programs"
        ) from None
    except BaseException:  # Ctrl-C, or a film that cannot be written: what is drawn is not needed
        terminate(pool)
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


_stages = {}  #: of this process, by the path of the recording


def _draw(job, shot):
    """Draws a shot in a process of its own, which keeps its stage for the next."""
    path, look, moments = job
    if path not in _stages:
        _stages[path] = Stage(Recording(path, checked=True), moments, look)
    return _stages[path].draw(*shot)
