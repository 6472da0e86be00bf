"""MuJoCo as a contender of race_python_peers.py: instances of a mesh are geoms of bodies that the caller moves."""

import mujoco
import numpy as np


def poses(transforms):
    """Positions and quaternions of matrices, as MuJoCo takes them."""
    quaternions = np.empty((len(transforms), 4))
    for quaternion, transform in zip(quaternions, transforms):
        mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(transform[:3, :3]).ravel())
    return transforms[:, :3, 3].copy(), quaternions


class World:
    """Instances of a mesh, and the rays of one scanner in shares, one for each thread."""

    def __init__(self, vertices, faces, count, rays, pool, threads):
        spec = mujoco.MjSpec()
        spec.add_mesh(name="mesh", uservert=np.float64(vertices).ravel(), userface=np.int32(faces).ravel())
        for _ in range(count):
            spec.worldbody.add_body(mocap=True).add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="mesh")
        self.model, self.pool = spec.compile(), pool
        self.origin = np.float64(rays[0, :3])
        # Calls at once must not share data: each share of the rays has its own, and moves its geoms itself.
        self.shares = []
        for share in np.array_split(rays, threads):
            directions = np.float64(share[:, 3:]).ravel()
            answers = np.empty(len(share), np.int32), np.empty(len(share))
            self.shares.append((mujoco.MjData(self.model), directions, *answers))

    def cast(self, pose):
        """Distances of the first hits once the geoms are where `pose` says; -1 for none."""
        if len(self.shares) == 1:
            return self.cast_share(self.shares[0], pose)
        return np.concatenate(list(self.pool.map(lambda share: self.cast_share(share, pose), self.shares)))

    def cast_share(self, share, pose):
        data, directions, geoms, distances = share
        data.mocap_pos, data.mocap_quat = pose
        # The part of a step that places geoms, and no more.
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_multiRay(
            self.model, data, self.origin, directions, None, True, -1, geoms, distances, None, len(distances),
            mujoco.mjMAXVAL,
        )
        return distances
