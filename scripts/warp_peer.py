"""Warp on the CPU, as a contender of race_python_peers.py: one thread, one ray or point at a time."""

import numpy as np
import warp as wp

wp.config.quiet = True
wp.init()


@wp.kernel
def first_hits(mesh: wp.uint64, rays: wp.array2d(dtype=float), t: wp.array(dtype=float), face: wp.array(dtype=int)):
    i = wp.tid()
    origin = wp.vec3(rays[i, 0], rays[i, 1], rays[i, 2])
    direction = wp.vec3(rays[i, 3], rays[i, 4], rays[i, 5])
    hit = wp.mesh_query_ray(mesh, origin, direction, 1.0e20)
    if hit.result:
        t[i] = hit.t
        face[i] = hit.face
    else:
        t[i] = wp.inf
        face[i] = -1


@wp.kernel
def nearest_points(mesh: wp.uint64, points: wp.array(dtype=wp.vec3), distance: wp.array(dtype=float)):
    i = wp.tid()
    found = wp.mesh_query_point_no_sign(mesh, points[i], 1.0e20)
    distance[i] = wp.length(points[i] - wp.mesh_eval_position(mesh, found.face, found.u, found.v))


@wp.kernel
def moved(
    points: wp.array(dtype=wp.vec3),
    transforms: wp.array(dtype=wp.mat44),
    count: int,
    out: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    out[i] = wp.transform_point(transforms[i // count], points[i % count])


def mesh_of(vertices, faces):
    """A mesh with its tree."""
    corners = wp.array(np.float32(vertices), dtype=wp.vec3, device="cpu")
    return wp.Mesh(corners, wp.array(np.int32(faces).ravel(), dtype=int, device="cpu"))


class Queries:
    """Questions about one mesh; answers are arrays that the calls share."""

    def __init__(self, vertices, faces):
        self.mesh = mesh_of(vertices, faces)

    def cast(self, rays):
        rays = wp.array(rays, dtype=float, ndim=2, device="cpu", copy=False)
        t, face = (wp.empty(len(rays), dtype=kind, device="cpu") for kind in (float, int))
        wp.launch(first_hits, dim=len(rays), inputs=[self.mesh.id, rays, t, face], device="cpu")
        return t.numpy()

    def nearest(self, points):
        points = wp.array(points, dtype=wp.vec3, device="cpu", copy=False)
        distance = wp.empty(len(points), dtype=float, device="cpu")
        wp.launch(nearest_points, dim=len(points), inputs=[self.mesh.id, points, distance], device="cpu")
        return distance.numpy()


class World:
    """Instances of a mesh as one mesh, whose vertices are moved and whose tree is refitted or built again."""

    def __init__(self, vertices, faces, transforms, rebuilds):
        self.points = wp.array(np.float32(vertices), dtype=wp.vec3, device="cpu")
        count, offsets = len(transforms), len(vertices) * np.arange(len(transforms))[:, None, None]
        self.mesh = mesh_of(np.tile(vertices, (count, 1)), (np.asarray(faces)[None] + offsets).reshape(-1, 3))
        # Where the instances are at first.
        self.rebuilds = True
        self.move(transforms)
        self.rebuilds = rebuilds

    def move(self, transforms):
        matrices = wp.array(np.float32(transforms), dtype=wp.mat44, device="cpu")
        count = len(self.points)
        inputs = [self.points, matrices, count, self.mesh.points]
        wp.launch(moved, dim=len(self.mesh.points), inputs=inputs, device="cpu")
        if self.rebuilds:
            self.mesh = wp.Mesh(self.mesh.points, self.mesh.indices)
        else:
            self.mesh.refit()

    cast = Queries.cast
