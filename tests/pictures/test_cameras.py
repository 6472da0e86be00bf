"""Positions of pixels, projected by published formulas, lie in the middles of their pixels: each lens."""

import itertools
import json

import cv2
import numpy as np
import raystream

WIDTH, HEIGHT = 336, 252
K = np.array([[231.0, 0, 172.55], [0, 225.4, 123.9], [0, 0, 1]])
# World to camera.
ROTATION = cv2.Rodrigues(np.array([0.4, -1.1, 0.15]))[0]
TRANSLATION = np.array([0.7, -1.3, 2.2])
POSE = cv2.Rodrigues(ROTATION)[0], TRANSLATION
INTRINSICS = "--K", ",".join(str(x) for x in (K[0, 0], K[1, 1], K[0, 2], K[1, 2]))
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
# Upper left corners of the quarters of a picture. One is rendered of each lens, another one each time.
QUARTERS = itertools.cycle([(0, 0), (WIDTH // 2, HEIGHT // 2), (WIDTH // 2, 0), (0, HEIGHT // 2)])


class Cameras(raystream.Case):
    def setUp(self):
        super().setUp()
        (self.folder / "ball.json").write_text(json.dumps(SCENE))
        pose = np.hstack([ROTATION, TRANSLATION[:, None]])
        (self.folder / "pose.json").write_text(json.dumps(pose.tolist()))

    def positions(self, scene, corner, *lens):
        """The mean position of each pixel of a quarter. 256 stratified samples are off by less than 1e-4 pixels."""
        region = ",".join(map(str, (*corner, WIDTH // 2, HEIGHT // 2)))
        self.raystream("render", scene, "-o", "a.npz", "--size", f"{WIDTH}x{HEIGHT}", "--region", region, "--spp", 256,
                       "--tracer", "cpu", "--max-bounces", 0, "--aov", "position", "--transparent",
                       "--world-to-camera", "pose.json", *lens)
        arrays = np.load(self.folder / "a.npz")
        return arrays["position"], arrays["alpha"]

    def assert_in_the_middle(self, project, *lens, scene="ball.json"):
        corner = next(QUARTERS)
        positions, alpha = self.positions(scene, corner, *lens)
        rng = np.random.default_rng(1)
        seen = np.argwhere(alpha == 1)
        pixels = seen[rng.choice(len(seen), 1000, replace=False)]
        points = positions[pixels[:, 0], pixels[:, 1]].astype(np.float64)
        found = project(points[:, None]).reshape(-1, 2)
        off = np.linalg.norm(found - corner - (pixels[:, ::-1] + 0.5), axis=1)
        self.assertLess(off.max(), 1e-3, lens)

    def test_pinhole_and_brown_conrady(self):
        for coefficients in [None, *BROWN_CONRADY]:
            numbers = np.zeros(4) if coefficients is None else np.array(coefficients)
            lens = [] if coefficients is None else ["--distortion=" + ",".join(map(str, coefficients))]
            project = lambda points: cv2.projectPoints(points, *POSE, K, numbers)[0]
            self.assert_in_the_middle(project, *INTRINSICS, *lens)

    def test_fisheye(self):
        for k in FISHEYE:
            project = lambda points: cv2.fisheye.projectPoints(points, *POSE, K, np.array(k))[0]
            self.assert_in_the_middle(project, *INTRINSICS, "--fisheye=" + ",".join(map(str, k)))

    def test_field_of_view_and_shift(self):
        focal = HEIGHT / (2 * np.tan(np.radians(50) / 2))
        # The picture moves to the right and up over what is seen.
        for x, y in [(0, 0), (0.1, -0.2)]:
            k = np.array([[focal, 0, (0.5 - x) * WIDTH], [0, focal, (0.5 + y) * HEIGHT], [0, 0, 1]])
            project = lambda points: cv2.projectPoints(points, *POSE, k, np.zeros(4))[0]
            self.assert_in_the_middle(project, "--fov", 50, f"--shift={x},{y}")

    def test_thin_lens(self):
        # Whatever lies in the plane in focus is seen through all of the opening in one place.
        distance = 3.0
        corners = np.array([(x, y, distance) for x, y in [(-9, -9), (9, -9), (9, 9), (-9, 9)]])
        corners = (corners - TRANSLATION) @ ROTATION
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in corners.tolist()] + ["f 1 2 3 4", ""]
        (self.folder / "plane.obj").write_text("\n".join(lines))
        lens = "--aperture-radius", 0.2, "--focus-distance", distance
        for blades, coefficients in [((), None), (("--aperture-blades", 5), BROWN_CONRADY[1])]:
            numbers = np.zeros(4) if coefficients is None else np.array(coefficients)
            bent = [] if coefficients is None else ["--distortion=" + ",".join(map(str, coefficients))]
            project = lambda points: cv2.projectPoints(points, *POSE, K, numbers)[0]
            self.assert_in_the_middle(project, *INTRINSICS, *lens, *blades, *bent, scene="plane.obj")

    # OpenCV has neither of these two projections: the formulas are those of docs/guide/cameras.md.

    def test_orthographic(self):
        height = 2.5

        def project(points):
            x, y, _ = (points[:, 0] @ ROTATION.T + TRANSLATION).T
            return np.stack([WIDTH / 2 + x * HEIGHT / height, HEIGHT / 2 + y * HEIGHT / height], axis=1)

        self.assert_in_the_middle(project, "--orthographic", height)

    def test_panorama(self):
        def project(points):
            x, y, z = (points[:, 0] @ ROTATION.T + TRANSLATION).T
            longitude, latitude = np.arctan2(x, z), np.arctan2(-y, np.hypot(x, z))
            return np.stack([(0.5 + longitude / (2 * np.pi)) * WIDTH, (0.5 - latitude / np.pi) * HEIGHT], axis=1)

        self.assert_in_the_middle(project, "--panorama")
