"""A matrix of which places see each other among walls, plotted with its plan.

python python/examples/visibility.py [-o visibility.png]
"""

import argparse

import numpy as np
import raystream as rs
from shapes import box


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", default="visibility.png")
    arguments = parser.parse_args()

    walls = [([-5, 0, 0], [-1, 0.2, 3]), ([1, 0, 0], [5, 0.2, 3])]
    walls += [([0, 2, 0], [0.2, 5, 3]), ([-3, -5, 0], [-2.8, -2, 3])]
    parts = [box(*wall) for wall in walls]
    vertices = np.concatenate([vertices for vertices, _ in parts])
    mesh = rs.Mesh(vertices, np.concatenate([faces + 8 * i for i, (_, faces) in enumerate(parts)]))

    # Places in order of their angle about the middle.
    places = np.random.default_rng(3).uniform(-4.8, 4.8, (60, 2))
    places = places[np.argsort(np.arctan2(places[:, 1], places[:, 0]))]
    places = np.column_stack([places, np.full(60, 1.7)]).astype(np.float32)
    places = places[~mesh.contains(places)]
    sees = mesh.visible(places[:, None], places[None])
    assert (sees == sees.T).all()
    print(f"{len(places)} places, {100 * sees.mean():.0f} % of pairs see each other")

    import matplotlib.pyplot as plt

    figure, (plan, matrix) = plt.subplots(1, 2, figsize=(13, 6))
    for low, high in walls:
        plan.add_patch(plt.Rectangle(low[:2], high[0] - low[0], high[1] - low[1], color="k"))
    for i, j in np.argwhere(np.triu(sees, 1)):
        plan.plot(*places[[i, j], :2].T, c="tab:green", lw=0.25)
    plan.scatter(*places[:, :2].T, c=np.arange(len(places)), cmap="hsv", zorder=3)
    plan.set(aspect="equal", title="places that see each other")
    matrix.imshow(sees, cmap="gray")
    matrix.set(title="the matrix", xlabel="to", ylabel="from")
    figure.savefig(arguments.output, dpi=90, bbox_inches="tight")
    print(arguments.output)


if __name__ == "__main__":
    main()
