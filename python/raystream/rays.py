"""Rays of cameras and scanners, as `(.., 6)` float32 arrays: origins and directions side by side."""

import numpy as np

__all__ = ["lidar", "pinhole"]


def pinhole(intrinsics, world_to_camera, width, height, *, axes="opencv"):
    """The rays of a pinhole camera through the centres of its pixels, `(height, width, 6)`.

    **The centre of the first pixel is (0.5, 0.5)**: of column x and row y it is (x + 0.5, y + 0.5). `intrinsics` is
    `(3, 3)`, in pixels. `world_to_camera` is `(4, 4)`. **Axes of the camera**: "opencv" has x to the right, y down and
    looks along +z; "opengl" has x to the right, y up and looks along -z. **Directions have length 1 along the axis of
    view**, so that t is depth, not distance.

    >>> rays = pinhole([[50, 0, 50], [0, 50, 50], [0, 0, 1]], np.eye(4), 100, 100)
    >>> rays.shape, rays[0, 0, 3:].tolist()
    ((100, 100, 6), [-0.9900000095367432, -0.9900000095367432, 1.0])
    """
    if axes not in ("opencv", "opengl"):
        raise ValueError(f"axes is {axes!r}; it must be 'opencv' or 'opengl'")
    intrinsics = np.asarray(intrinsics, np.float64).reshape(3, 3)
    matrix = np.asarray(world_to_camera, np.float64).reshape(4, 4)
    rotation, translation = matrix[:3, :3], matrix[:3, 3]
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    pixels = np.stack([x, y, np.ones_like(x)], axis=-1)
    directions = pixels @ np.linalg.inv(intrinsics).T
    if axes == "opengl":
        directions *= [1.0, -1.0, -1.0]
    # Row vectors times the inverse of the rotation, transposed.
    inverse = np.linalg.inv(rotation)
    rays = np.empty((height, width, 6), np.float32)
    rays[..., :3] = -inverse @ translation
    rays[..., 3:] = directions @ inverse.T
    return rays


def lidar(elevations, azimuths, pose=None):
    """The rays of a spinning scanner, `(elevations, azimuths, 6)`, with directions of length 1, so that t is distance.

    Angles are in radians: an azimuth turns from +x towards +y, an elevation rises towards +z. `pose`, `(4, 4)`, moves
    the scanner to its place in the world.

    >>> rays = lidar([0.0], [0.0, np.pi / 2])
    >>> np.round(rays[0, :, 3:]).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    """
    elevations, azimuths = (np.asarray(angles, np.float64).reshape(-1) for angles in (elevations, azimuths))
    level = np.cos(elevations)[:, None]
    up = np.broadcast_to(np.sin(elevations)[:, None], (len(elevations), len(azimuths)))
    directions = np.stack([level * np.cos(azimuths), level * np.sin(azimuths), up], axis=-1)
    pose = np.eye(4) if pose is None else np.asarray(pose, np.float64).reshape(4, 4)
    rays = np.empty((*directions.shape[:2], 6), np.float32)
    rays[..., :3] = pose[:3, 3]
    rays[..., 3:] = directions @ pose[:3, :3].T
    return rays
