#!/usr/bin/env python3
"""Races the wheel beside embreex, Open3D, Warp and MuJoCo: one process, the same arrays, CPU time, rounds that
interleave.

scripts/race_python_peers.py [MESH..] [--threads 1 2] [--only QUESTION]..  The interpreter has raystream, embreex,
Open3D, Warp (on the CPU, which is one thread), MuJoCo, and trimesh, which reads the meshes. Without any, three are
generated. On two threads embreex and MuJoCo run in a pool, each on its share of the rays. Prints tables for
docs/results/python.md.
"""

import argparse
import itertools
import math
import os
import statistics
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

# One thread means one: libraries with pools of their own are told before they are loaded.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import mujoco_peer
import numpy as np
import open3d
import raystream
import trimesh
import warp_peer
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

SECONDS = 0.4  # of a measurement, at least
CHUNK = 65_536  # rays of a task of embreex's pool
FEW = 4096  # rays that are not worth a pool


class Peers:
    """The libraries with one mesh."""

    def __init__(self, vertices, faces):
        self.ours = raystream.Mesh(vertices, faces)
        self.embree = rtcore_scene.EmbreeScene()
        TriangleMesh(self.embree, vertices, faces.astype(np.int32))
        self.embree.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))
        self.warp = warp_peer.Queries(vertices, faces)
        self.scenes = {}
        for threads in (1, 2):
            scene = open3d.t.geometry.RaycastingScene(nthreads=threads)
            scene.add_triangles(open3d.core.Tensor(vertices), open3d.core.Tensor(faces.astype(np.uint32)))
            scene.cast_rays(open3d.core.Tensor(np.ones((1, 6), np.float32)))
            self.scenes[threads] = scene


def embree_run(peers, pool, threads, rays, **keywords):
    """embreex on one thread, or in a thread pool over chunks."""
    origins, directions = rays
    if threads == 1 or len(origins) < FEW:
        return lambda: peers.embree.run(origins, directions, **keywords)
    length = min(CHUNK, math.ceil(len(origins) / threads))
    parts = [slice(start, start + length) for start in range(0, len(origins), length)]
    run = lambda part: peers.embree.run(origins[part], directions[part], **keywords)  # noqa: E731
    return lambda: list(pool.map(run, parts))


def questions(peers, rays, points, threads, pool):
    """Each question: its name, ours, and the peers'."""
    origins, directions = np.ascontiguousarray(rays[:, :3]), np.ascontiguousarray(rays[:, 3:])
    tensor, near = open3d.core.Tensor(rays), open3d.core.Tensor(points)
    warp = lambda name, call: {name: call} if threads == 1 else {}  # noqa: E731
    ours, scene, n = peers.ours, peers.scenes[threads], threads
    run = lambda **keywords: embree_run(peers, pool, n, (origins, directions), **keywords)  # noqa: E731
    for some in rays[:1], rays[:100], rays[:10_000]:
        one, other, count = open3d.core.Tensor(some), (some[:, :3].copy(), some[:, 3:].copy()), len(some)
        yield f"cast, {count} ray" + "s" * (count > 1), {
            "raystream": lambda some=some: ours.cast(some, threads=n),
            "embreex": embree_run(peers, pool, n, other, output=1),
            "Open3D": lambda one=one: scene.cast_rays(one, nthreads=n),
        }
    yield "cast, t primitive", {
        "raystream": lambda: ours.cast(rays, threads=n),
        "embreex": run(output=1),
        "Open3D": lambda: scene.cast_rays(tensor, nthreads=n),
        **warp("Warp", lambda: peers.warp.cast(rays)),
    }
    yield "cast with uv, normals", {
        "raystream": lambda: ours.cast(rays, want="t primitive uv normal", threads=n),
        "embreex": run(output=1),
        "Open3D": lambda: scene.cast_rays(tensor, nthreads=n),
    }
    yield "occluded", {
        "raystream": lambda: ours.occluded(rays, threads=n),
        "embreex": run(query="OCCLUDED"),
        "Open3D": lambda: scene.test_occlusions(tensor, nthreads=n),
    }
    yield "count", {
        "raystream": lambda: ours.count(rays, threads=n),
        "Open3D": lambda: scene.count_intersections(tensor, nthreads=n),
    }
    yield "all hits", {
        "raystream": lambda: ours.all_hits(rays, want="t primitive uv", threads=n),
        "Open3D": lambda: scene.list_intersections(tensor, nthreads=n),
    }
    yield "nearest", {
        "raystream": lambda: ours.nearest(points, threads=n),
        "Open3D": lambda: scene.compute_closest_points(near, nthreads=n),
        **warp("Warp", lambda: peers.warp.nearest(points)),
    }
    yield "contains", {
        "raystream": lambda: ours.contains(points, allow_open=True, threads=n),
        "Open3D": lambda: scene.compute_occupancy(near, nthreads=n),
    }
    yield "signed distance", {
        "raystream": lambda: ours.signed_distance(points, allow_open=True, threads=n),
        "Open3D": lambda: scene.compute_signed_distance(near, nthreads=n),
    }


def lidar(threads, pool):
    """A lidar of 64 x 1024 rays over 100 rings that move a little before each turn: ours, Warp's two ways, MuJoCo's."""
    ring = trimesh.creation.torus(1.0, 0.4, major_sections=64, minor_sections=32)
    rng, frames = np.random.default_rng(2), []
    vertices, faces = np.float32(ring.vertices), ring.faces
    axes, at = rng.normal(size=(100, 3)), rng.uniform(-20, 20, (100, 3)) * [1, 1, 0.1]
    for step in range(8):
        # Little by little, so that a tree that is refitted stays good.
        turn = trimesh.transformations.rotation_matrix
        transforms = np.stack([turn(0.05 * step + 2 * axis[0], axis) for axis in axes])
        transforms[:, :3, 3] = at + 0.02 * step
        frames.append(transforms)
    angles = np.radians(np.linspace(-20, 20, 64)), np.linspace(-np.pi, np.pi, 1024, endpoint=False)
    rays = raystream.rays.lidar(*angles, np.eye(4)).reshape(-1, 6)
    world, mesh = raystream.World(), raystream.Mesh(vertices, faces)
    ids = [world.add(mesh, transform) for transform in frames[0]]
    simulated = mujoco_peer.World(vertices, faces, len(ids), rays, pool, threads)
    poses = [mujoco_peer.poses(transforms) for transforms in frames]
    turned, posed = itertools.cycle(frames), itertools.cycle(poses)

    def ours():
        world.set_transforms(ids, next(turned))
        return world.cast(rays, threads=threads)

    def warp(peer):
        peer.move(next(turned))
        return peer.cast(rays)

    # They answer the same question: ours and MuJoCo's distances, once.
    world.set_transforms(ids, frames[0])
    found, other = world.cast(rays).t, simulated.cast(poses[0])
    agree = np.abs(np.where(np.isinf(found), -1, found) - other) < 1e-3
    assert agree.mean() > 0.999 and (other > 0).mean() > 0.1, (agree.mean(), (other > 0).mean())
    calls = {"raystream": ours, "MuJoCo": lambda: simulated.cast(next(posed))}
    if threads == 1:
        refitted, rebuilt = (warp_peer.World(vertices, faces, frames[0], rebuilds) for rebuilds in (False, True))
        calls |= {"Warp, refitted": lambda: warp(refitted), "Warp, rebuilt": lambda: warp(rebuilt)}
    return calls


def cpu_seconds(call, repeats):
    """CPU time of a call, the mean of so many."""
    begun = time.process_time()
    for _ in range(repeats):
        call()
    return (time.process_time() - begun) / repeats


def race(calls, rounds):
    """The median CPU time of each call, in rounds that interleave them.

    Each is called once before it is measured. A hypervisor takes back memory that has been free for a while, and
    whoever gets it first pays many times for its clearing.
    """
    repeats = {}
    for name, call in calls.items():
        call()
        repeats[name] = max(1, round(SECONDS / rounds / max(cpu_seconds(call, 1), 1e-7)))
    times = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            call()
            times[name].append(cpu_seconds(call, repeats[name]))
    return {name: statistics.median(values) for name, values in times.items()}


def arrays(vertices, rays, points, rng):
    """Rays of a camera, random rays, and points around a mesh."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle, size = (low + high) / 2, np.linalg.norm(high - low)
    side = math.isqrt(rays)
    pose = np.eye(4)
    pose[:3, 3] = -(middle - [0, 0, 0.9 * size])
    camera = raystream.rays.pinhole([[side, 0, side / 2], [0, side, side / 2], [0, 0, 1]], pose, side, side)
    random = np.empty((rays, 6), np.float32)
    random[:, :3] = middle + (rng.random((rays, 3)) - 0.5) * 1.2 * (high - low)
    random[:, 3:] = rng.normal(size=(rays, 3))
    near = (middle + (rng.random((points, 3)) - 0.5) * 1.2 * (high - low)).astype(np.float32)
    return {"camera": np.ascontiguousarray(camera.reshape(-1, 6)), "random": random}, near


def generated():
    """A sphere with bumps, a torus, a heap of boxes."""
    ball = trimesh.creation.icosphere(subdivisions=7)
    bumps = 1 + 0.1 * np.sin(ball.vertices * 9).sum(axis=1, keepdims=True)
    yield "bumps", ball.vertices * bumps, ball.faces
    ring = trimesh.creation.torus(1.0, 0.4, major_sections=256, minor_sections=128)
    yield "torus", ring.vertices, ring.faces
    rng, box = np.random.default_rng(0), trimesh.creation.box()
    corners = box.vertices[None] * rng.uniform(0.1, 1, (4000, 1, 3)) + rng.uniform(-12, 12, (4000, 1, 3))
    faces = box.faces[None] + 8 * np.arange(4000)[:, None, None]
    yield "boxes", corners.reshape(-1, 3), faces.reshape(-1, 3)


def named(files):
    """Meshes of files."""
    for file in files:
        mesh = trimesh.load(file, force="mesh", process=False)
        yield file.stem, mesh.vertices, mesh.faces


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", nargs="*", type=Path, metavar="MESH")
    parser.add_argument("--threads", nargs="+", type=int, default=[1, 2], choices=[1, 2])
    parser.add_argument("--rays", type=int, default=1_000_000)
    parser.add_argument("--points", type=int, default=20_000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--only", action="append", metavar="QUESTION")
    arguments = parser.parse_args()
    asked = lambda question: not arguments.only or question in arguments.only  # noqa: E731

    ratios, pool = {}, ThreadPoolExecutor(2)
    for name, vertices, faces in named(arguments.meshes) if arguments.meshes else generated():
        vertices, faces = np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(faces)
        peers, rng = Peers(vertices, faces), np.random.default_rng(1)
        kinds, points = arrays(vertices, arguments.rays, arguments.points, rng)
        for threads in arguments.threads:
            for kind, rays in kinds.items():
                for question, calls in questions(peers, rays, points, threads, pool):
                    of_points = question in ("nearest", "contains", "signed distance")
                    if of_points and kind == "random" or not asked(question):
                        continue
                    seconds = race(calls, arguments.rounds)
                    ours = seconds.pop("raystream")
                    what = f"{name}, {'points' if of_points else kind}, {threads}: {question}"
                    others = ", ".join(f"{peer} {time / ours:.2f}" for peer, time in seconds.items())
                    print(f"{what}: {1e6 * ours:.1f} us; {others}", flush=True)
                    for peer, time_ in seconds.items():
                        ratios.setdefault((question, threads, peer), []).append(time_ / ours)
    for threads in arguments.threads if asked("lidar") else []:
        seconds = race(lidar(threads, pool), arguments.rounds)
        ours = seconds.pop("raystream")
        others = ", ".join(f"{peer} {time / ours:.2f}" for peer, time in seconds.items())
        print(f"100 rings, {threads}: lidar: {1e6 * ours:.1f} us; {others}", flush=True)
        ratios["lidar", threads, "MuJoCo"] = [seconds.pop("MuJoCo") / ours]
        if seconds:
            ratios["lidar", threads, "Warp"] = [min(seconds.values()) / ours]
    print("\n| question | threads | peer | peer's CPU time / ours, mean | least |\n|---|---:|---|---:|---:|")
    for (question, threads, peer), found in ratios.items():
        print(f"| {question} | {threads} | {peer} | {statistics.geometric_mean(found):.2f} | {min(found):.2f} |")


if __name__ == "__main__":
    main()
