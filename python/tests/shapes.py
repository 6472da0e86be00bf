"""Meshes and rays that several tests ask."""

import numpy as np

# Corners of a cube, and its faces, seen counterclockwise from outside.
CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)
FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip


def icosphere(subdivisions):
    """Vertices and faces of a sphere of radius 1 about the origin."""
    golden = (1 + 5**0.5) / 2
    vertices = [[-1, golden, 0], [1, golden, 0], [-1, -golden, 0], [1, -golden, 0]]
    vertices += [[vertex[2], vertex[0], vertex[1]] for vertex in vertices[:4]]
    vertices += [[vertex[1], vertex[2], vertex[0]] for vertex in vertices[:4]]
    vertices = np.array(vertices, np.float64)
    corners = np.array(vertices)
    # All triples of corners at the distance of an edge.
    near = np.linalg.norm(corners[:, None] - corners[None], axis=-1) < 2.1
    triples = [[a, b, c] for a in range(12) for b in range(a) for c in range(b)]
    faces = np.array([[a, b, c] for a, b, c in triples if near[a, b] and near[b, c] and near[a, c]])
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0
    faces[inward] = faces[inward][:, ::-1]
    for _ in range(subdivisions):
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        unique, index = np.unique(edges, axis=0, return_inverse=True)
        middles = len(vertices) + index.reshape(-1, 3)
        vertices = np.concatenate([vertices, vertices[unique].mean(axis=1)])
        a, b, c, ab, bc, ca = *faces.T, *middles.T
        faces = np.concatenate([np.stack(f, axis=1) for f in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])
        vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
    return (vertices / np.linalg.norm(vertices, axis=1, keepdims=True)).astype(np.float32), faces


def rays(count, seed=0, spread=2.0):
    """Rays from around the origin in all directions, `(count, 6)`."""
    return (np.random.default_rng(seed).normal(size=(count, 6)) * spread).astype(np.float32)
