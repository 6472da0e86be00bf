#!/usr/bin/env python3
"""Whole frames beside Mitsuba 3's and Cycles': same geometry, camera, light, depth and samples, turn by turn.

    python3 -m venv .venv && .venv/bin/pip install mitsuba==3.9.1 bpy==5.0.1 numpy
    .venv/bin/python scripts/compare_peers.py --threads 2 cornell terrain.glb sponza.obj
    .venv/bin/python scripts/compare_peers.py --threads 2 --real terrain.glb sponza.obj

All surfaces are matte with albedo 0.8 ("clay"), lit by the scene's lamps or, if it has none, a white sky, so that all
programs compute the same picture, which is checked. SCENE@EYE@TARGET@FOV (x,y,z, degrees) says from where; else it is
seen from outside. `cornell` is the Cornell box of `scenes/`, with its own colours and lamp, `materials` are balls of
glass, rough and polished metal, gloss and coat under a lamp, `bathroom` and `level` the rooms of `peer_rooms.py`
(`materials` and `bathroom` not for Mitsuba's scalar variants, to which glTF's surface must be taught). With --real
surfaces are as the files have them: textures, masks, metal, gloss, glass and vertex normals, as near as each program's
own come, so pictures agree less closely. No program denoises, clamps or adapts samples, or plays Russian roulette; with
--roulette each plays its own (Cycles has none here). Only rendering is timed: every program has the scene and its tree
before.
A variant of Mitsuba may name a sampler (`llvm_ad_rgb:multijitter`); `cycles:defaults` is Cycles with its light tree,
its clamp of indirect light and its blurred gloss.
Mitsuba's LLVM variants want Debian's libllvm19 (15 fails on processors with AVX-512).

Prints medians of Mpaths/s, where a path is a camera ray, and the relative squared error of a picture times its seconds:
half as much is the same error in half of the time. The error is the mean of (a - b)^2 / (b^2 + 0.01 mean(b)^2) over
pixels and channels but for the worst 0.1 % of the pixels. b is the mean of --references pictures of the same program
with other seeds, since materials differ between programs; the error of b itself is taken out.
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

import agree_with_mitsuba
from agree_with_mitsuba import FLOOR, LAMP, WALL, sphere, write_obj, write_ply
from cycles_stage import empty_stage, light_from_around, look_from, pixels_of
from peer_rooms import bathroom, level

NONE = 0xFFFFFFFF
SKY = [1.0, 1.0, 1.0]
ALBEDO = [0.8, 0.8, 0.8]
TOLERANCE, REAL_TOLERANCE = 0.02, 0.1
"""Of the pictures' means."""


@dataclasses.dataclass
class Scene:
    """What every program renders."""

    parts: list
    """Points and faces, and a material as in `agree_with_mitsuba.SCENES`."""
    eye: list
    target: list
    fov: float
    reach: float
    sky: list | None
    file: object
    """Raystream's, and its arguments."""
    words: list


@dataclasses.dataclass
class Look:
    """A surface as a file has it, with what belongs to the vertices of its part."""

    base: np.ndarray
    image: np.ndarray | None
    metallic: float
    roughness: float
    specular: float
    transmission: float
    ior: float
    thin: bool
    opacity: float
    mask: np.ndarray | None
    normals: np.ndarray | None
    uvs: np.ndarray | None


def look(mesh, material, used):
    texels = lambda k: mesh[f"texture{k}"].view(np.uint8).reshape(*mesh[f"texture{k}"].shape, 4) / np.float32(255)
    image, mask = mesh["base_texture"][material], mesh["opacity_texture"][material]
    names = ("metallic", "roughness", "specular", "transmission", "ior", "opacity")
    numbers = {name: float(mesh[name][material]) for name in names}
    normals = mesh["normals"][used] if len(mesh["normals"]) else np.zeros((1, 3))
    channel = [0, 1, 2] if mesh["opacity_channel"][material] == 4 else [mesh["opacity_channel"][material]]
    return Look(
        base=mesh["base_colour"][material],
        image=texels(image)[..., :3] if image != NONE else None,
        thin=bool(mesh["thin"][material]),
        mask=texels(mask)[..., channel].mean(axis=2) if mask != NONE else None,
        normals=normals if normals.any(axis=1).all() else None,
        uvs=mesh["uvs"][used] if len(mesh["uvs"]) else None,
        **numbers,
    )


def of_file(args, name, folder):
    path, *view = name.split("@")
    arrays = folder / "mesh.npz"
    subprocess.run([args.raystream, "mesh", path, "-o", arrays, "--images"], check=True, capture_output=True)
    with np.load(arrays) as file:
        mesh = {key: file[key] for key in file}
    points, faces, material, emission = (mesh[k] for k in ("vertices", "triangles", "material", "emission"))
    parts, lamps = [], [m for m in np.unique(material) if emission[m].any()]
    for one in np.unique(material) if args.real else [None, *lamps]:
        shown = faces[~np.isin(material, lamps) if one is None else material == one]
        used, local = np.unique(shown, return_inverse=True)
        shines = {"lamp": emission[one].tolist()} if one in lamps else {}
        surface = {"look": look(mesh, one, used)} if args.real else {"matte": ALBEDO}
        parts.append(((points[used], local.reshape(-1, 3)), {**surface, **shines}))
    file = pathlib.Path(path).resolve() if args.real else write_obj(folder, {"parts": parts})
    low, high = points.min(axis=0).astype(float), points.max(axis=0).astype(float)
    reach = float(np.linalg.norm(high - low))
    if view:
        eye, target = ([float(x) for x in words.split(",")] for words in view[:2])
        fov = float(view[2])
    else:
        target = (low + high) / 2
        eye, fov = target + reach * np.array([0.35, 0.4, 0.6]), 40
    text = lambda vector: ",".join(f"{x:.9g}" for x in vector)
    words = [f"--eye={text(eye)}", f"--target={text(target)}", f"--fov={fov}"]
    sky = None if lamps else SKY
    return Scene(parts, list(eye), list(target), fov, reach, sky, file, words)


def cornell():
    path = pathlib.Path(__file__).parent.parent / "scenes/cornell.json"
    recipe = json.loads(path.read_text())
    camera, parts = recipe["camera"], []
    for shape in recipe["shapes"]:
        fan = [[0, k, k + 1] for k in range(1, len(shape["points"]) - 1)]
        material = recipe["materials"][shape["material"]]
        lamp = {"lamp": material["emission"]} if "emission" in material else {}
        parts.append(((np.array(shape["points"]), np.array(fan)), {"matte": material["colour"], **lamp}))
    return Scene(parts, camera["eye"], camera["target"], camera["fov_degrees"], 1000, None, path, [])


def materials(folder):
    kinds = [
        {"glass": 1.5},
        {"metal": (0.9, 0.6, 0.3), "roughness": 0.5},
        {"coat": (0.7, 0.2, 0.1), "roughness": 0.7},
        {"gloss": (0.2, 0.3, 0.8), "roughness": 0.5},
        {"mirror": (0.9, 0.8, 0.7)},
    ]
    places = [(-1.7, 0.6, -0.6), (-0.5, 0.6, -1.2), (0.9, 0.6, -1.0), (-0.6, 0.6, 0.6), (0.8, 0.6, 0.4)]
    parts = [FLOOR, WALL, LAMP, *((sphere(place, 0.6, 5), kind) for place, kind in zip(places, kinds))]
    file = write_obj(folder, {"parts": parts})
    eye, target = [0, 2.2, 5.2], [0, 0.7, 0]
    words = [f"--eye={','.join(map(str, eye))}", f"--target={','.join(map(str, target))}", "--fov=40"]
    return Scene(parts, eye, target, 40, 10, None, file, words)


def room(made, folder):
    parts, eye, target, fov = made()
    file = write_obj(folder, {"parts": parts})
    text = lambda vector: ",".join(map(str, vector))
    words = [f"--eye={text(eye)}", f"--target={text(target)}", f"--fov={fov}"]
    return Scene(parts, list(eye), list(target), fov, 30, None, file, words)


def linear(image, factor):
    return (np.where(image <= 0.04045, image / 12.92, ((image + 0.055) / 1.055) ** 2.4) * factor).astype(np.float32)


def mitsuba_surface(mi, look):
    bitmap = lambda values: {"type": "bitmap", "bitmap": mi.Bitmap(np.ascontiguousarray(values)), "raw": True}
    base = {"type": "rgb", "value": look.base.tolist()}
    if look.image is not None:
        base = bitmap(linear(look.image, look.base))
    if look.transmission > 0.5:
        surface = {"type": "thindielectric" if look.thin else "dielectric", "int_ior": look.ior, "ext_ior": 1.0}
    elif look.metallic > 0.5 and look.roughness < 0.05:
        surface = {"type": "conductor", "material": "none", "specular_reflectance": base}
    elif look.specular == 0 and look.metallic < 0.5:
        surface = {"type": "diffuse", "reflectance": base}
    elif look.roughness < 0.05:
        surface = {"type": "plastic", "diffuse_reflectance": base, "int_ior": look.ior, "nonlinear": True}
    else:
        surface = {"type": "principled", "base_color": base, "roughness": look.roughness, "metallic": look.metallic}
    if look.transmission <= 0.5:
        surface = {"type": "twosided", "bsdf": surface}
    if look.opacity < 1 or look.mask is not None:
        masked = lambda: bitmap((look.mask * look.opacity)[..., None].astype(np.float32))
        opacity = look.opacity if look.mask is None else masked()
        surface = {"type": "mask", "opacity": opacity, "bsdf": surface}
    return surface


# Each program is a generator: primed, it takes a seed and gives seconds and the picture, (height, width, 3) float32.


def raystream(args, scene, folder):
    out, stats = folder / "out.npy", folder / "out.json"
    width, height = args.size
    command = [args.raystream, "render", scene.file, "-o", out, "--stats", stats, "--tracer", "cpu"]
    # No light but the scene's, where a room is open.
    command += [f"--env={','.join(map(str, scene.sky or (0, 0, 0)))}"]
    command += ["--threads", args.threads, "--size", f"{width}x{height}", "--spp", args.spp]
    command += ["--max-bounces", args.bounces, *([] if args.roulette else ["--no-russian-roulette"]), *scene.words]
    answer = None
    while True:
        seed = yield answer
        words = [str(word) for word in [*command, "--seed", seed]]
        subprocess.run(words, check=True, capture_output=True)
        paths = width * height * args.spp / 1e6
        answer = paths / json.loads(stats.read_text())["mpath_per_s"], np.load(out)


def mitsuba(args, scene, folder, variant):
    import drjit
    import mitsuba as mi

    variant, _, sampler = variant.partition(":")
    mi.set_variant(variant)
    drjit.set_thread_count(args.threads)
    rgb = lambda value: {"type": "rgb", "value": list(value)}
    width, height = args.size
    view = mi.ScalarTransform4f().look_at(origin=list(scene.eye), target=list(scene.target), up=[0, 1, 0])
    film = {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}}
    sensor = {"type": "perspective", "fov": scene.fov, "fov_axis": "y", "to_world": view, "film": film}
    sensor["sampler"] = {"type": sampler or "independent", "sample_count": args.spp}
    sensor |= {"near_clip": scene.reach * 1e-4, "far_clip": scene.reach * 1e2}
    integrator = {"type": "path", "max_depth": args.bounces + 2, "rr_depth": 5 if args.roulette else 10_000}
    whole = {"type": "scene", "integrator": integrator, "sensor": sensor}
    if variant.startswith("llvm"):
        agree_with_mitsuba.define_gltf(mi)
    for i, ((points, faces), material) in enumerate(scene.parts):
        look = material.get("look")
        normals, uvs = (look.normals, look.uvs) if look else (None, None)
        ply = write_ply(folder / f"{i}.ply", points, faces, normals, uvs)
        surface = mitsuba_surface(mi, look) if look else agree_with_mitsuba.bsdf(material)
        whole[f"part{i}"] = {"type": "ply", "filename": ply, "face_normals": normals is None, "bsdf": surface}
        if "lamp" in material:
            whole[f"part{i}"]["emitter"] = {"type": "area", "radiance": rgb(material["lamp"])}
    if scene.sky:
        whole["sky"] = {"type": "constant", "radiance": rgb(scene.sky)}
    whole = mi.load_dict(whole)
    np.array(mi.render(whole, spp=args.spp, seed=args.rounds + args.references))  # Compiles the kernels.
    answer = None
    while True:
        seed = yield answer
        mi.set_variant(variant)
        started = time.perf_counter()
        image = np.array(mi.render(whole, spp=args.spp, seed=seed))
        answer = time.perf_counter() - started, image


def cycles_process(pipe, args, scene, folder, defaults):
    """Cycles in a process of its own: Blender and Mitsuba bring libraries of the same names."""
    import bpy

    stage = empty_stage(args.size, args.spp)
    render, cycles = stage.render, stage.cycles
    render.threads_mode, render.threads = "FIXED", args.threads
    # Meshes and their tree stay from frame to frame.
    render.use_persistent_data = True
    cycles.use_auto_tile = False
    for kind in ("max", "diffuse", "glossy", "transmission", "min_light"):
        setattr(cycles, f"{kind}_bounces", args.bounces)
    if not defaults:
        cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
        cycles.light_sampling_threshold = cycles.blur_glossy = 0
        cycles.use_light_tree = False

    def image_node(nodes, links, name, pixels, colour_space):
        height, width, _ = pixels.shape
        image = bpy.data.images.new(name, width, height)
        image.colorspace_settings.name = colour_space
        opaque = np.concatenate([pixels, np.ones((height, width, 1), np.float32)], axis=2)
        image.pixels.foreach_set(np.ascontiguousarray(opaque[::-1]).ravel())
        node = nodes.new("ShaderNodeTexImage")
        node.image = image
        return node.outputs["Color"]

    def seen(nodes, links, look):
        base = [*look.base.tolist(), 1]
        if look.specular == 0 and look.metallic < 0.5 and look.transmission < 0.5:
            bsdf = nodes.new("ShaderNodeBsdfDiffuse")
            colour = bsdf.inputs["Color"]
        else:
            bsdf = nodes.new("ShaderNodeBsdfPrincipled")
            colour = bsdf.inputs["Base Color"]
            bsdf.inputs["Roughness"].default_value = look.roughness
            bsdf.inputs["Metallic"].default_value = look.metallic
            bsdf.inputs["IOR"].default_value = look.ior
            bsdf.inputs["Transmission Weight"].default_value = look.transmission
        colour.default_value = base
        if look.image is not None:
            times = nodes.new("ShaderNodeVectorMath")
            times.operation = "MULTIPLY"
            links.new(image_node(nodes, links, "base", look.image, "sRGB"), times.inputs[0])
            times.inputs[1].default_value = base[:3]
            links.new(times.outputs[0], colour)
        if look.mask is None and look.opacity == 1:
            return bsdf
        clear, mixed = nodes.new("ShaderNodeBsdfTransparent"), nodes.new("ShaderNodeMixShader")
        mixed.inputs[0].default_value = look.opacity
        if look.mask is not None:
            grey = np.repeat(look.mask[..., None] * look.opacity, 3, axis=2)
            links.new(image_node(nodes, links, "mask", grey, "Non-Color"), mixed.inputs[0])
        links.new(clear.outputs[0], mixed.inputs[1])
        links.new(bsdf.outputs[0], mixed.inputs[2])
        return mixed

    def surface(material):
        made = bpy.data.materials.new("surface")
        made.use_nodes = True
        nodes, links = made.node_tree.nodes, made.node_tree.links
        nodes.clear()
        if "look" in material:
            bsdf = seen(nodes, links, material["look"])
        elif "matte" in material:
            bsdf = nodes.new("ShaderNodeBsdfDiffuse")
            bsdf.inputs["Color"].default_value = [*material["matte"], 1]
        else:
            bsdf = nodes.new("ShaderNodeBsdfPrincipled")
            kind = next(kind for kind in ("glass", "mirror", "metal", "coat", "gloss") if kind in material)
            colour = [1, 1, 1] if kind == "glass" else material[kind]
            bsdf.inputs["Base Color"].default_value = [*colour, 1]
            bsdf.inputs["IOR"].default_value = material.get("glass", 1.5)
            bsdf.inputs["Roughness"].default_value = material.get("roughness", 0)
            bsdf.inputs["Metallic"].default_value = float(kind in ("metal", "mirror"))
            bsdf.inputs["Transmission Weight"].default_value = float(kind == "glass")
            bsdf.inputs["Coat Weight"].default_value = float(kind == "coat")
            bsdf.inputs["Coat Roughness"].default_value = 0
        if "lamp" in material:
            lamp, both = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeAddShader")
            # Its colour ends at 1, its strength does not.
            strength = max(material["lamp"])
            lamp.inputs["Color"].default_value = [*(value / strength for value in material["lamp"]), 1]
            lamp.inputs["Strength"].default_value = strength
            links.new(bsdf.outputs[0], both.inputs[0])
            links.new(lamp.outputs[0], both.inputs[1])
            bsdf = both
        links.new(bsdf.outputs[0], nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
        return made

    for (points, faces), material in scene.parts:
        mesh = bpy.data.meshes.new("mesh")
        mesh.vertices.add(len(points))
        mesh.vertices.foreach_set("co", np.asarray(points, np.float32).ravel())
        mesh.loops.add(3 * len(faces))
        mesh.loops.foreach_set("vertex_index", np.asarray(faces, np.int32).ravel())
        mesh.polygons.add(len(faces))
        mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * len(faces), 3, dtype=np.int32))
        mesh.update(calc_edges=True)
        mesh.shade_flat()
        if look := material.get("look"):
            if look.uvs is not None:
                coordinates = (look.uvs * [1, -1] + [0, 1])[np.asarray(faces).ravel()].astype(np.float32)
                mesh.uv_layers.new().uv.foreach_set("vector", coordinates.ravel())
            if look.normals is not None:
                mesh.shade_smooth()
                mesh.normals_split_custom_set_from_vertices(look.normals.tolist())
        mesh.materials.append(surface(material))
        stage.collection.objects.link(bpy.data.objects.new("part", mesh))

    light_from_around(stage, scene.sky or [0, 0, 0])
    lens = look_from(stage, scene.eye, scene.target, scene.fov)
    lens.clip_start, lens.clip_end = scene.reach * 1e-4, scene.reach * 1e2

    bpy.ops.render.render()  # Builds the tree and keeps it.
    pipe.send(None)
    while True:
        cycles.seed = pipe.recv()
        started = time.perf_counter()
        bpy.ops.render.render()
        seconds = time.perf_counter() - started
        bpy.data.images["Render Result"].save_render(str(folder / "cycles.exr"))
        pipe.send((seconds, pixels_of(folder / "cycles.exr", args.size)))


def cycles(args, scene, folder, defaults):
    ours, theirs = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(
        target=cycles_process, args=(theirs, args, scene, folder, defaults), daemon=True
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


def error(picture, reference, pictures):
    """The robust relative squared error of a picture, where the reference is the mean of so many others."""
    a, b = picture.astype(np.float64), reference.astype(np.float64)
    errors = np.sort(((a - b) ** 2 / (b**2 + 0.01 * b.mean() ** 2)).mean(axis=2).ravel())
    kept = errors[: errors.size - min(math.ceil(errors.size / 1000), errors.size - 1)]
    return float(kept.mean()) / (1 + 1 / pictures)


def compare(args, name):
    """Prints a row for each program; returns whether their pictures agree."""
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        made = {"cornell": cornell, "materials": lambda: materials(folder)}
        made |= {one.__name__: lambda one=one: room(one, folder) for one in (bathroom, level)}
        scene = made[name]() if name in made else of_file(args, name, folder)
        programs = {"raystream": raystream(args, scene, folder)}
        for peer in filter(None, args.peers.split(",")):
            if peer.startswith("cycles"):
                programs[peer] = cycles(args, scene, folder, peer == "cycles:defaults")
            else:
                programs[peer] = mitsuba(args, scene, folder, peer)
        for program in programs.values():
            next(program)
        answers = {peer: [] for peer in programs}
        for turn in range(args.rounds):
            for peer, program in programs.items():
                answers[peer].append(program.send(turn))
        references = {}
        for peer, program in programs.items():
            pictures = (program.send(args.rounds + i)[1].astype(np.float64) for i in range(args.references))
            references[peer] = sum(pictures) / args.references
            program.close()
    paths = args.size[0] * args.size[1] * args.spp / 1e6
    speeds = {peer: [paths / seconds for seconds, _ in turns] for peer, turns in answers.items()}
    means = {peer: statistics.mean(float(picture.mean()) for _, picture in turns) for peer, turns in answers.items()}
    costs = {}
    for peer, turns in answers.items():
        errors = [error(picture, references[peer], args.references) for _, picture in turns]
        costs[peer] = statistics.mean(errors) * statistics.median(seconds for seconds, _ in turns)
    best = statistics.median(speeds["raystream"])
    for peer, values in speeds.items():
        median = statistics.median(values)
        spread = f"{min(values):.2f}-{max(values):.2f}"
        row = f"{pathlib.Path(name.split('@')[0]).stem:<20}{peer:<24}{median:>9.2f}"
        row += f"{spread:>14}{means[peer]:>12.4f}{best / median:>8.2f}x"
        row += f"{costs[peer]:>12.5f}{costs[peer] / costs['raystream']:>8.2f}x"
        print(row, flush=True)
    tolerance = REAL_TOLERANCE if args.real else TOLERANCE
    return all(abs(mean / means["raystream"] - 1) < tolerance for mean in means.values())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", help="scene files, `cornell`, `materials`, `bathroom` or `level`")
    parser.add_argument("--raystream", default="target/release/raystream")
    parser.add_argument("--peers", default="llvm_ad_rgb,scalar_rgb,cycles", help="variants of Mitsuba, and cycles")
    parser.add_argument("--real", action="store_true", help="surfaces as the files have them, not clay")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--size", type=lambda s: tuple(map(int, s.split("x"))), default=(640, 480))
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--bounces", type=int, default=3)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--references", type=int, default=32, help="pictures that errors are measured against")
    parser.add_argument("--roulette", action="store_true", help="each program plays its own Russian roulette")
    args = parser.parse_args()
    args.raystream = str(pathlib.Path(args.raystream).resolve())
    head = f"{'scene':<20}{'program':<24}{'Mpaths/s':>9}{'spread':>14}{'radiance':>12}{'ours':>9}"
    print(f"{head}{'error x s':>12}{'ours':>9}")
    agree = [compare(args, scene) for scene in args.scenes]
    if not all(agree):
        sys.exit("the pictures' means differ")


if __name__ == "__main__":
    main()
