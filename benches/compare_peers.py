#!/usr/bin/env python3
"""Whole frames beside Mitsuba 3's and Cycles': same geometry, camera, light, depth and samples, turn by turn.

    python3 -m venv .venv && .venv/bin/pip install mitsuba==3.9.1 bpy==5.0.1 numpy
    .venv/bin/python benches/compare_peers.py --threads 2 cornell terrain.glb sponza.obj

All surfaces are matte with albedo 0.8 under a white sky ("clay"), so that all programs compute the same
picture, which is checked; `cornell` is the Cornell box of `scenes/`, with its own colours and lamp. Nobody
plays Russian roulette, denoises, clamps or adapts samples. Only rendering is timed: every program has the scene
and its tree before. Mitsuba's LLVM variants want Debian's libllvm19 (15 fails on processors with AVX-512).
Prints medians of Mpaths/s, where a path is a camera ray.
"""

import argparse
import dataclasses
import json
import math
import multiprocessing
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np

SKY = [1.0, 1.0, 1.0]
ALBEDO = [0.8, 0.8, 0.8]


@dataclasses.dataclass
class Shape:
    points: np.ndarray
    faces: np.ndarray
    colour: list
    emission: list | None = None


@dataclasses.dataclass
class Scene:
    """What every program renders."""

    shapes: list
    eye: list
    target: list
    fov: float
    reach: float
    sky: list | None
    file: object
    """Raystream's, and its arguments."""
    words: list


def clay(args, path, folder):
    arrays = folder / "mesh.npz"
    subprocess.run([args.raystream, "mesh", path, "-o", arrays], check=True, capture_output=True)
    with np.load(arrays) as mesh:
        shape = Shape(mesh["vertices"], mesh["triangles"], ALBEDO)
    file = write_ply(folder / "mesh.ply", shape)
    low, high = shape.points.min(axis=0).astype(float), shape.points.max(axis=0).astype(float)
    centre, reach = (low + high) / 2, float(np.linalg.norm(high - low))
    eye = centre + reach * np.array(args.view)
    text = lambda vector: ",".join(f"{x:.9g}" for x in vector)
    words = [f"--eye={text(eye)}", f"--target={text(centre)}", "--fov=40", f"--env={text(SKY)}"]
    return Scene([shape], list(eye), list(centre), 40, reach, SKY, file, words)


def cornell():
    path = pathlib.Path(__file__).parent.parent / "scenes/cornell.json"
    recipe = json.loads(path.read_text())
    camera, shapes = recipe["camera"], []
    for shape in recipe["shapes"]:
        fan = [[0, k, k + 1] for k in range(1, len(shape["points"]) - 1)]
        material = recipe["materials"][shape["material"]]
        shapes.append(Shape(np.array(shape["points"]), np.array(fan), material["colour"], material.get("emission")))
    return Scene(shapes, camera["eye"], camera["target"], camera["fov_degrees"], 1000, None, path, [])


def write_ply(path, shape):
    faces = np.empty(len(shape.faces), dtype=[("n", "u1"), ("i", "<u4", 3)])
    faces["n"], faces["i"] = 3, shape.faces
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(shape.points)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(shape.faces)}\nproperty list uchar uint vertex_indices\nend_header\n"
    )
    path.write_bytes(header.encode() + np.asarray(shape.points, "<f4").tobytes() + faces.tobytes())
    return str(path)


# Each program is a generator: primed, it takes a seed and gives seconds and the mean radiance.


def raystream(args, scene, folder):
    out, stats = folder / "out.npy", folder / "out.json"
    width, height = args.size
    command = [args.raystream, "render", scene.file, "-o", out, "--stats", stats, "--tracer", "cpu"]
    command += ["--threads", args.threads, "--size", f"{width}x{height}", "--spp", args.spp]
    command += ["--max-bounces", args.bounces, "--no-russian-roulette", *scene.words]
    answer = None
    while True:
        seed = yield answer
        words = [str(word) for word in [*command, "--seed", seed]]
        subprocess.run(words, check=True, capture_output=True)
        paths = width * height * args.spp / 1e6
        answer = paths / json.loads(stats.read_text())["mpath_per_s"], float(np.load(out).mean())


def mitsuba(args, scene, folder, variant):
    import drjit
    import mitsuba as mi

    mi.set_variant(variant)
    drjit.set_thread_count(args.threads)
    rgb = lambda value: {"type": "rgb", "value": list(value)}
    width, height = args.size
    view = mi.ScalarTransform4f().look_at(origin=list(scene.eye), target=list(scene.target), up=[0, 1, 0])
    film = {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}}
    sensor = {"type": "perspective", "fov": scene.fov, "fov_axis": "y", "to_world": view, "film": film}
    sensor |= {"near_clip": scene.reach * 1e-4, "far_clip": scene.reach * 1e2}
    integrator = {"type": "path", "max_depth": args.bounces + 2, "rr_depth": 10_000}
    whole = {"type": "scene", "integrator": integrator, "sensor": sensor}
    for i, shape in enumerate(scene.shapes):
        ply = write_ply(folder / f"{i}.ply", shape)
        bsdf = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": rgb(shape.colour)}}
        whole[f"shape{i}"] = {"type": "ply", "filename": ply, "face_normals": True, "bsdf": bsdf}
        if shape.emission:
            whole[f"shape{i}"]["emitter"] = {"type": "area", "radiance": rgb(shape.emission)}
    if scene.sky:
        whole["sky"] = {"type": "constant", "radiance": rgb(scene.sky)}
    whole = mi.load_dict(whole)
    np.array(mi.render(whole, spp=args.spp, seed=args.rounds))  # Compiles the kernels.
    answer = None
    while True:
        seed = yield answer
        mi.set_variant(variant)
        started = time.perf_counter()
        image = np.array(mi.render(whole, spp=args.spp, seed=seed))
        answer = time.perf_counter() - started, float(image.mean())


def cycles_process(pipe, args, scene, folder):
    """Cycles in a process of its own: Blender and Mitsuba bring libraries of the same names."""
    import bpy
    import mathutils

    bpy.ops.wm.read_factory_settings(use_empty=True)
    stage = bpy.context.scene
    render, cycles = stage.render, stage.cycles
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y = args.size
    render.threads_mode, render.threads = "FIXED", args.threads
    # Meshes and their tree stay from frame to frame.
    render.use_persistent_data = True
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
    cycles.device, cycles.use_auto_tile = "CPU", False
    cycles.samples = args.spp
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.pixel_filter_type = "BOX"
    cycles.max_bounces = cycles.diffuse_bounces = cycles.min_light_bounces = args.bounces
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    cycles.light_sampling_threshold = 0

    def material(shape):
        made = bpy.data.materials.new("surface")
        made.use_nodes = True
        nodes, links = made.node_tree.nodes, made.node_tree.links
        nodes.clear()
        surface = nodes.new("ShaderNodeBsdfDiffuse")
        surface.inputs["Color"].default_value = [*shape.colour, 1]
        out = nodes.new("ShaderNodeOutputMaterial")
        if shape.emission:
            lamp, both = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeAddShader")
            # Its colour ends at 1, its strength does not.
            strength = max(shape.emission)
            lamp.inputs["Color"].default_value = [*(value / strength for value in shape.emission), 1]
            lamp.inputs["Strength"].default_value = strength
            links.new(surface.outputs[0], both.inputs[0])
            links.new(lamp.outputs[0], both.inputs[1])
            surface = both
        links.new(surface.outputs[0], out.inputs["Surface"])
        return made

    for shape in scene.shapes:
        mesh = bpy.data.meshes.new("mesh")
        mesh.vertices.add(len(shape.points))
        mesh.vertices.foreach_set("co", np.asarray(shape.points, np.float32).ravel())
        mesh.loops.add(3 * len(shape.faces))
        mesh.loops.foreach_set("vertex_index", np.asarray(shape.faces, np.int32).ravel())
        mesh.polygons.add(len(shape.faces))
        mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * len(shape.faces), 3, dtype=np.int32))
        mesh.update(calc_edges=True)
        mesh.shade_flat()
        mesh.materials.append(material(shape))
        stage.collection.objects.link(bpy.data.objects.new("shape", mesh))

    world = bpy.data.worlds.new("sky")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = [*(scene.sky or [0, 0, 0]), 1]
    stage.world = world

    lens = bpy.data.cameras.new("camera")
    lens.sensor_fit, lens.angle = "VERTICAL", math.radians(scene.fov)
    lens.clip_start, lens.clip_end = scene.reach * 1e-4, scene.reach * 1e2
    camera = bpy.data.objects.new("camera", lens)
    back = np.subtract(scene.eye, scene.target)
    back = back / np.linalg.norm(back)
    right = np.cross([0, 1, 0], back)
    right = right / np.linalg.norm(right)
    columns = np.stack([right, np.cross(back, right), back, scene.eye], axis=1)
    camera.matrix_world = mathutils.Matrix([*columns.tolist(), [0, 0, 0, 1]])
    stage.collection.objects.link(camera)
    stage.camera = camera

    bpy.ops.render.render()  # Builds the tree and keeps it.
    pipe.send(None)
    while True:
        cycles.seed = pipe.recv()
        started = time.perf_counter()
        bpy.ops.render.render()
        seconds = time.perf_counter() - started
        bpy.data.images["Render Result"].save_render(str(folder / "cycles.exr"))
        saved = bpy.data.images.load(str(folder / "cycles.exr"))
        pixels = np.empty(len(saved.pixels), np.float32)
        saved.pixels.foreach_get(pixels)
        bpy.data.images.remove(saved)
        pipe.send((seconds, float(pixels.reshape(-1, 4)[:, :3].mean())))


def cycles(args, scene, folder):
    ours, theirs = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(
        target=cycles_process, args=(theirs, args, scene, folder), daemon=True
    )
    process.start()
    theirs.close()
    try:
        answer = ours.recv()
        while True:
            seed = yield answer
            ours.send(seed)
            answer = ours.recv()
    finally:
        process.kill()


def compare(args, name):
    """Prints a row for each program; returns whether their pictures agree."""
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        scene = cornell() if name == "cornell" else clay(args, name, folder)
        programs = {"raystream": raystream(args, scene, folder)}
        for peer in args.peers.split(","):
            programs[peer] = cycles(args, scene, folder) if peer == "cycles" else mitsuba(args, scene, folder, peer)
        for program in programs.values():
            next(program)
        answers = {peer: [] for peer in programs}
        for turn in range(args.rounds):
            for peer, program in programs.items():
                answers[peer].append(program.send(turn))
        for program in programs.values():
            program.close()
    paths = args.size[0] * args.size[1] * args.spp / 1e6
    speeds = {peer: [paths / seconds for seconds, _ in turns] for peer, turns in answers.items()}
    means = {peer: statistics.mean(mean for _, mean in turns) for peer, turns in answers.items()}
    best = statistics.median(speeds["raystream"])
    for peer, values in speeds.items():
        median = statistics.median(values)
        spread = f"{min(values):.2f}-{max(values):.2f}"
        row = f"{pathlib.Path(name).stem:<20}{peer:<14}{median:>9.2f}{spread:>14}{means[peer]:>12.4f}{best / median:>8.2f}x"
        print(row, flush=True)
    return all(abs(mean / means["raystream"] - 1) < 0.02 for mean in means.values())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", help="scene files, or `cornell`")
    parser.add_argument("--raystream", default="target/release/raystream")
    parser.add_argument("--peers", default="llvm_ad_rgb,scalar_rgb,cycles", help="variants of Mitsuba, and cycles")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--size", type=lambda s: tuple(map(int, s.split("x"))), default=(640, 480))
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--bounces", type=int, default=3)
    parser.add_argument("--rounds", type=int, default=5)
    view = lambda s: tuple(map(float, s.split(",")))
    parser.add_argument("--view", type=view, default=(0.35, 0.4, 0.6), help="the eye, in diagonals from the middle")
    args = parser.parse_args()
    args.raystream = str(pathlib.Path(args.raystream).resolve())
    print(f"{'scene':<20}{'program':<14}{'Mpaths/s':>9}{'spread':>14}{'radiance':>12}{'ours':>9}")
    agree = [compare(args, scene) for scene in args.scenes]
    if not all(agree):
        sys.exit("the pictures differ by more than 2 % in the mean")


if __name__ == "__main__":
    main()
