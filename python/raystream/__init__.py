"""Ray queries on triangle meshes: first hits, occlusion, all hits, counts, nearest points, distances; and pictures.

>>> import numpy as np
>>> import raystream as rs
>>> mesh = rs.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
>>> rays = np.array([[0.25, 0.5, 2, 0, 0, -1], [5, 5, 2, 0, 0, -1]], np.float32)
>>> mesh.cast(rays).t
array([ 2., inf], dtype=float32)
>>> rs.render(mesh, size=(32, 24), spp=4)
Picture(32x24)
"""

from . import rays
from ._raystream import (
    Hits,
    Material,
    Mesh,
    Picture,
    Queries,
    Rendering,
    Scene,
    Texture,
    World,
    __version__,
    info,
    load,
    open,
    render,
    simd,
)

# Without `open`: `from raystream import *` leaves the built-in one.
__all__ = [
    "Hits",
    "Material",
    "Mesh",
    "Picture",
    "Queries",
    "Rendering",
    "Scene",
    "Texture",
    "World",
    "__version__",
    "info",
    "load",
    "rays",
    "render",
    "simd",
]
