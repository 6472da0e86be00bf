"""raystream behind `embreex`: the modules `rtcore`, `rtcore_scene` and `mesh_construction`.

>>> import raystream.compat.embreex
>>> raystream.compat.embreex.install()
>>> from embreex.rtcore_scene import EmbreeScene
>>> from embreex.mesh_construction import TriangleMesh
>>> import numpy as np
>>> scene = EmbreeScene()
>>> mesh = TriangleMesh(scene, np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], np.float32))
>>> scene.run(np.array([[0.2, 0.2, 1]], np.float32), np.array([[0, 0, -1]], np.float32))
array([0], dtype=int32)
"""

import sys
import types

import numpy as np

from .. import Mesh, __version__

__all__ = ["ElementMesh", "EmbreeDevice", "EmbreeScene", "TriangleMesh", "install"]

#: The value of `tfar` for a miss.
FAR = np.float32(1e37)

# Triangles of a tetrahedron and of a hexahedron (two a face), numbered as embreex numbers them, seen counterclockwise
# from outside.
_TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
_HEXAHEDRON = np.array(
    [
        [0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7], [0, 1, 5], [0, 5, 4],
        [1, 2, 6], [1, 6, 5], [0, 7, 3], [0, 4, 7], [3, 6, 2], [3, 7, 6],
    ]
)  # fmt: skip


class EmbreeDevice:
    """A device; there is but one."""

    def __repr__(self):
        return f"raystream {__version__}"


class EmbreeScene:
    """Meshes that are asked together."""

    def __init__(self, device=None, robust=True):
        self.device = EmbreeDevice() if device is None else device
        self._parts, self._mesh = [], None

    def _add(self, vertices, faces):
        if self._mesh is not None:
            raise RuntimeError("the scene has been traced: meshes are added before the first run")
        self._parts.append((np.asarray(vertices, np.float32), np.asarray(faces, np.int64)))
        return len(self._parts) - 1

    def _commit(self):
        if self._mesh is None:
            vertices = [vertices for vertices, _ in self._parts] or [np.zeros((0, 3), np.float32)]
            faces = [faces for _, faces in self._parts] or [np.zeros((0, 3), np.int64)]
            firsts = np.cumsum([0] + [len(part) for part in vertices])
            faces_of_scene = np.concatenate([part + first for part, first in zip(faces, firsts)])
            self._mesh = Mesh(np.concatenate(vertices), faces_of_scene)
            self._firsts = np.cumsum([0] + [len(part) for part in faces])
        return self._mesh

    def _normals(self, primitive):
        """Normals as long as twice the triangles' areas, 0 for misses."""
        faces = self._mesh.faces
        if len(faces) == 0:
            return np.zeros((len(primitive), 3), np.float32)
        a, b, c = (self._mesh.vertices[faces[primitive, corner]] for corner in range(3))
        return np.where(primitive[:, None] < 0, np.float32(0), np.cross(b - a, c - a))

    def run(self, vec_origins, vec_directions, dists=None, query="INTERSECT", output=None):
        """Traces rays: primitives of first hits; with `output`, a dictionary of all that is known of them."""
        if query not in ("INTERSECT", "OCCLUDED", "DISTANCE"):
            raise ValueError(
                f"Embree ray query type {query} not recognized.\nAccepted types are (INTERSECT,OCCLUDED,DISTANCE)"
            )
        mesh = self._commit()
        origins = np.asarray(vec_origins, np.float32)
        directions = np.broadcast_to(np.asarray(vec_directions, np.float32), origins.shape)
        far = FAR if dists is None else dists
        if query == "OCCLUDED" and not output:
            return np.where(mesh.occluded(origins, directions, t_max=far), 0, -1).astype(np.int32)
        hits = mesh.cast(origins, directions, t_max=far, want="t primitive uv" if output else "t primitive")
        miss = hits.primitive < 0
        geometry = np.searchsorted(self._firsts, hits.primitive, side="right") - 1
        primitive = np.where(miss, -1, hits.primitive - self._firsts[geometry]).astype(np.int32)
        distance = np.where(miss, far, hits.t).astype(np.float32)
        if output:
            return {
                "u": hits.uv[:, 0].copy(),
                "v": hits.uv[:, 1].copy(),
                "Ng": self._normals(hits.primitive),
                "tfar": distance,
                "primID": primitive,
                "geomID": np.where(miss, -1, geometry).astype(np.int32),
            }
        return distance if query == "DISTANCE" else primitive


class TriangleMesh:
    """Adds triangles to a scene: `(f, 3, 3)` corners, or `(v, 3)` vertices and `(f, 3)` indices."""

    def __init__(self, scene, vertices, indices=None):
        if indices is None:
            vertices = np.asarray(vertices, np.float32).reshape(-1, 3)
            indices = np.arange(len(vertices)).reshape(-1, 3)
        self.mesh = scene._add(vertices, indices)


class ElementMesh(TriangleMesh):
    """Adds the faces of tetrahedra, `(e, 4)`, or hexahedra, `(e, 8)`, to a scene."""

    def __init__(self, scene, vertices, indices):
        indices = np.asarray(indices, np.int64)
        tables = {4: _TETRAHEDRON, 8: _HEXAHEDRON}
        if indices.shape[1] not in tables:
            raise NotImplementedError
        super().__init__(scene, vertices, indices[:, tables[indices.shape[1]]].reshape(-1, 3))


def install():
    """Makes `import embreex` find raystream, whether embreex is installed or not."""
    package = types.ModuleType("embreex")
    package.__path__, package.__version__ = [], "4.4.0"
    contents = {
        "rtcore": {"EmbreeDevice": EmbreeDevice},
        "rtcore_scene": {"EmbreeScene": EmbreeScene},
        "mesh_construction": {"TriangleMesh": TriangleMesh, "ElementMesh": ElementMesh},
    }
    sys.modules["embreex"] = package
    for name, members in contents.items():
        module = types.ModuleType(f"embreex.{name}")
        vars(module).update(members)
        sys.modules[module.__name__] = module
        setattr(package, name, module)
