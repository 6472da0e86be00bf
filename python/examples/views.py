"""Views of a scene from all around, with depth and masks, and a sheet of them: what a data set is made of.

python python/examples/views.py [model.glb] [--views 8] [-o views.png]
"""

import argparse
from pathlib import Path

import numpy as np
import raystream as rs
from shapes import torus, vertex_normals

SHEET_COLUMNS = 4


def ring():
    """A ring in the colours of the directions that it faces."""
    vertices, faces = torus(1.0, 0.4, 160, 80)
    vertices = vertices[:, [0, 2, 1]] * np.float32([1, 1, -1])
    normals = vertex_normals(vertices, faces)
    return rs.Scene(vertices, faces, normals=normals, colours=0.45 + 0.4 * normals)


def sheet(pictures):
    """Rows of pictures, `(height, width, 3)` each."""
    empty = [np.full_like(pictures[0], 255)] * (-len(pictures) % SHEET_COLUMNS)
    pictures = [*pictures, *empty]
    rows = [np.concatenate(pictures[i : i + SHEET_COLUMNS], 1) for i in range(0, len(pictures), SHEET_COLUMNS)]
    return np.concatenate(rows)


def over_white(shown):
    """Pixels with alpha, over white."""
    alpha = shown[..., 3:] / 255.0
    return (shown[..., :3] * alpha + 255 * (1 - alpha)).astype(np.uint8)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", help="a .glb, .obj, .ply, .. or a recipe; else a ring from arrays")
    parser.add_argument("--views", type=int, default=8)
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("-o", "--output", type=Path, default=Path("views.png"))
    arguments = parser.parse_args()

    # The scene is read and prepared once. Views have the layers z and alpha without being asked.
    scene = arguments.scene or ring()
    light = {} if arguments.scene else {"env": "1,1,1"}
    views = rs.open(scene, views=arguments.views, size=(320, 240), spp=arguments.spp, aov="normal,object", **light)
    pictures, depths = [], []
    for number in views.frames:
        picture = views.render(number, progress=lambda share: print(f"\r{number}: {100 * share:3.0f} %", end=""))
        print(f"\r{number}: {picture.hash()}, {picture.stats['seconds']:.2f} s")
        picture.save(arguments.output.with_suffix(f".{number}.npz"))
        pictures.append(over_white(picture.shown()))
        # Nearest white, farthest grey, nothing black.
        depth, seen = picture["z"], np.isfinite(picture["z"])
        near, far = depth[seen].min(), depth[seen].max()
        grey = np.where(seen, 1 - 0.7 * (depth - near) / max(far - near, 1e-9), 0)
        depths.append(np.repeat((255 * grey).astype(np.uint8)[..., None], 3, axis=-1))

    import matplotlib.pyplot as plt

    plt.imsave(arguments.output, sheet(pictures + depths))
    print(arguments.output)


if __name__ == "__main__":
    main()
