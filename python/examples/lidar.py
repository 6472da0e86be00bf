"""A lidar on a moving car among moving instances: the points that it sees, frame by frame.

python python/examples/lidar.py [--frames 20] [-o lidar.png]
"""

import argparse
import time

import numpy as np
import raystream as rs
from shapes import box, torus


def placed(x, y, z, angle):
    """A transform: a turn about z, then a move."""
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, -sine, 0, x], [sine, cosine, 0, y], [0, 0, 1, z], [0, 0, 0, 1.0]])


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=20)
    parser.add_argument("--instances", type=int, default=100)
    parser.add_argument("-o", "--output", default="lidar.png")
    arguments = parser.parse_args()

    world, rng = rs.World(), np.random.default_rng(0)
    world.add(rs.Mesh(*box([-60, -60, -0.5], [60, 60, 0])))
    kinds = [rs.Mesh(*box([-1, -0.5, 0], [1, 0.5, 1.5])), rs.Mesh(*torus(1.2, 0.4))]
    count = arguments.instances
    # Beside the road, along which the car drives, and away from it.
    side = rng.choice([-1.0, 1.0], count)
    start = np.column_stack([rng.uniform(-40, 40, count), side * rng.uniform(3, 40, count)])
    start = np.column_stack([start, np.full(count, 0.6), rng.uniform(0, 6.3, count)])
    speed = np.column_stack([rng.normal(0, 0.5, count), side * rng.uniform(0, 0.3, count)])
    ids = [world.add(kinds[i % 2], placed(*start[i])) for i in range(count)]

    elevations, azimuths = np.radians(np.linspace(-24, 4, 64)), np.linspace(-np.pi, np.pi, 1024, endpoint=False)
    seconds, hits = 0.0, None
    for frame in range(arguments.frames):
        moved = start.copy()
        moved[:, :2] += frame * speed
        moved[:, 3] += 0.05 * frame
        rays = rs.rays.lidar(elevations, azimuths, placed(0.3 * frame, 0, 1.8, 0.02 * frame))
        begun = time.perf_counter()
        world.set_transforms(ids, np.stack([placed(*place) for place in moved]))
        hits = world.cast(rays, want="t instance position", out=hits, t_max=80)
        seconds += time.perf_counter() - begun
    print(f"{arguments.frames} frames of {rays[..., 0].size} rays, {1e3 * seconds / arguments.frames:.2f} ms each")

    import matplotlib.pyplot as plt

    points, instance = hits.position[hits.hit], hits.instance[hits.hit]
    figure, axes = plt.subplots(figsize=(9, 9))
    ground = instance == 0
    axes.scatter(*points[ground, :2].T, s=0.3, c="0.75", linewidths=0)
    axes.scatter(*points[~ground, :2].T, s=1.5, c=instance[~ground] % 20, cmap="tab20", linewidths=0)
    axes.set(aspect="equal", xlim=(-50, 50), ylim=(-50, 50), title="points of a lidar, seen from above")
    figure.savefig(arguments.output, dpi=110, bbox_inches="tight")
    print(arguments.output)


if __name__ == "__main__":
    main()
