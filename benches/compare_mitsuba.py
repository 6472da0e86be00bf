#!/usr/bin/env python3
"""Whole frames beside Mitsuba 3's: same geometry, camera, light, depth and samples, turn by turn.

    python3 -m venv .venv && .venv/bin/pip install mitsuba==3.9.1 numpy
    .venv/bin/python benches/compare_mitsuba.py --threads 2 cornell terrain.glb sponza.obj

All surfaces are matte with albedo 0.8 under a white sky ("clay"), so that both programs compute the same
picture, which is checked; `cornell` is the Cornell box of `scenes/`, with its own colours and lamp. Mitsuba's LLVM variants want
Debian's libllvm19 (15 fails on processors with AVX-512). Prints medians of Mpaths/s, where a path is a camera ray.
"""

import argparse
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np

SKY = [1.0, 1.0, 1.0]
ALBEDO = 0.8


def raystream(args, scene, out, extra):
    """Renders once; returns Mpaths/s and the mean radiance."""
    stats = out.with_suffix(".json")
    width, height = args.size
    command = [args.raystream, "render", scene, "-o", out, "--stats", stats, "--tracer", "cpu"]
    command += ["--threads", args.threads, "--size", f"{width}x{height}", "--spp", args.spp]
    command += ["--max-bounces", args.bounces, "--no-russian-roulette", *extra]
    subprocess.run([str(word) for word in command], check=True, capture_output=True)
    return json.loads(stats.read_text())["mpath_per_s"], float(np.load(out).mean())


def write_ply(path, vertices, triangles):
    faces = np.empty(len(triangles), dtype=[("n", "u1"), ("i", "<u4", 3)])
    faces["n"], faces["i"] = 3, triangles
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(triangles)}\nproperty list uchar uint vertex_indices\nend_header\n"
    )
    path.write_bytes(header.encode() + np.asarray(vertices, "<f4").tobytes() + faces.tobytes())
    return str(path)


def matte(colour):
    bsdf = {"type": "diffuse", "reflectance": {"type": "rgb", "value": colour}}
    return {"type": "twosided", "bsdf": bsdf}


def sensor(mi, args, eye, target, fov, reach):
    width, height = args.size
    return {
        "type": "perspective",
        "fov": fov,
        "fov_axis": "y",
        "near_clip": reach * 1e-4,
        "far_clip": reach * 1e2,
        "to_world": mi.ScalarTransform4f().look_at(origin=list(eye), target=list(target), up=[0, 1, 0]),
        "film": {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}},
    }


def clay(args, scene, folder):
    """Files and arguments for raystream, and the scene for Mitsuba: all matte, under a white sky."""
    arrays = folder / "mesh.npz"
    subprocess.run([args.raystream, "mesh", scene, "-o", arrays], check=True, capture_output=True)
    with np.load(arrays) as mesh:
        vertices, triangles = mesh["vertices"], mesh["triangles"]
    ply = write_ply(folder / "mesh.ply", vertices, triangles)
    low, high = vertices.min(axis=0).astype(float), vertices.max(axis=0).astype(float)
    centre, reach = (low + high) / 2, float(np.linalg.norm(high - low))
    eye = centre + reach * np.array(args.view)
    text = lambda vector: ",".join(f"{x:.9g}" for x in vector)
    extra = [f"--eye={text(eye)}", f"--target={text(centre)}", "--fov=40", f"--env={text(SKY)}"]

    def peer(mi):
        return {
            "sensor": sensor(mi, args, eye, centre, 40, reach),
            "mesh": {"type": "ply", "filename": ply, "face_normals": True, "bsdf": matte([ALBEDO] * 3)},
            "sky": {"type": "constant", "radiance": {"type": "rgb", "value": SKY}},
        }

    return ply, extra, peer


def cornell(args, folder):
    path = pathlib.Path(__file__).parent.parent / "scenes/cornell.json"
    recipe = json.loads(path.read_text())
    camera = recipe["camera"]

    def peer(mi):
        scene = {"sensor": sensor(mi, args, camera["eye"], camera["target"], camera["fov_degrees"], 1000)}
        for i, shape in enumerate(recipe["shapes"]):
            points = shape["points"]
            fan = [[0, k, k + 1] for k in range(1, len(points) - 1)]
            ply = write_ply(folder / f"{i}.ply", points, fan)
            material = recipe["materials"][shape["material"]]
            scene[f"shape{i}"] = {"type": "ply", "filename": ply, "face_normals": True, "bsdf": matte(material["colour"])}
            if "emission" in material:
                radiance = {"type": "rgb", "value": material["emission"]}
                scene[f"shape{i}"]["emitter"] = {"type": "area", "radiance": radiance}
        return scene

    return path, [], peer


def compare(mi, args, scene):
    """Prints a row for each program; returns whether their pictures agree."""
    variants = args.variants.split(",")
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        ours, extra, peer = cornell(args, folder) if scene == "cornell" else clay(args, scene, folder)
        scenes = {}
        for variant in variants:
            mi.set_variant(variant)
            integrator = {"type": "path", "max_depth": args.bounces + 2, "rr_depth": 10_000}
            scenes[variant] = mi.load_dict({"type": "scene", "integrator": integrator, **peer(mi)})
            np.array(mi.render(scenes[variant], spp=args.spp, seed=args.rounds))  # Compiles the kernels.
        speeds = {name: [] for name in ["raystream", *variants]}
        means = {}
        paths = args.size[0] * args.size[1] * args.spp / 1e6
        for turn in range(args.rounds):
            speed, means["raystream"] = raystream(args, ours, folder / "out.npy", extra)
            speeds["raystream"].append(speed)
            for variant in variants:
                mi.set_variant(variant)
                started = time.perf_counter()
                means[variant] = float(np.array(mi.render(scenes[variant], spp=args.spp, seed=turn)).mean())
                speeds[variant].append(paths / (time.perf_counter() - started))
    best = statistics.median(speeds["raystream"])
    for name, values in speeds.items():
        median = statistics.median(values)
        spread = f"{min(values):.2f}-{max(values):.2f}"
        row = f"{pathlib.Path(scene).stem:<20}{name:<14}{median:>9.2f}{spread:>14}{means[name]:>12.4f}{best / median:>8.2f}x"
        print(row, flush=True)
    return all(abs(mean / means["raystream"] - 1) < 0.02 for mean in means.values())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", help="scene files, or `cornell`")
    parser.add_argument("--raystream", default="target/release/raystream")
    parser.add_argument("--variants", default="llvm_ad_rgb,scalar_rgb")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--size", type=lambda s: tuple(map(int, s.split("x"))), default=(640, 480))
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--bounces", type=int, default=3)
    parser.add_argument("--rounds", type=int, default=5)
    view = lambda s: tuple(map(float, s.split(",")))
    parser.add_argument("--view", type=view, default=(0.35, 0.4, 0.6), help="the eye, in diagonals from the middle")
    args = parser.parse_args()
    args.raystream = str(pathlib.Path(args.raystream).resolve())

    import drjit
    import mitsuba

    mitsuba.set_variant(args.variants.split(",")[0])
    drjit.set_thread_count(args.threads)
    print(f"{'scene':<20}{'program':<14}{'Mpaths/s':>9}{'spread':>14}{'radiance':>12}{'ours':>9}")
    agree = [compare(mitsuba, args, scene) for scene in args.scenes]
    if not all(agree):
        sys.exit("the pictures differ by more than 2 % in the mean")


if __name__ == "__main__":
    main()
