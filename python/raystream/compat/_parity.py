"""Inside and outside for meshes of any kind, as other libraries answer."""

import warnings

_warned = False


def _allow_open(mesh):
    """True if edges of the mesh are open; the first time that is so, a warning says it."""
    global _warned
    if mesh.is_closed:
        return False
    if not _warned:
        _warned = True
        message = f"a mesh has {mesh.open_edges} open edges: inside is where a ray crosses it an odd number of times"
        warnings.warn(message, stacklevel=4)
    return True


def contains(mesh, points, threads=None):
    """For each point, True if it is inside."""
    return mesh.contains(points, allow_open=_allow_open(mesh), threads=threads)


def signed_distance(mesh, points, threads=None):
    """Distances from the surface, negative inside."""
    return mesh.signed_distance(points, allow_open=_allow_open(mesh), threads=threads)
