"""Positions of pixels, projected by OpenCV, lie in the middles of their pixels: each lens, all conventions."""

import json

import cv2
import numpy as np
import raystream

WIDTH, HEIGHT = 336, 252
K = np.array([[231.0, 0, 172.55], [0, 225.4, 123.9], [0, 0, 1]])
# World to camera.
ROTATION = cv2.Rodrigues(np.array([0.4, -1.1, 0.15]))[0]
TRANSLATION = np.array([0.7, -1.3, 2.2])
# A ball around the camera: wherever a pixel looks there is a point.
EYE = -ROTATION.T @ TRANSLATION
SCENE = {
    "materials": {"wall": {"colour": [0.5, 0.5, 0.5]}},
    "shapes": [{"shape": "sphere", "centre": EYE.tolist(), "radius": 4, "cells": 64, "material": "wall"}],
}
BROWN_CONRADY = [
    (-0.28, 0.074, 1.2e-3, -4e-4),
    (0.12, -0.21, -8e-4, 2e-3, 0.09),
    (0.62, -0.11, 3e-4, 7e-4, 0.02, 0.95, 0.06, -0.01),
    (-0.21, 0.08, 5e-4, -1e-3, 0.01, 0.03, -0.01, 0.002, 2e-3, -1e-3, -3e-3, 4e-4),
]
FISHEYE = [(0.0, 0.0, 0.0, 0.0), (-0.013, 0.021, -0.017, 0.0035)]


class Cameras(raystream.Case):
    def positions(self, *lens):
        """The mean position of each pixel. 256 stratified samples are off by less than 1e-4 pixels."""
        (self.folder / "ball.json").write_text(json.dumps(SCENE))
        pose = np.hstack([ROTATION, TRANSLATION[:, None]])
        (self.folder / "pose.json").write_text(json.dumps(pose.tolist()))
        intrinsics = ",".join(str(x) for x in (K[0, 0], K[1, 1], K[0, 2], K[1, 2]))
        self.raystream("render", "ball.json", "-o", "a.npz", "--size", f"{WIDTH}x{HEIGHT}", "--spp", 256, "--tracer",
                       "cpu", "--max-bounces", 0, "--aov", "position", "--transparent", "--K", intrinsics,
                       "--world-to-camera", "pose.json", *lens)
        arrays = np.load(self.folder / "a.npz")
        return arrays["position"], arrays["alpha"]

    def assert_in_the_middle(self, project, *lens):
        positions, alpha = self.positions(*lens)
        rng = np.random.default_rng(1)
        seen = np.argwhere(alpha == 1)
        pixels = seen[rng.choice(len(seen), 1000, replace=False)]
        points = positions[pixels[:, 0], pixels[:, 1]].astype(np.float64)
        found = project(points[:, None]).reshape(-1, 2)
        off = np.linalg.norm(found - (pixels[:, ::-1] + 0.5), axis=1)
        self.assertLess(off.max(), 1e-3, lens)

    def test_pinhole_and_brown_conrady(self):
        pose = cv2.Rodrigues(ROTATION)[0], TRANSLATION
        for coefficients in [None, *BROWN_CONRADY]:
            numbers = np.zeros(4) if coefficients is None else np.array(coefficients)
            lens = [] if coefficients is None else ["--distortion=" + ",".join(map(str, coefficients))]
            self.assert_in_the_middle(lambda points: cv2.projectPoints(points, *pose, K, numbers)[0], *lens)

    def test_fisheye(self):
        pose = cv2.Rodrigues(ROTATION)[0], TRANSLATION
        for k in FISHEYE:
            project = lambda points: cv2.fisheye.projectPoints(points, *pose, K, np.array(k))[0]
            self.assert_in_the_middle(project, "--fisheye=" + ",".join(map(str, k)))
