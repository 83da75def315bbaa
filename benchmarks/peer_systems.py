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
        print(f"frame {number + 1}", flush=True)
        frames.append(x)
    return np.stack(frames), seconds


def turned(case, seconds):
    """Positions [held, 3] of the held vertices, which turn about the x axis at rates of their own."""
    x, angle = case["vertices"][case["held"]], case["rate"] * seconds
    y, z = x[:, 1] * np.cos(angle) - x[:, 2] * np.sin(angle), x[:, 1] * np.sin(angle) + x[:, 2] * np.cos(angle)
    return np.stack([x[:, 0], y, z], axis=1)


def cama(case, settings, device):
    import cama as c

    scene = c.Scene(
        frames=int(case["frames"]),
        frame_time=float(case["frame_time"]),
        thickness=float(case["thickness"]),
        gravity=(0, 0, -float(case["gravity"])),
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
    shapes = {"sphere": {"sphere": {"radius": float(case["radius"])}}, "plane": {"plane": {}}}
    if str(case["obstacle"]):
        scene.add_obstacle(shape={"shape": shapes[str(case["obstacle"])]}, friction=float(case["friction"]))
    for rate in np.unique(case["rate"]):
        scene.pin(0, case["held"][case["rate"] == rate], motion=c.Motion(rotation_rate=(rate, 0, 0)))
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
    builder = n.ModelBuilder(gravity=(0.0, 0.0, -float(case["gravity"])))
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
    if str(case["obstacle"]) == "sphere":
        builder.add_shape_sphere(body=-1, radius=float(case["radius"]))
    elif str(case["obstacle"]) == "plane":
        builder.add_ground_plane()
    for vertex in case["held"].tolist():
        builder.particle_flags[vertex] = builder.particle_flags[vertex] & ~n.ParticleFlags.ACTIVE
    builder.color(include_bending=True)
    model = builder.finalize()
    model.soft_contact_ke, model.soft_contact_kd, model.soft_contact_mu = 1e3, 1e-2, float(case["friction"])
    solver = n.solvers.SolverVBD(
        model, iterations=iterations, particle_enable_self_contact=True,
        particle_self_contact_margin=1.5 * float(case["thickness"]), particle_self_contact_gap=float(case["thickness"]),
        particle_vertex_contact_buffer_size=64, particle_edge_contact_buffer_size=128,
    )  # fmt: skip
    states, control = [model.state(), model.state()], model.control()
    held, rate = wp.array(case["held"], dtype=wp.int32), wp.array(case["rate"], dtype=wp.float32)
    start, clock = wp.clone(states[0].particle_q), wp.zeros(1, dtype=wp.float32)

    @wp.kernel
    def turn(
        held: wp.array(dtype=wp.int32),
        rate: wp.array(dtype=wp.float32),
        start: wp.array(dtype=wp.vec3),
        clock: wp.array(dtype=wp.float32),
        now: wp.array(dtype=wp.vec3),
        next: wp.array(dtype=wp.vec3),
    ):
        k = wp.tid()
        p, angle = start[held[k]], rate[k] * clock[0]
        s, c = wp.sin(angle), wp.cos(angle)
        x = wp.vec3(p[0], c * p[1] - s * p[2], s * p[1] + c * p[2])
        now[held[k]] = x
        next[held[k]] = x

    @wp.kernel
    def tick(clock: wp.array(dtype=wp.float32), step: float):
        clock[0] = clock[0] + step

    pipeline = n.CollisionPipeline(model)
    contacts = pipeline.contacts()
    step = float(case["frame_time"]) / substeps

    def simulate():
        solver.rebuild_bvh(states[0])
        for _ in range(substeps):
            states[0].clear_forces()
            if held.size:
                wp.launch(tick, 1, [clock, step])
                wp.launch(turn, held.size, [held, rate, start, clock, states[0].particle_q, states[1].particle_q])
            pipeline.collide(states[0], contacts)
            solver.step(states[0], states[1], control, contacts, step)
            states[0].assign(states[1])

    advance = simulate
    if device == "cuda":
        simulate()
        for state in states:
            state.assign(model.state())
        clock.zero_()
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

    from uipc import Logger, builtin, view
    from uipc.constitution import (
        AffineBodyConstitution,
        DiscreteShellBending,
        ElasticModuli2D,
        NeoHookeanShell,
        SoftPositionConstraint,
    )
    from uipc.core import Engine, Scene, World
    from uipc.geometry import ground, label_surface, trimesh
    from uipc.unit import MPa

    Logger.set_level(Logger.Level.Warn)
    config = Scene.default_config()
    # the default d_hat of 10 mm is above the 6 mm between the sheets
    rate, near = dict(zip(SETTINGS["libuipc"], [(0, 2e-3), (200, 1.5e-3), (800, 1.5e-3)]))[settings]
    frame = float(case["frame_time"])
    substeps = max(1, round(frame * rate)) if rate else max(1, round(frame / config["dt"]))
    config["dt"] = frame / substeps
    config["gravity"] = [[0.0], [0.0], [-float(case["gravity"])]]
    # cloth that lies flat must not be in contact with itself: libuipc refuses, stretches it, or ends with an error
    ends = case["vertices"][case["faces"]]
    shortest = float(np.linalg.norm(ends - np.roll(ends, 1, axis=1), axis=2).min())
    asked, near = near, min(near, 0.35 * shortest)
    config["contact"]["d_hat"] = near
    scene = Scene(config)
    scene.contact_tabular().default_model(float(case["friction"]), 1e9)
    half = min(0.5 * float(case["thickness"]), 0.15 * shortest)
    shell, bending = NeoHookeanShell(), DiscreteShellBending()
    sheets = trimesh(np.ascontiguousarray(case["vertices"]), np.ascontiguousarray(case["faces"]))
    label_surface(sheets)
    moduli = ElasticModuli2D.youngs_poisson(float(case["young"]) / (2 * half), float(case["poisson"]))
    shell.apply_to(sheets, moduli, float(case["density"]) / (2 * half), half)
    bending.apply_to(sheets, float(case["bending"]))
    if len(case["held"]):
        SoftPositionConstraint().apply_to(sheets, 100.0)
    cloth = scene.objects().create("cloth")
    slot, _ = cloth.geometries().create(sheets)
    step = config["dt"]

    def turn(info):
        vertices = info.geo_slots()[0].geometry().vertices()
        view(vertices.find(builtin.is_constrained))[case["held"]] = 1
        view(vertices.find(builtin.aim_position))[case["held"]] = turned(case, info.frame() * step)[:, :, None]

    if len(case["held"]):
        scene.animator().insert(cloth, turn)
    if str(case["obstacle"]) == "plane":
        scene.objects().create("ground").geometries().create(ground(0.0, np.array([0.0, 0.0, 1.0])))
    elif str(case["obstacle"]) == "sphere":
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
        if not world.is_valid():
            raise SystemExit("libuipc's check of the scene refuses it")

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
            "note": f"for its mesh, d_hat {1e3 * near:.2g} mm and cloth of {2e3 * half:.2g} mm" if near < asked else "",
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
