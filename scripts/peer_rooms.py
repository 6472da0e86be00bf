"""Two rooms for `compare_peers.py`, of large polygons and few small things, made here.

Each is a list of parts ((points, faces), material) as in `agree_with_mitsuba.SCENES`, an eye, a target, and a field of
view in degrees.
"""

import numpy as np

from agree_with_mitsuba import quad, sphere

TILE, PLASTER, WOOD = (0.7, 0.75, 0.75), (0.8, 0.78, 0.74), (0.4, 0.26, 0.14)


def box(low, high):
    """A box between two corners, its fronts outside."""
    low, high = np.array(low, float), np.array(high, float)
    x, y, z = np.diag(high - low)
    sides = [(low, y, x), (low, x, z), (low, z, y), (high, -x, -y), (high, -z, -x), (high, -y, -z)]
    return joined(quad(corner, u, v) for corner, u, v in sides)


def joined(parts):
    """One mesh of several."""
    points, faces, count = [], [], 0
    for some, triangles in parts:
        points.append(some)
        faces.append(triangles + count)
        count += len(some)
    return np.concatenate(points), np.concatenate(faces)


def hull(low, high):
    """The six walls of a room, their fronts inside: floor, ceiling, and four walls."""
    low, high = np.array(low, float), np.array(high, float)
    x, y, z = np.diag(high - low)
    floor, ceiling = quad(low, z, x), quad(high, -x, -z)
    walls = joined([quad(low, x, y), quad(low, y, z), quad(high, -y, -x), quad(high, -z, -y)])
    return floor, ceiling, walls


def fitting(low, high):
    """Four black sides from a lamp to the ceiling: some programs' lamps shine from their backs as well."""
    low, high = np.array(low, float), np.array(high, float)
    x, y, z = np.diag(high - low)
    return joined([quad(low, y, x), quad(low, z, y), quad(high, -x, -y), quad(high, -y, -z)])


def bathroom():
    """A closed room of tiles: one wall is a mirror, the lamp is small, and there is enamel, steel and glass."""
    floor, ceiling, walls = hull((-1.5, 0, -2), (1.5, 2.4, 2))
    rims = [((-1.5, 0.55, -2), (-1.4, 0.6, -0.2)), ((-0.9, 0.55, -2), (-0.8, 0.6, -0.2))]
    tub = [((-1.5, 0, -2), (-0.8, 0.55, -0.2)), *rims]
    basin = [((0.5, 0.75, -2), (1.3, 0.9, -1.5)), ((0.85, 0, -1.9), (0.95, 0.75, -1.8))]
    parts = [
        (floor, {"matte": (0.35, 0.35, 0.4)}),
        (ceiling, {"matte": PLASTER}),
        (walls, {"gloss": TILE, "roughness": 0.4}),
        (quad((-0.6, 1.0, -1.99), (2.0, 0, 0), (0, 1.2, 0)), {"mirror": (0.9, 0.9, 0.9)}),
        (quad((-0.25, 2.39, -0.25), (0.5, 0, 0), (0, 0, 0.5)), {"matte": (0, 0, 0), "lamp": (30, 27, 22)}),
        (fitting((-0.25, 2.39, -0.25), (0.25, 2.4, 0.25)), {"matte": (0, 0, 0)}),
        (joined(box(*corners) for corners in tub), {"coat": (0.85, 0.85, 0.85), "roughness": 0.6}),
        (joined(box(*corners) for corners in basin), {"coat": (0.85, 0.85, 0.85), "roughness": 0.6}),
        (sphere((1.1, 0.2, 0.6), 0.2, 4), {"metal": (0.8, 0.8, 0.8), "roughness": 0.3}),
        (sphere((0.7, 0.97, -1.75), 0.07, 4), {"glass": 1.5}),
        (box((-0.4, 0, 0.9), (0.3, 0.45, 1.4)), {"matte": WOOD}),
    ]
    return parts, (0.9, 1.5, 1.8), (-0.2, 0.9, -1.2), 62


def level():
    """A row of halls of large matte polygons, lit by a lamp in every second hall and through doorways."""
    parts, walls, pillars, lamps, fittings = [], [], [], [], []
    for hall in range(4):
        near, far = 6.0 - 6 * hall, -6 * hall
        floor, ceiling, _ = hull((-4, 0, far), (4, 3.5, near))
        parts += [(floor, {"matte": (0.45, 0.42, 0.4)}), (ceiling, {"matte": PLASTER})]
        walls += [quad((-4, 0, far), (0, 3.5, 0), (0, 0, 6)), quad((4, 0, near), (0, 3.5, 0), (0, 0, -6))]
        if hall < 3:  # A wall with a doorway.
            walls += [box((-4, 0, far - 0.1), (-0.8, 3.5, far)), box((0.8, 0, far - 0.1), (4, 3.5, far))]
            walls += [box((-0.8, 2.3, far - 0.1), (0.8, 3.5, far))]
        pillars += [box((x - 0.25, 0, far + 2.7), (x + 0.25, 3.5, far + 3.2)) for x in (-2.2, 2.2)]
        if hall % 2:
            lamps.append(quad((-0.8, 3.49, far + 2.2), (1.6, 0, 0), (0, 0, 1.6)))
            fittings.append(fitting((-0.8, 3.49, far + 2.2), (0.8, 3.5, far + 3.8)))
    walls += [quad((4, 0, 6), (-8, 0, 0), (0, 3.5, 0)), quad((-4, 0, -18), (8, 0, 0), (0, 3.5, 0))]
    parts += [
        (joined(walls), {"matte": (0.6, 0.5, 0.42)}),
        (joined(pillars), {"matte": (0.3, 0.4, 0.5)}),
        (joined(lamps), {"matte": (0, 0, 0), "lamp": (14, 13, 11)}),
        (joined(fittings), {"matte": (0, 0, 0)}),
    ]
    return parts, (0.5, 1.7, 5.2), (-0.3, 1.4, -4), 65
