"""`transforms.json` of many views, read as NeRF and nerfstudio read it, says where each pixel is."""

import json

import numpy as np
import raystream

WIDTH, HEIGHT = 48, 32
ASSET = {
    "materials": {"clay": {"colour": [0.6, 0.5, 0.4]}},
    "shapes": [
        {"shape": "sphere", "centre": [0, 0, 0], "radius": 1, "cells": 32, "material": "clay"},
        {"shape": "sphere", "centre": [0.7, 1.2, -0.4], "radius": 0.6, "cells": 32, "material": "clay"},
    ],
}


def rays(transforms, frame):
    """Origins and directions of the middles of pixels, by the published code of NeRF (`get_rays`) with the focal
    lengths, the principal point and the half pixel of nerfstudio. Directions have the length 1 along the view axis."""
    lens = transforms | frame
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    directions = [(x - lens["cx"]) / lens["fl_x"], -(y - lens["cy"]) / lens["fl_y"], -np.ones_like(x)]
    to_world = np.array(frame["transform_matrix"])
    return to_world[:3, 3], np.stack(directions, axis=-1) @ to_world[:3, :3].T


class Views(raystream.Case):
    def views(self, output, *options):
        (self.folder / "asset.json").write_text(json.dumps(ASSET))
        (self.folder / "set").mkdir()
        self.raystream("render", "asset.json", "-o", output, "--size", f"{WIDTH}x{HEIGHT}", "--spp", 64, "--tracer",
                       "cpu", "--max-bounces", 0, "--aov", "position,depth", *options)
        transforms = json.loads((self.folder / "set" / "transforms.json").read_text())
        self.assertEqual((transforms["w"], transforms["h"]), (WIDTH, HEIGHT))
        return transforms

    def assert_seen(self, transforms, frame, pixels):
        """The rays pass what the pixels show, as far away as the depths say."""
        origin, directions = rays(transforms, frame)
        hit = np.isfinite(pixels["z"])
        lengths = np.linalg.norm(directions, axis=-1)
        self.assertTrue(np.allclose((lengths * pixels["z"])[hit], pixels["depth"][hit], rtol=1e-5))
        # Pixels and their neighbours show the asset.
        whole = hit.copy()
        for axis, step in [(0, 1), (0, -1), (1, 1), (1, -1)]:
            whole &= np.roll(hit, step, axis)
        self.assertGreater(whole.sum(), 80)
        ways = pixels["position"] - origin
        units = directions / lengths[..., None]
        beside = np.linalg.norm(ways - units * (ways * units).sum(axis=-1, keepdims=True), axis=-1)
        pixel = pixels["z"] / (transforms | frame)["fl_x"]
        self.assertLess((beside[whole] / pixel[whole]).max(), 0.1)
        self.assertLess(np.median(beside[whole] / pixel[whole]), 0.01)

    def test_rays_of_views_around_an_asset(self):
        transforms = self.views("set/%03d.npz", "--views", 7, "--fov", 40, "--shift=0.05,-0.1")
        self.assertEqual(len(transforms["frames"]), 7)
        # NeRF's own data sets have this angle alone.
        angle = 2 * np.arctan(0.5 * WIDTH / transforms["fl_x"])
        self.assertAlmostEqual(transforms["camera_angle_x"], angle)
        for frame in transforms["frames"]:
            self.assert_seen(transforms, frame, np.load(self.folder / "set" / frame["file_path"]))

    def test_files_of_depths(self):
        transforms = self.views("set/%s.png", "--views", 3, "--K", "40,42,20,17")
        for frame in transforms["frames"]:
            stem = self.folder / "set" / frame["file_path"].removesuffix(".png")
            pixels = {name: np.load(f"{stem}.{name}.npy") for name in ("position", "depth")}
            pixels["z"] = np.load(self.folder / "set" / frame["depth_file_path"])
            self.assertEqual(pixels["z"].dtype, np.float32)
            self.assert_seen(transforms, frame, pixels)
