# SPDX-License-Identifier: Apache-2.0
"""One run of one system of benchmarks/peers.py, in the interpreter where it is installed.

    python benchmarks/peer_systems.py SYSTEM SETTINGS CASE.npz OUT.npz DEVICE

Each function gets the case and returns positions [frames, vertices, 3], m, the wall time of the frames after the first,
s, and what goes into the row. z is up.
"""

import json
import sys
import time
from importlib.metadata import version

import numpy as np

# The first are the defaults, the last is the refined one that errors are taken against.
SETTINGS = {
    "cama": ["default", "interactive", "accurate"],
    "newton": ["default", "5 substeps x 5", "20 substeps x 20"],
    "libuipc": ["default, d_hat 2 mm", "dt 1/200 s, d_hat 1.5 mm", "dt 1/800 s, d_hat 1.5 mm"],
}


def timed_frames(count, advance, positions):
    """Returns the frames [count, n, 3] and the seconds of all but the first, which compiles and warms up."""
    frames, seconds = [], 0.0
    for number in range(count):
        before = time.perf_counter()
        advance()
        x = np.array(positions(), float)
        seconds += (time.perf_counter() - before) if number else 0.0
        frames.append(x)
    return np.stack(frames), seconds


def cama(case, settings, device):
    import cama as c

    scene = c.Scene(
        frames=int(case["frames"]), frame_time=float(case["frame_time"]), thickness=float(case["thickness"])
    )
    material = {
        "density": float(case["density"]),
        "friction": float(case["friction"]),
        "isotropic": {
            "youngs_modulus": float(case["young"]),
            "poisson_ratio": float(case["poisson"]),
            "bending": float(case["bending"]),
        },
    }
    layers, rest = int(case["layers"]), case["rest"]
    for layer, (x, faces) in enumerate(zip(np.split(case["vertices"], layers), np.split(case["faces"], layers))):
        own = faces - layer * len(x)
        scene.add_cloth(x, own, material=material, material_vertices=rest, material_faces=own, name=f"sheet {layer}")
    sphere = {"shape": {"sphere": {"radius": float(case["radius"])}}}
    scene.add_obstacle(shape=sphere, friction=float(case["friction"]), name="sphere")
    levels = {"default": {}, "interactive": {"accuracy": "interactive"}, "accurate": {"accuracy": "accurate"}}
    simulation = c.Simulation(scene, backend=device, **levels[settings])
    count = simulation.cloth_vertex_count
    frames, seconds = timed_frames(int(case["frames"]), simulation.step_frame, lambda: simulation.positions[:count])
    chosen = {row["name"]: row["value"] for row in simulation.chosen_options}
    step = f"error {chosen['error']}" if chosen.get("error") else f"{simulation.time_step:.6g}"
    return (
        frames,
        seconds,
        {
            "version": c.__version__,
            "device": simulation.device,
            "precision": chosen.get("precision", ""),
            "dt_s": step,
            "tolerance": chosen.get("tolerance", ""),
            "guarantee": "no intersections" if chosen.get("commit") == "true" else "none",
        },
    )


def newton(case, settings, device):
    import newton as n
    import warp as wp

    wp.config.quiet = True
    wp.init()
    wp.set_device("cuda:0" if device == "cuda" else "cpu")
    substeps, iterations = {"default": (10, 10), "5 substeps x 5": (5, 5), "20 substeps x 20": (20, 20)}[settings]
    young, poisson = float(case["young"]), float(case["poisson"])
    edge = float(np.linalg.norm(case["rest"][1] - case["rest"][0]))
    builder = n.ModelBuilder(gravity=(0.0, 0.0, -9.81))
    layers = int(case["layers"])
    for layer, (x, faces) in enumerate(zip(np.split(case["vertices"], layers), np.split(case["faces"], layers))):
        builder.add_cloth_mesh(
            pos=wp.vec3(0.0, 0.0, 0.0), rot=wp.quat_identity(), scale=1.0, vel=wp.vec3(0.0, 0.0, 0.0),
            vertices=[wp.vec3(*p) for p in x.tolist()], indices=(faces - layer * len(x)).ravel().tolist(),
            density=float(case["density"]), tri_ke=young / (2 * (1 + poisson)),
            tri_ka=young * poisson / (1 - poisson**2), tri_kd=0.0, edge_kd=0.0,
            edge_ke=3.0 * float(case["bending"]) / edge,  # of two right triangles: 3 B L^2 / A, over L
            particle_radius=float(case["thickness"]),
        )  # fmt: skip
    builder.add_shape_sphere(body=-1, radius=float(case["radius"]))
    builder.color(include_bending=True)
    model = builder.finalize()
    model.soft_contact_ke, model.soft_contact_kd, model.soft_contact_mu = 1e3, 1e-2, float(case["friction"])
    solver = n.solvers.SolverVBD(
        model, iterations=iterations, particle_enable_self_contact=True,
        particle_self_contact_margin=1.5 * float(case["thickness"]), particle_self_contact_gap=float(case["thickness"]),
        particle_vertex_contact_buffer_size=64, particle_edge_contact_buffer_size=128,
    )  # fmt: skip
    states, control = [model.state(), model.state()], model.control()
    pipeline = n.CollisionPipeline(model)
    contacts = pipeline.contacts()
    step = float(case["frame_time"]) / substeps

    def simulate():
        solver.rebuild_bvh(states[0])
        for _ in range(substeps):
            states[0].clear_forces()
            pipeline.collide(states[0], contacts)
            solver.step(states[0], states[1], control, contacts, step)
            states[0].assign(states[1])

    advance = simulate
    if device == "cuda":
        simulate()
        for state in states:
            state.assign(model.state())
        with wp.ScopedCapture() as capture:
            simulate()

        def advance():
            wp.capture_launch(capture.graph)

    frames, seconds = timed_frames(int(case["frames"]), advance, lambda: states[0].particle_q.numpy())
    return (
        frames,
        seconds,
        {
            "version": version("newton") + ", warp " + version("warp-lang"),
            "device": wp.get_device().name + ("" if device == "cuda" else ", 1 thread"),
            "precision": "single",
            "dt_s": f"{step:.6g}",
            "tolerance": f"{iterations} iterations of VBD",
            "guarantee": "displacement bound, while buffers suffice",
        },
    )


def libuipc(case, settings, device):
    if device != "cuda":
        raise SystemExit("libuipc computes on CUDA only")
    import tempfile

    from uipc import Logger, view
    from uipc.constitution import AffineBodyConstitution, DiscreteShellBending, ElasticModuli2D, NeoHookeanShell
    from uipc.core import Engine, Scene, World
    from uipc.geometry import label_surface, trimesh
    from uipc.unit import MPa

    Logger.set_level(Logger.Level.Warn)
    config = Scene.default_config()
    # the default d_hat of 10 mm is above the 6 mm between the sheets
    rate, near = dict(zip(SETTINGS["libuipc"], [(0, 2e-3), (200, 1.5e-3), (800, 1.5e-3)]))[settings]
    frame = float(case["frame_time"])
    substeps = max(1, round(frame * rate)) if rate else max(1, round(frame / config["dt"]))
    config["dt"] = frame / substeps
    config["gravity"] = [[0.0], [0.0], [-9.81]]
    config["contact"]["d_hat"] = near
    scene = Scene(config)
    scene.contact_tabular().default_model(float(case["friction"]), 1e9)
    half = 0.5 * float(case["thickness"])
    shell, bending = NeoHookeanShell(), DiscreteShellBending()
    sheets = trimesh(np.ascontiguousarray(case["vertices"]), np.ascontiguousarray(case["faces"]))
    label_surface(sheets)
    moduli = ElasticModuli2D.youngs_poisson(float(case["young"]) / (2 * half), float(case["poisson"]))
    shell.apply_to(sheets, moduli, float(case["density"]) / (2 * half), half)
    bending.apply_to(sheets, float(case["bending"]))
    cloth = scene.objects().create("cloth")
    slot, _ = cloth.geometries().create(sheets)
    x, faces = sphere_mesh(float(case["radius"]))
    ball = trimesh(x, faces)
    label_surface(ball)
    AffineBodyConstitution().apply_to(ball, 100 * MPa)
    view(ball.instances().find("is_fixed"))[:] = 1
    scene.objects().create("sphere").geometries().create(ball)
    with tempfile.TemporaryDirectory() as folder:
        engine = Engine("cuda", folder)  # has to outlive the world
        world = World(engine)
        world.init(scene)

        def advance():
            for _ in range(substeps):
                world.advance()
            world.retrieve()

        frames, seconds = timed_frames(
            int(case["frames"]), advance, lambda: slot.geometry().positions().view().reshape(-1, 3)
        )
    return (
        frames,
        seconds,
        {
            "version": version("pyuipc"),
            "device": "cuda",
            "precision": "double",
            "dt_s": f"{config['dt']:.6g}",
            "tolerance": f"velocity {config['newton']['velocity_tol']} m/s",
            "guarantee": "no intersections",
        },
    )


def sphere_mesh(radius, rings=32):
    """A closed sphere: vertices [n, 3], triangles [m, 3], outward."""
    columns = 2 * rings
    polar = np.pi * np.arange(1, rings) / rings
    around = 2 * np.pi * np.arange(columns) / columns
    body = np.stack(
        [np.outer(np.sin(polar), np.cos(around)), np.outer(np.sin(polar), np.sin(around)),
         np.outer(np.cos(polar), np.ones(columns))], axis=2,
    ).reshape(-1, 3)  # fmt: skip
    top, bottom = len(body), len(body) + 1
    j = np.arange(columns)
    k = (j + 1) % columns
    faces = [np.stack([np.full(columns, top), j, k], 1)]
    for row in range(rings - 2):
        a, b = row * columns, (row + 1) * columns
        faces += [np.stack([a + j, b + j, b + k], 1), np.stack([a + j, b + k, a + k], 1)]
    last = (rings - 2) * columns
    faces.append(np.stack([np.full(columns, bottom), last + k, last + j], 1))
    return radius * np.concatenate([body, [[0, 0, 1], [0, 0, -1]]]), np.concatenate(faces).astype(np.int32)


def main():
    system, settings, case_file, out, device = sys.argv[1:]
    with np.load(case_file) as file:
        case = {name: file[name] for name in file.files}
    positions, seconds, said = {"cama": cama, "newton": newton, "libuipc": libuipc}[system](case, settings, device)
    timed = (len(positions) - 1) * float(case["frame_time"])
    said["s_per_s"] = round(seconds / timed, 3) if timed > 0 else ""
    np.savez(out, positions=positions, said=json.dumps(said))


if __name__ == "__main__":
    main()
