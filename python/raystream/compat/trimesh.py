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
from trimesh import caching, util

from .. import Mesh
from ._parity import contains, signed_distance as _signed_distance

__all__ = ["ProximityQuery", "RayMeshIntersector", "closest_point", "install", "signed_distance"]


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
        if multiple_hits:
            hits = _built(self.mesh).all_hits(origins, directions, want="t primitive uv", max_hits=max_hits)
            index_ray, index_tri, uv = hits.ray, hits.primitive.astype(np.int64), hits.uv
        else:
            hits = _built(self.mesh).cast(origins, directions, want="t primitive uv")
            index_ray = np.flatnonzero(hits.primitive >= 0)
            index_tri, uv = hits.primitive[index_ray].astype(np.int64), hits.uv[index_ray]
        if not return_locations:
            return index_tri, index_ray
        return index_tri, index_ray, self._locations(origins[index_ray], directions[index_ray], index_tri, uv)

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
    """Nearest points of the surface, distances, triangles.

    Of triangles that share the nearest point, the one that faces the question point most, as trimesh answers.
    """
    points = _vectors(points, "points")
    hits = _built(mesh).nearest(points, want="distance position64 primitive")
    return hits.position64, hits.distance.astype(np.float64), hits.primitive.astype(np.int64)


def signed_distance(mesh, points):
    """Distances from the surface, **positive inside**, as trimesh has them."""
    return -_signed_distance(_built(mesh), _vectors(points, "points")).astype(np.float64)


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
