"""Ambient occlusion of each vertex of a scene, and a picture that interpolates it.

python python/examples/ambient_occlusion.py [--rays 256] [-o ambient_occlusion.png]
"""

import argparse
import time

import numpy as np
import raystream as rs
from shapes import box, torus, vertex_normals


def hemispheres(normals, count, rng):
    """Directions about normals, `(v, count, 3)`, as many towards each as its cosine."""
    tilt, turn = rng.random((2, len(normals), count), np.float32)
    radius, angle = np.sqrt(tilt), 2 * np.pi * turn
    other = np.where(np.abs(normals[:, :1]) < 0.5, np.float32([[1, 0, 0]]), np.float32([[0, 1, 0]]))
    across = np.cross(normals, other)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    along = np.cross(normals, across)
    parts = (radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - tilt))
    return sum(part[..., None] * axis[:, None] for part, axis in zip(parts, (across, along, normals)))


def grid(size, count):
    """A horizontal square at z = 0, with its faces up."""
    along = np.linspace(-size, size, count, dtype=np.float32)
    x, y = np.meshgrid(along, along, indexing="ij")
    vertices = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(count - 1), np.arange(count - 1), indexing="ij")
    a = (i * count + j).ravel()
    first, second = (a, a + count, a + count + 1), (a, a + count + 1, a + 1)
    return vertices, np.concatenate([np.stack(first, axis=1), np.stack(second, axis=1)])


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rays", type=int, default=256, help="rays a vertex")
    parser.add_argument("-o", "--output", default="ambient_occlusion.png")
    arguments = parser.parse_args()

    ring, ring_faces = torus(1.0, 0.35)
    parts = [grid(3.0, 160), (ring + np.float32([0, 0, 0.36]), ring_faces), torus(0.45, 0.18)]
    parts[2] = (parts[2][0][:, [0, 2, 1]] * np.float32([1, -1, 1]) + np.float32([0, 0, 1.2]), parts[2][1])
    firsts = np.cumsum([0] + [len(vertices) for vertices, _ in parts])
    vertices = np.concatenate([vertices for vertices, _ in parts])
    faces = np.concatenate([faces + first for (_, faces), first in zip(parts, firsts)])
    normals = vertex_normals(vertices, faces)
    mesh = rs.Mesh(vertices, faces)

    directions = hemispheres(normals, arguments.rays, np.random.default_rng(0)).astype(np.float32)
    origins = vertices + np.float32(1e-3) * normals
    begun = time.perf_counter()
    occluded = mesh.occluded(np.broadcast_to(origins[:, None], directions.shape), directions, t_max=2.0)
    seconds = time.perf_counter() - begun
    print(f"{occluded.size} rays in {seconds:.2f} s, {1e-6 * occluded.size / seconds:.1f} million a second")
    light = 1 - occluded.mean(axis=1)

    # A camera before and above; each pixel interpolates the light of its triangle's corners.
    eye, target = np.array([2.6, -3.2, 2.6]), np.array([0, 0, 0.3])
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    world_to_camera = np.eye(4)
    world_to_camera[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    world_to_camera[:3, 3] = -world_to_camera[:3, :3] @ eye
    intrinsics = [[900, 0, 400], [0, 900, 300], [0, 0, 1]]
    hits = mesh.cast(rs.rays.pinhole(intrinsics, world_to_camera, 800, 600), want="primitive uv")
    weights = np.concatenate([1 - hits.uv.sum(axis=-1, keepdims=True), hits.uv], axis=-1)
    picture = np.where(hits.hit, (light[faces[hits.primitive]] * weights).sum(axis=-1), 1.0)

    import matplotlib.pyplot as plt

    plt.imsave(arguments.output, picture, cmap="gray", vmin=0, vmax=1)
    print(arguments.output)


if __name__ == "__main__":
    main()
