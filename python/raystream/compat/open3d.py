"""raystream behind Open3D: `RaycastingScene`.

Answers are Open3D's tensors where Open3D has been imported, else arrays of NumPy.

>>> import numpy as np
>>> from raystream.compat.open3d import RaycastingScene
>>> scene = RaycastingScene()
>>> scene.add_triangles(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32), np.array([[0, 1, 2]], np.uint32))
0
>>> float(scene.cast_rays(np.array([[0.2, 0.2, 1, 0, 0, -1]], np.float32))["t_hit"][0])
1.0
"""

import sys

import numpy as np

from .. import Mesh
from .. import rays as _rays
from ._parity import contains, signed_distance

__all__ = ["RaycastingScene", "install"]


def _array(value, kind=np.float32):
    value = value.cpu().numpy() if hasattr(value, "cpu") else value
    return np.ascontiguousarray(value, kind)


def _answer(array):
    open3d = sys.modules.get("open3d")
    return array if open3d is None else open3d.core.Tensor.from_numpy(np.ascontiguousarray(array))


def _threads(nthreads):
    return nthreads if nthreads > 0 else None


class RaycastingScene:
    """Queries with the interface of `open3d.t.geometry.RaycastingScene`."""

    #: The id of a miss.
    INVALID_ID = 4294967295

    def __init__(self, nthreads=0, device=None):
        self._parts, self._built = [], None
        self._threads = _threads(nthreads)

    def add_triangles(self, vertex_positions, triangle_indices=None):
        """Adds a mesh, or vertices and triangles. Returns the number of the geometry."""
        if triangle_indices is None:
            mesh = vertex_positions
            vertex_positions, triangle_indices = mesh.vertex.positions, mesh.triangle.indices
        self._parts.append((_array(vertex_positions), _array(triangle_indices, np.int64)))
        self._built = None
        return len(self._parts) - 1

    def _mesh(self):
        if self._built is None:
            vertices = [vertices for vertices, _ in self._parts] or [np.zeros((0, 3), np.float32)]
            faces = [faces for _, faces in self._parts] or [np.zeros((0, 3), np.int64)]
            firsts = np.cumsum([0] + [len(part) for part in vertices])
            of_scene = np.concatenate([part + first for part, first in zip(faces, firsts)])
            self._built = Mesh(np.concatenate(vertices), of_scene)
            self._firsts = np.cumsum([0] + [len(part) for part in faces])
        return self._built

    def _ids(self, primitive):
        """Geometries, and triangles in them."""
        miss = primitive < 0
        if len(self._parts) == 1:
            return np.where(miss, self.INVALID_ID, 0).astype(np.uint32), primitive.view(np.uint32)
        geometry = np.searchsorted(self._firsts, primitive, side="right") - 1
        local = primitive - self._firsts[geometry]
        return tuple(np.where(miss, self.INVALID_ID, ids).astype(np.uint32) for ids in (geometry, local))

    def _hits(self, hits):
        geometry, primitive = self._ids(hits.primitive)
        return {"t_hit": hits.t, "geometry_ids": geometry, "primitive_ids": primitive, "primitive_uvs": hits.uv}

    def _normals(self, primitive):
        """Unit normals of triangles, 0 for none."""
        faces, vertices = self._built.faces, self._built.vertices.astype(np.float64)
        if len(faces) == 0:
            return np.zeros((*primitive.shape, 3), np.float32)
        a, b, c = (vertices[faces[primitive, corner]] for corner in range(3))
        normals = np.cross(b - a, c - a)
        lengths = np.linalg.norm(normals, axis=-1, keepdims=True)
        return np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0).astype(np.float32)

    def cast_rays(self, rays, nthreads=0):
        """First hits."""
        hits = self._mesh().cast(_array(rays), want="t primitive uv normal", threads=_threads(nthreads))
        columns = {**self._hits(hits), "primitive_normals": hits.normal}
        return {name: _answer(column) for name, column in columns.items()}

    def test_occlusions(self, rays, tnear=0.0, tfar=float("inf"), nthreads=0):
        """For each ray, True if it hits anything between two distances."""
        threads = _threads(nthreads)
        return _answer(self._mesh().occluded(_array(rays), t_min=tnear, t_max=tfar, threads=threads))

    def count_intersections(self, rays, nthreads=0):
        """The number of hits of each ray."""
        return _answer(self._mesh().count(_array(rays), threads=_threads(nthreads)))

    def list_intersections(self, rays, nthreads=0):
        """All hits."""
        hits = self._mesh().all_hits(_array(rays), want="t primitive uv", threads=_threads(nthreads))
        columns = {"ray_splits": hits.offsets, "ray_ids": hits.ray, **self._hits(hits)}
        return {name: _answer(column) for name, column in columns.items()}

    def compute_closest_points(self, query_points, nthreads=0):
        """Nearest points of the surfaces."""
        points, threads = _array(query_points), _threads(nthreads)
        near = self._mesh().nearest(points, want="position primitive uv", threads=threads)
        geometry, primitive = self._ids(near.primitive)
        columns = {
            "points": near.position,
            "geometry_ids": geometry,
            "primitive_ids": primitive,
            "primitive_uvs": near.uv,
            "primitive_normals": self._normals(near.primitive),
        }
        return {name: _answer(column) for name, column in columns.items()}

    def compute_distance(self, query_points, nthreads=0):
        """Distances from the surface."""
        return _answer(self._mesh().distance(_array(query_points), threads=_threads(nthreads)))

    def compute_signed_distance(self, query_points, nthreads=0, nsamples=1):
        """Distances from the surface, negative inside. One exact ray decides: `nsamples` is of no use."""
        _check_samples(nsamples)
        return _answer(signed_distance(self._mesh(), _array(query_points), _threads(nthreads)))

    def compute_occupancy(self, query_points, nthreads=0, nsamples=1):
        """1 for points inside, 0 for others. One exact ray decides: `nsamples` is of no use."""
        _check_samples(nsamples)
        return _answer(contains(self._mesh(), _array(query_points), _threads(nthreads)).astype(np.float32))

    @staticmethod
    def create_rays_pinhole(
        intrinsic_matrix=None,
        extrinsic_matrix=None,
        width_px=None,
        height_px=None,
        *others,
        fov_deg=None,
        center=None,
        eye=None,
        up=None,
    ):
        """Rays of a pinhole camera: of its matrices, or of its field of view, target, place and up vector."""
        if others:
            fov_deg, center, eye, up = intrinsic_matrix, extrinsic_matrix, width_px, height_px
            width_px, height_px = others
        if fov_deg is not None:
            intrinsic_matrix, extrinsic_matrix = _look_at(fov_deg, center, eye, up, width_px, height_px)
        matrices = _array(intrinsic_matrix, np.float64), _array(extrinsic_matrix, np.float64)
        return _answer(_rays.pinhole(*matrices, width_px, height_px))


def _check_samples(nsamples):
    if nsamples % 2 != 1:
        raise RuntimeError(f"nsamples must be odd but is {nsamples}")


def _look_at(fov_deg, center, eye, up, width, height):
    center, eye, up = (_array(vector, np.float64) for vector in (center, eye, up))
    focal = 0.5 * width / np.tan(np.radians(0.5 * fov_deg))
    intrinsic = np.array([[focal, 0, 0.5 * width], [0, focal, 0.5 * height], [0, 0, 1]])
    forward = (center - eye) / np.linalg.norm(center - eye)
    right = np.cross(up, forward)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    extrinsic = np.eye(4)
    extrinsic[:3, :3], extrinsic[:3, 3] = rotation, -rotation @ eye
    return intrinsic, extrinsic


def install():
    """Puts `RaycastingScene` in the place of Open3D's. Imports Open3D."""
    import open3d

    open3d.t.geometry.RaycastingScene = RaycastingScene
