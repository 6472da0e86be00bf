"""A lidar in a MuJoCo simulation: rings and boxes fall onto a height field; one group of geoms is not seen.

python python/examples/mujoco_lidar.py [--frames 20] [-o mujoco_lidar.png]    Needs mujoco and matplotlib.
"""

import argparse
import time

import mujoco
import numpy as np
import raystream as rs
from shapes import box, torus

# What the scanner sees; geoms of group 2 are invisible to it.
GROUPS = (0, 1)


def model_of(count):
    """Terrain (group 0), falling boxes and rings (group 1), a fence that the scanner does not see (group 2)."""
    spec, rng = mujoco.MjSpec(), np.random.default_rng(0)
    spec.option.timestep = 0.005
    side = np.linspace(-1, 1, 60)
    hills = 0.5 + 0.25 * np.sin(5 * side)[:, None] + 0.25 * np.cos(7 * side)[None, :]
    spec.add_hfield(name="hills", nrow=60, ncol=60, size=[20, 20, 3, 1], userdata=hills.ravel())
    vertices, faces = torus(0.8, 0.3)
    spec.add_mesh(name="ring", uservert=np.asarray(vertices).ravel(), userface=np.asarray(faces).ravel())
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname="hills", group=0)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[18, 0.1, 6], pos=[0, 8, 3], group=2)
    for index in range(count):
        body = spec.worldbody.add_body(pos=[*rng.uniform(-16, 16, 2), rng.uniform(4, 7)])
        body.quat = rng.normal(size=4)
        body.add_freejoint()
        if index % 2:
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.7, 0.5, 0.4], group=1)
        else:
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="ring", group=1)
    return spec.compile()


def mesh_of(model, geom):
    """The mesh of a geom in its own frame: of a box, a mesh or a height field."""
    kind, data, size = model.geom_type[geom], model.geom_dataid[geom], model.geom_size[geom]
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return rs.Mesh(*box(-size, size))
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        vertices = slice(model.mesh_vertadr[data], model.mesh_vertadr[data] + model.mesh_vertnum[data])
        faces = slice(model.mesh_faceadr[data], model.mesh_faceadr[data] + model.mesh_facenum[data])
        return rs.Mesh(model.mesh_vert[vertices], model.mesh_face[faces])
    if kind == mujoco.mjtGeom.mjGEOM_HFIELD:
        rows, columns = model.hfield_nrow[data], model.hfield_ncol[data]
        first, (x, y, z, _) = model.hfield_adr[data], model.hfield_size[data]
        heights = z * model.hfield_data[first : first + rows * columns].reshape(rows, columns)
        places = np.meshgrid(np.linspace(-x, x, columns), np.linspace(-y, y, rows))
        at = np.arange(rows * columns).reshape(rows, columns)
        a, b, c, d = at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]
        faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
        return rs.Mesh(np.stack([*places, heights], -1).reshape(-1, 3), faces)
    raise ValueError(f"geom {geom} is of a kind without a mesh here: {kind}")


def transforms_of(data, geoms):
    """Where geoms are, `(geoms, 4, 4)`."""
    transforms = np.tile(np.eye(4), (len(geoms), 1, 1))
    transforms[:, :3, :3] = data.geom_xmat[geoms].reshape(-1, 3, 3)
    transforms[:, :3, 3] = data.geom_xpos[geoms]
    return transforms


def world_of(model, data, groups):
    """The geoms of groups as a world, and the geom of each instance. Geoms of one mesh share it."""
    geoms, world, meshes = np.flatnonzero(np.isin(model.geom_group, groups)), rs.World(), {}
    for geom, transform in zip(geoms, transforms_of(data, geoms)):
        key = (model.geom_type[geom], model.geom_dataid[geom], *model.geom_size[geom])
        if key not in meshes:
            meshes[key] = mesh_of(model, geom)
        world.add(meshes[key], transform)
    return world, geoms


def mujoco_distances(model, data, rays):
    """The same rays, of one origin, by MuJoCo: distances, +inf for misses."""
    directions, seen = rays[..., 3:].reshape(-1, 3).astype(np.float64), np.uint8(np.isin(np.arange(6), GROUPS))
    distances, geoms = np.empty(len(directions)), np.empty(len(directions), np.int32)
    origin = rays.reshape(-1, 6)[0, :3].astype(np.float64)
    mujoco.mj_multiRay(
        model, data, origin, directions.ravel(), seen, True, -1, geoms, distances, None, len(directions), 1e9
    )
    return np.where(distances < 0, np.inf, distances).reshape(rays.shape[:-1]), geoms.reshape(rays.shape[:-1])


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=20)
    parser.add_argument("--instances", type=int, default=100)
    parser.add_argument("-o", "--output", default="mujoco_lidar.png")
    arguments = parser.parse_args()

    model = model_of(arguments.instances)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    world, geoms = world_of(model, data, GROUPS)
    moving = np.flatnonzero(model.geom_bodyid[geoms] > 0)
    elevations, azimuths = np.radians(np.linspace(-40, 4, 64)), np.linspace(-np.pi, np.pi, 1024, endpoint=False)
    pose = np.eye(4)
    pose[2, 3] = 6
    rays = rs.rays.lidar(elevations, azimuths, pose)
    hits, ours, theirs, differ = None, [], [], []
    for _ in range(arguments.frames):
        mujoco.mj_step(model, data, 10)
        begun = time.process_time()
        world.set_transforms(moving, transforms_of(data, geoms[moving]))
        hits = world.cast(rays, want="t instance position", out=hits)
        ours.append(time.process_time() - begun)
        begun = time.process_time()
        expected, hit_geoms = mujoco_distances(model, data, rays)
        theirs.append(time.process_time() - begun)
        found = np.where(hits.hit, geoms[hits.instance], -1)
        differ.append(np.mean((found != hit_geoms) | ~np.isclose(hits.t, expected, rtol=0, atol=1e-3)))
    milliseconds = [1e3 * np.median(seconds) for seconds in (ours, theirs)]
    print(f"{rays[..., 0].size} rays, {len(moving)} moving instances, CPU time of a frame:")
    print(f"raystream {milliseconds[0]:.2f} ms, MuJoCo {milliseconds[1]:.1f} ms")
    print(f"{100 * np.mean(differ):.2f} % of the rays hit something else, or elsewhere by a millimetre")

    import matplotlib.pyplot as plt

    points, instance = hits.position[hits.hit], hits.instance[hits.hit]
    figure, (above, beside) = plt.subplots(2, 1, figsize=(9, 12), height_ratios=[3, 1])
    terrain = instance == 0
    for axes, second in ((above, 1), (beside, 2)):
        axes.scatter(*points[terrain][:, [0, second]].T, s=0.3, c="0.75", linewidths=0)
        axes.scatter(
            *points[~terrain][:, [0, second]].T, s=1.5, c=instance[~terrain] % 20, cmap="tab20", linewidths=0
        )
        axes.set(aspect="equal", xlim=(-20, 20))
    above.set(title="points of a lidar in MuJoCo, seen from above and from the side")
    figure.savefig(arguments.output, dpi=110, bbox_inches="tight")
    print(arguments.output)


if __name__ == "__main__":
    main()
