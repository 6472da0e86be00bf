"""A slice of the signed distance field of a torus, plotted.

python python/examples/signed_distance.py [-o signed_distance.png]
"""

import argparse
import time

import numpy as np
import raystream as rs
from shapes import torus


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, default=400, help="points along each side")
    parser.add_argument("-o", "--output", default="signed_distance.png")
    arguments = parser.parse_args()

    mesh = rs.Mesh(*torus())
    along = np.linspace(-1.8, 1.8, arguments.size, dtype=np.float32)
    x, z = np.meshgrid(along, along)
    points = np.stack([x, np.zeros_like(x), z], axis=-1)
    begun = time.perf_counter()
    distance = mesh.signed_distance(points)
    print(f"{distance.size} points in {time.perf_counter() - begun:.2f} s")

    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(8, 7))
    levels = np.linspace(-1.5, 1.5, 31)
    field = axes.contourf(x, z, distance, levels, cmap="RdBu", extend="both")
    axes.contour(x, z, distance, [0], colors="k", linewidths=2)
    figure.colorbar(field, label="signed distance, negative inside")
    axes.set(aspect="equal", xlabel="x", ylabel="z", title="a slice through a torus")
    figure.savefig(arguments.output, dpi=110, bbox_inches="tight")
    print(arguments.output)


if __name__ == "__main__":
    main()
