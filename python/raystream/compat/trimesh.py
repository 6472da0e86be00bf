"""raystream behind `trimesh`: `mesh.ray`, `mesh.contains`, `trimesh.proximity`.

>>> import raystream.compat.trimesh
>>> raystream.compat.trimesh.install()  # doctest: +SKIP
>>> trimesh.creation.box().contains([[0, 0, 0]])  # doctest: +SKIP
array([ True])
"""

import sys
import types

import numpy as np
import trimesh as _trimesh
from trimesh import util
from trimesh.constants import tol
from trimesh.triangles import closest_point as _on_triangles

from .. import Mesh
from ._parity import contains

__all__ = ["ProximityQuery", "RayMeshIntersector", "closest_point", "install", "signed_distance"]


#: Four times the rounding of a coordinate to float32, as a share of the mesh's size.
_ROUNDING = 4 * 2.0**-24


def _built(mesh):
    """The mesh of raystream, kept with the trimesh until that changes."""
    cache = mesh._cache
    cache.verify()
    if "raystream" not in cache.cache:
        cache.cache["raystream"] = Mesh(np.asarray(mesh.vertices, np.float64), mesh.faces.view(np.ndarray))
    return cache.cache["raystream"]


def _vectors(values, name):
    values = np.asanyarray(values, dtype=np.float64)
    if not util.is_shape(values, (-1, 3)):
        raise ValueError(f"{name} must be (n,3)!")
    return values


class RayMeshIntersector:
    """Ray queries with the interface of trimesh's intersectors.

    All hits are counted by the half-open rule, so that a ray through an edge or a vertex has the right number of them;
    first hits by the closed one, so that no ray slips through.
    """

    def __init__(self, geometry=None, scale_to_box=True, *, mesh=None):
        self.mesh = mesh if geometry is None else geometry
        # Accepted for its interface: positions in float64 need no scaling.
        self._scale_to_box = scale_to_box

    def _rays(self, origins, directions):
        origins, directions = np.array(origins, np.float64), np.array(directions, np.float64)
        if origins.shape != directions.shape:
            raise ValueError("Ray origin and direction don't match!")
        return origins.reshape(-1, 3), directions.reshape(-1, 3)

    def intersects_id(
        self,
        ray_origins,
        ray_directions,
        multiple_hits=True,
        max_hits=None,
        return_locations=False,
        **kwargs,
    ):
        """Triangles and rays of all hits, or of the first; with `return_locations` their points, too."""
        origins, directions = self._rays(ray_origins, ray_directions)
        # Hits at the very origin count, wherever the rounding of the mesh to float32 has moved them.
        lengths = np.linalg.norm(directions, axis=1, keepdims=True)
        back = np.divide(directions, lengths, out=np.zeros_like(directions), where=lengths > 0)
        given, origins = origins, origins - self.mesh.scale * _ROUNDING * back
        if multiple_hits:
            hits = _built(self.mesh).all_hits(origins, directions, want="t primitive uv", max_hits=max_hits)
            index_ray, index_tri, uv = hits.ray, hits.primitive.astype(np.int64), hits.uv
        else:
            hits = _built(self.mesh).cast(origins, directions, want="t primitive uv")
            index_ray = np.flatnonzero(hits.primitive >= 0)
            index_tri, uv = hits.primitive[index_ray].astype(np.int64), hits.uv[index_ray]
        if not return_locations:
            return index_tri, index_ray
        return index_tri, index_ray, self._locations(given[index_ray], directions[index_ray], index_tri, uv)

    def _locations(self, origins, directions, index_tri, uv):
        """Where rays meet the planes of triangles, in float64; beside steep edges, where their weights say."""
        corners = self.mesh.triangles.view(np.ndarray)[index_tri]
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        u, v = uv[:, :1].astype(np.float64), uv[:, 1:].astype(np.float64)
        by_weights = a + u * (b - a) + v * (c - a)
        normals = np.cross(b - a, c - a)
        slope = util.diagonal_dot(normals, directions)
        lengths = np.linalg.norm(normals, axis=1) * np.linalg.norm(directions, axis=1)
        steep = np.abs(slope) > 1e-3 * lengths
        t = util.diagonal_dot(normals, a - origins)
        np.divide(t, slope, out=t, where=steep)
        return np.where(steep[:, None], origins + t[:, None] * directions, by_weights)

    def intersects_location(self, ray_origins, ray_directions, multiple_hits=True, **kwargs):
        """Points, rays and triangles of hits."""
        index_tri, index_ray, locations = self.intersects_id(
            ray_origins, ray_directions, multiple_hits=multiple_hits, return_locations=True, **kwargs
        )
        return locations, index_ray, index_tri

    def intersects_first(self, ray_origins, ray_directions, **kwargs):
        """The first triangle of each ray, -1 for a miss."""
        origins, directions = self._rays(ray_origins, ray_directions)
        return _built(self.mesh).cast(origins, directions, want="primitive").primitive.astype(np.int64)

    def intersects_any(self, ray_origins, ray_directions, **kwargs):
        """For each ray, True if it hits anything."""
        return _built(self.mesh).occluded(*self._rays(ray_origins, ray_directions))

    def contains_points(self, points):
        """For each point, True if it is inside or on the surface."""
        return contains(_built(self.mesh), _vectors(points, "points"))

    def __copy__(self, *args):
        return RayMeshIntersector(self.mesh, self._scale_to_box)

    def __deepcopy__(self, *args):
        return self.__copy__()


def closest_point(mesh, points):
    """Nearest points of the surface, distances, triangles: in float64, of the mesh's own vertices.

    Of triangles that share a nearest point, the one that faces the point most is named, as trimesh does it.
    """
    points = _vectors(points, "points")
    hits = _built(mesh).nearest(points, want="primitive uv")
    index_tri = hits.primitive.astype(np.int64)
    triangles = mesh.triangles.view(np.ndarray)
    closest = _on_triangles(triangles[index_tri], points)
    distance = np.linalg.norm(points - closest, axis=1)
    weights = np.column_stack([1 - hits.uv.astype(np.float64).sum(axis=1), hits.uv])
    shared = np.flatnonzero((weights.min(axis=1) < 1e-5) & (distance**2 > tol.merge))
    if len(shared):
        corner = weights[shared].argmax(axis=1)
        vertices = mesh.faces.view(np.ndarray)[index_tri[shared], corner]
        index_tri[shared] = _facing(mesh, points[shared], closest[shared], vertices)
    return closest, distance, index_tri


def _facing(mesh, points, closest, vertices):
    """Of the triangles at some vertices that have the nearest points, those that face the points most."""
    candidates = mesh.vertex_faces[vertices]
    rows, columns = np.nonzero(candidates >= 0)
    faces = candidates[rows, columns]
    away = points - closest
    squared = util.diagonal_dot(away, away)
    others = points[rows] - _on_triangles(mesh.triangles.view(np.ndarray)[faces], points[rows])
    facing = util.diagonal_dot(mesh.face_normals[faces], away[rows]) / np.sqrt(squared[rows])
    facing[np.abs(util.diagonal_dot(others, others) - squared[rows]) > tol.merge] = -np.inf
    table = np.full(candidates.shape, -np.inf)
    table[rows, columns] = facing
    return candidates[np.arange(len(points)), table.argmax(axis=1)]


def signed_distance(mesh, points):
    """Distances from the surface in float64, **positive inside**, as trimesh has them."""
    points = _vectors(points, "points")
    distance = closest_point(mesh, points)[1]
    return np.where(contains(_built(mesh), points) | (distance < tol.merge), distance, -distance)


class ProximityQuery(_trimesh.proximity.ProximityQuery):
    """trimesh's class with raystream's answers."""

    def on_surface(self, points):
        return closest_point(self._mesh, points)

    def signed_distance(self, points):
        return signed_distance(self._mesh, points)


def install():
    """Puts raystream in the place of both ray engines of trimesh and of its proximity queries.

    Meshes that exist already keep the engine in their attribute `ray`.
    """
    ray = _trimesh.ray
    engine = ray.ray_pyembree if ray.has_embree else types.ModuleType("trimesh.ray.ray_pyembree")
    engine.RayMeshIntersector = RayMeshIntersector
    sys.modules["trimesh.ray.ray_pyembree"] = engine
    ray.ray_pyembree, ray.has_embree = engine, True
    ray.ray_triangle.RayMeshIntersector = RayMeshIntersector
    ray.ray_util.contains_points = lambda intersector, points, check_direction=None: intersector.contains_points(points)
    proximity = _trimesh.proximity
    proximity.closest_point, proximity.signed_distance = closest_point, signed_distance
    proximity.ProximityQuery = ProximityQuery
