"""Meshes for the examples."""

import numpy as np


def torus(large=1.0, small=0.4, around=96, across=48):
    """Vertices and faces of a torus about the z axis."""
    u, v = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    a, b = u * 2 * np.pi / around, v * 2 * np.pi / across
    ring = large + small * np.cos(b)
    vertices = np.stack([ring * np.cos(a), ring * np.sin(a), small * np.sin(b)], axis=-1).reshape(-1, 3)
    corner = lambda i, j: (i % around) * across + j % across  # noqa: E731
    quad = [corner(u, v), corner(u + 1, v), corner(u + 1, v + 1), corner(u, v + 1)]
    first, second = np.stack(quad[:3], axis=-1), np.stack([quad[0], quad[2], quad[3]], axis=-1)
    return vertices.astype(np.float32), np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)])


def box(low, high):
    """Vertices and faces of a box."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)
    faces = [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]  # fmt: skip
    low, high = np.asarray(low, np.float32), np.asarray(high, np.float32)
    return low + corners * (high - low), np.array(faces)


def vertex_normals(vertices, faces):
    """Normals of vertices: those of their faces, by area."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    of_faces, normals = np.cross(b - a, c - a), np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], of_faces)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
