# SPDX-License-Identifier: Apache-2.0
# Types of the compiled module (bindings/python/src). Arguments have no names there: all are positional.

from os import PathLike
from typing import Any, Literal, Optional, TypedDict, Union, type_check_only

from .types import Booleans, Integers, Quaternion, Reals, Vector

_Path = Union[str, PathLike[str]]
_Matrix = list[list[float]]  # [4][4]

__version__: str
compiler: str

class Error(Exception): ...
class SceneError(Error): ...
class MeshError(Error): ...
class MaterialError(Error): ...
class FileError(Error): ...
class BackendError(Error): ...
class DeviceMemoryError(BackendError): ...
class SolverError(Error): ...
class CollisionError(Error): ...

@type_check_only
class BackendInfo(TypedDict):
    name: str
    available: bool
    devices: list[str]
    note: str

def list_backends() -> list[BackendInfo]: ...

# ---- Options: begin -------------------------------------------------------------------------------------------------
# All that depends on the table of options stands between these two lines.

AccuracyLevel = Literal["preview", "interactive", "production", "accurate", "reference", "paper"]
BackendName = Literal["auto", "cpu", "opencl", "cuda"]
Precision = Literal["double", "mixed", "single"]

def accuracy_levels() -> list[AccuracyLevel]: ...

class Options:
    @staticmethod
    def preset(level: str, /) -> Options: ...
    @property
    def accuracy(self) -> str: ...
    backend: str
    device: int
    threads: int
    precision: str
    time_step: float
    integrator: str
    newton_iterations: int
    newton_tolerance: float
    contact_refresh: str
    assembly: str
    atomic_filling: bool
    contact_form: str
    anticipate_contacts: bool
    arcsim_conventions: bool
    solver: str
    preconditioner: str
    tolerance: float
    max_iterations: int
    search: str
    localized_search: bool
    max_impact_passes: int
    linear_impacts: bool
    cubic_impacts: bool
    commit: bool
    audit: bool
    intersections: str
    pinch: str

@type_check_only
class Overrides(TypedDict, total=False):
    """Single options of a Simulation, as keywords."""

    time_step: float
    integrator: Literal["backward_euler", "bdf2"]
    newton_iterations: int
    newton_tolerance: float
    contact_refresh: Literal["step", "iteration"]
    assembly: Literal["gather", "algorithm1", "sorted"]
    atomic_filling: bool
    contact_form: Literal["rank_one", "star"]
    anticipate_contacts: bool
    arcsim_conventions: bool
    solver: Literal["conjugate_gradient", "direct"]
    preconditioner: Literal["none", "jacobi", "block_jacobi", "schwarz"]
    tolerance: float
    max_iterations: int
    search: Literal["tree", "fronts"]
    localized_search: bool
    max_impact_passes: int
    linear_impacts: bool
    cubic_impacts: bool
    commit: bool
    audit: bool
    intersections: Literal["reject", "exempt", "untangle"]
    pinch: Literal["stop", "release"]

@type_check_only
class SimulationOptions(Overrides, total=False):
    """All keywords of a Simulation."""

    backend: BackendName
    precision: Optional[Precision]
    accuracy: Optional[AccuracyLevel]
    device: int
    threads: int

def chosen_time_step(options: Options, scene: Scene, /) -> float: ...
def settings(options: Options, scene: Scene, /) -> list[tuple[str, str, str, str]]: ...

# ---- Options: end ---------------------------------------------------------------------------------------------------
# ---- Report of a step: begin ----------------------------------------------------------------------------------------

@type_check_only
class StepReport(TypedDict):
    step: int
    time: float
    contacts: int
    candidates: int
    searches: int
    impacts: int
    impact_passes: int
    truncated: int
    lost_motion: float
    released: int
    exempt: int
    substeps: int
    retries: int
    newton_iterations: int
    newton_residual: float
    iterations: int
    residual: float
    milliseconds: float
    launches: int
    waits: int
    intersections: int

# ---- Report of a step: end ------------------------------------------------------------------------------------------

@type_check_only
class Energy(TypedDict):
    kinetic: float
    stretching: float
    bending: float
    gravity: float

@type_check_only
class UntangleFields(TypedDict):
    clean: bool
    before: int
    after: int
    rounds: int
    moved: int
    largest_move: float
    smallest_gap: float

class Mesh:
    def __init__(
        self, vertices: Reals, faces: Integers, material_vertices: Reals, material_faces: Integers, /
    ) -> None: ...
    @property
    def vertices(self) -> Reals: ...
    @property
    def faces(self) -> Integers: ...
    @property
    def material_vertices(self) -> Reals: ...
    @property
    def material_faces(self) -> Integers: ...
    def transform(self, matrix: _Matrix, /) -> None: ...
    def scale_material(self, scale: float, /) -> None: ...
    def validate(self, name: str, /) -> None: ...

def load_mesh(file: _Path, scale: float, material_scale: float, /) -> Mesh: ...
def save_obj(file: _Path, mesh: Mesh, /) -> None: ...
def load_stitches(file: _Path, /) -> list[tuple[int, int, int, float]]: ...

class Material:
    def __init__(self, other: Material = ..., /) -> None: ...
    name: str
    source: str
    density: float
    stretching: list[list[float]]
    bending: list[list[float]]
    damping: float
    friction: float
    static_friction: float
    thickness: float
    contact_stiffness: float
    def validate(self, name: str, /) -> None: ...
    # Of the same name in the package, with other results: these give the compiled type.
    @staticmethod
    def isotropic(youngs_modulus: float, poisson_ratio: float, bending: float, density: float, /) -> Material: ...
    @staticmethod
    def orthotropic(
        youngs_warp: float,
        youngs_weft: float,
        poisson_ratio: float,
        shear: float,
        bending_warp: float,
        bending_weft: float,
        density: float,
        /,
    ) -> Material: ...
    @staticmethod
    def fabric(name: str, /) -> Material: ...
    @staticmethod
    def fabric_names() -> list[str]: ...
    @staticmethod
    def load(file: _Path, /) -> Material: ...
    @staticmethod
    def parse(text: str, name: str, /) -> Material: ...

class Motion:
    def __init__(self, other: Motion = ..., /) -> None: ...
    velocity: Vector
    rotation_rate: Vector
    oscillation: Vector
    center: Vector
    period: float
    start: float
    stop: float
    @property
    def is_static(self) -> bool: ...
    @property
    def is_rigid(self) -> bool: ...
    def add_key(
        self, time: float, translation: Vector, rotation: Quaternion, scale: float, center: Vector, /
    ) -> None: ...
    def set_samples(self, times: Reals, positions: Reals, /) -> None: ...
    def transform(self, matrix: _Matrix, /) -> None: ...
    def evaluate(self, time: float, vertices: Reals, /) -> Reals: ...

class Character:
    mesh: Mesh
    motion: Motion
    @property
    def duration(self) -> float: ...

def load_character(
    file: _Path,
    clip: str,
    animation: _Path,
    scale: float,
    samples_per_second: float,
    y_up: bool,
    lead_in: float,
    loops: int,
    /,
) -> Character: ...

class Cloth:
    def __init__(self, other: Cloth = ..., /) -> None: ...
    name: str
    mesh: Mesh
    material: Material
    source: str
    velocity: Vector

class Obstacle:
    def __init__(self, other: Obstacle = ..., /) -> None: ...
    name: str
    mesh: Mesh
    motion: Motion
    friction: float
    static_friction: float
    surface: str
    radius: float
    thickness: float
    contact_stiffness: float
    source: str

class Contact:
    enabled: bool
    self: bool
    thickness: float
    stiffness: float
    friction: float
    static_friction: float

class Wind:
    def __init__(self) -> None: ...
    velocity: Vector
    density: float
    drag: float

class Scene:
    def __init__(self, other: Scene = ..., /) -> None: ...
    @staticmethod
    def load(path: _Path, resolution: int, /) -> Scene: ...
    @staticmethod
    def parse(text: str, folder: _Path, resolution: int, /) -> Scene: ...
    def save(self) -> str: ...
    def validate(self) -> None: ...
    name: str
    description: str
    gravity: Vector
    time_step: float
    frame_time: float
    @property
    def seconds_per_frame(self) -> float: ...
    frames: int
    wind: Optional[Wind]
    options: str
    @property
    def contact(self) -> Contact: ...
    @property
    def cloth_count(self) -> int: ...
    @property
    def obstacle_count(self) -> int: ...
    @property
    def stitch_count(self) -> int: ...
    @property
    def cloth_vertex_count(self) -> int: ...
    @property
    def cloth_triangle_count(self) -> int: ...
    def cloth(self, index: int, /) -> Cloth: ...
    def obstacle(self, index: int, /) -> Obstacle: ...
    def pins(self) -> list[tuple[int, Integers, Optional[int], float]]: ...
    def add_cloth(self, cloth: Cloth, /) -> int: ...
    def add_obstacle(self, obstacle: Obstacle, /) -> int: ...
    def add_pin(
        self, cloth: int, vertices: Integers, motion: Motion, obstacle: Optional[int], release: float, /
    ) -> None: ...
    def add_stitch(
        self,
        cloth_a: int,
        vertex_a: int,
        cloth_b: int,
        vertex_b: int,
        vertex_c: int,
        ratio: float,
        stiffness: float,
        /,
    ) -> None: ...

class Simulation:
    def __init__(self, scene: Scene, options: Options, /) -> None: ...
    def step(self, n: int, /) -> None: ...
    def step_count(self) -> int: ...
    def time(self) -> float: ...
    def time_step(self) -> float: ...
    def vertex_count(self) -> int: ...
    def cloth_vertex_count(self) -> int: ...
    def cloth_triangle_count(self) -> int: ...
    def cloth_ranges(self) -> list[tuple[int, int]]: ...
    def obstacle_ranges(self) -> list[tuple[int, int]]: ...
    def faces(self) -> Integers: ...
    def positions(self) -> Reals: ...
    def velocities(self) -> Reals: ...
    def masses(self) -> Reals: ...
    def set_state(self, positions: Reals, velocities: Reals, /) -> None: ...
    def checkpoint(self) -> dict[str, Any]: ...
    def restore(self, fields: dict[str, Any], /) -> None: ...
    def contacts(self) -> tuple[Integers, Reals, Reals, Reals, Integers]: ...
    def report(self) -> StepReport: ...
    def timings(self) -> list[tuple[str, int, float]]: ...
    def streams(self) -> list[tuple[str, str, int, int]]: ...
    def explain(self) -> list[tuple[str, str]]: ...
    def energy(self) -> Energy: ...
    def untangled(self) -> UntangleFields: ...
    def min_gap(self) -> float: ...
    def max_strain(self) -> float: ...
    def count_intersections(self) -> int: ...
    def state_hash(self) -> int: ...
    def peak_memory_bytes(self) -> int: ...
    def options(self) -> Options: ...
    def settings(self) -> list[tuple[str, str, str, str]]: ...
    def backend(self) -> tuple[str, str]: ...

def vertex_face_ccd(start: Reals, end: Reals, minimum_distance: float, /) -> tuple[Booleans, Reals]: ...
def edge_edge_ccd(start: Reals, end: Reals, minimum_distance: float, /) -> tuple[Booleans, Reals]: ...
def vertex_face_ccd_cubic(start: Reals, end: Reals, /) -> tuple[Booleans, Reals]: ...
def edge_edge_ccd_cubic(start: Reals, end: Reals, /) -> tuple[Booleans, Reals]: ...
def vertex_face_distance(points: Reals, /) -> tuple[Reals, Reals]: ...
def edge_edge_distance(points: Reals, /) -> tuple[Reals, Reals]: ...
def intersections(vertices: Reals, faces: Integers, first_obstacle_vertex: int, /) -> Integers: ...
def start_intersections(scene: Scene, /) -> list[tuple[int, int, str, str, Integers, Reals]]: ...
def save_intersections(file: _Path, scene: Scene, /) -> None: ...
def untangle(scene: Scene, max_rounds: int, gap: float, /) -> UntangleFields: ...
