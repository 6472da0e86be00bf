"""A still life of arrays: a tiled table with bumps, brass rings as instances, a glass ball, a painted bowl, a lamp.

python python/examples/still_life.py [--spp 256] [-o still_life.png]
"""

import argparse
from pathlib import Path

import numpy as np
import raystream as rs
from shapes import torus, vertex_normals


def turned(vertices):
    """Vertices about the y axis instead of the z axis."""
    return vertices[:, [0, 2, 1]] * np.float32([1, 1, -1])


def lathe(profile, around=192):
    """Vertices, faces and texture coordinates of a profile, (n, 2) radii and heights, turned about the y axis."""
    profile, turns = np.asarray(profile, float), np.linspace(0, 2 * np.pi, around + 1)
    radius, height = np.repeat(profile[:, :1], around + 1, 1), np.repeat(profile[:, 1:], around + 1, 1)
    vertices = np.stack([radius * np.cos(turns), height, -radius * np.sin(turns)], -1).reshape(-1, 3)
    at = np.arange(len(vertices)).reshape(len(profile), around + 1)
    a, b, c, d = at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    uvs = np.stack(np.meshgrid(turns / (2 * np.pi), np.linspace(1, 0, len(profile))), -1).reshape(-1, 2)
    return vertices, faces, uvs


def normals_of(heights, strength):
    """A normal map of heights that repeat, (n, n): linear numbers from 0 to 1."""
    across = (np.roll(heights, -1, 1) - np.roll(heights, 1, 1)) * strength
    down = (np.roll(heights, -1, 0) - np.roll(heights, 1, 0)) * strength
    normals = np.stack([-across, down, np.ones_like(heights)], -1)
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True) / 2 + 0.5


def tiles(side=256):
    """Colours, roughness and normals of one tile with its joint."""
    at = (np.arange(side) + 0.5) / side
    edge = np.minimum(at, 1 - at)
    inside = np.clip((np.minimum(*np.meshgrid(edge, edge)) - 0.015) / 0.02, 0, 1)
    # Clouds that repeat: noise whose fine parts are weak.
    frequency = np.hypot(*np.meshgrid(np.fft.rfftfreq(side, 1 / side), np.fft.fftfreq(side, 1 / side)))
    noise = np.fft.rfft2(np.random.default_rng(3).normal(size=(side, side)))
    grain = np.fft.irfft2(noise / (1 + frequency), (side, side))
    grain = (grain - grain.min()) / np.ptp(grain)
    colours = inside[..., None] * [0.30, 0.38, 0.42] * (0.7 + 0.5 * grain[..., None]) + (1 - inside[..., None]) * 0.5
    return colours, 0.15 + 0.5 * (1 - inside) + 0.2 * grain, normals_of(inside, 4.0)


def stripes(side=256):
    """A painted pattern, as an image file would have it."""
    u, v = np.meshgrid((np.arange(side) + 0.5) / side, (np.arange(side) + 0.5) / side)
    waves = np.sin(2 * np.pi * (12 * u + 0.6 * np.sin(8 * np.pi * v))) > 0
    return np.where(waves[..., None], [196, 84, 60], [238, 226, 200]).astype(np.uint8)


def still_life():
    """The scene."""
    scene = rs.Scene()
    colours, roughness, normals = tiles()
    corners = np.array([[-6, 0, 5], [6, 0, 5], [6, 0, -7], [-6, 0, -7]])
    place = {"scale": (8, 8)}
    table = rs.Material(
        "table", texture=rs.Texture(colours, **place), roughness=1, roughness_texture=rs.Texture(roughness, **place),
        normal_texture=rs.Texture(normals, **place),
    )  # fmt: skip
    scene.add(corners, [[0, 1, 2], [0, 2, 3]], name="table", material=table, uvs=[[0, 1], [1, 1], [1, 0], [0, 0]])

    angles = np.linspace(0, np.pi, 40)
    ball, faces, _ = lathe(np.stack([np.sin(angles), -np.cos(angles)], -1))
    at = [[0.9, 0, 0, -1.1], [0, 0.9, 0, 0.9], [0, 0, 0.9, 0.6]]
    scene.add(ball, faces, name="ball", normals=ball, transform=at, material={"ior": 1.5, "colour": [0.97, 1, 0.98]})

    outside = [(0.45, 0), (0.5, 0.04), (0.8, 0.25), (1.05, 0.6), (1.15, 1.0)]
    bowl, faces, uvs = lathe([*outside, *[(0.96 * radius - 0.02, height + 0.03) for radius, height in outside[::-1]]])
    glaze = {"texture": stripes(), "roughness": 0.5, "coats": [{"roughness": 0.05}]}
    at = [[1, 0, 0, 1.2], [0, 1, 0, 0], [0, 0, 1, -0.6]]
    scene.add(bowl, faces, name="bowl", uvs=uvs, material=glaze, transform=at, normals=vertex_normals(bowl, faces))

    ring, faces = torus(0.42, 0.09, 128, 48)
    ring, places = turned(ring), []
    rng = np.random.default_rng(7)
    for number in range(7):
        angle, lean = rng.uniform(0, 2 * np.pi), 0.0 if number < 4 else 0.25
        about_y = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        about_x = np.array([[1, 0, 0], [0, np.cos(lean), -np.sin(lean)], [0, np.sin(lean), np.cos(lean)]])
        matrix = np.eye(4)
        matrix[:3, :3] = about_y @ about_x
        matrix[:3, 3] = [0.25 + 0.05 * rng.normal(), 0.09 + 0.18 * number, 1.6 + 0.05 * rng.normal()]
        if number >= 4:
            matrix[:3, 3] = [[1.6, 0.2, 1.5], [-0.5, 0.2, 2.4], [2.3, 0.2, 0.9]][number - 4]
        places.append(matrix)
    brass = rs.Material("brass", colour=[0.91, 0.70, 0.35], metallic=1, roughness=0.18)
    scene.add(ring, faces, name="rings", normals=vertex_normals(ring, faces), material=brass, transform=places)

    lamp = np.array([[-1.5, 5, -1], [1.5, 5, -1], [1.5, 5, 1], [-1.5, 5, 1]]) + [-2, 0, 1]
    scene.add(lamp, [[0, 1, 2], [0, 2, 3]], name="lamp", material={"emission": [14, 12, 10]})
    return scene


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--size", default="960x540")
    parser.add_argument("-o", "--output", type=Path, default=Path("still_life.png"))
    arguments = parser.parse_args()
    scene = still_life()
    print(scene, scene.objects)
    view = {"eye": (0.4, 2.6, 6.2), "target": (0.1, 0.7, 0), "fov": 38, "env": "0.25,0.3,0.4"}
    picture = rs.render(scene, size=arguments.size, spp=arguments.spp, **view)
    picture.save(arguments.output)
    print(arguments.output, picture.hash())


if __name__ == "__main__":
    main()
