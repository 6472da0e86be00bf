"""Rays of cameras and scanners."""

import unittest

import numpy as np
import raystream as rs


class Pinhole(unittest.TestCase):
    def setUp(self):
        self.intrinsics = np.array([[100.0, 0, 31.5], [0, 120.0, 24.25], [0, 0, 1]])
        angle = 0.7
        rotation = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        self.world_to_camera = np.eye(4)
        self.world_to_camera[:3, :3], self.world_to_camera[:3, 3] = rotation, [0.5, -2, 3]

    def test_rays_go_through_the_centres_of_pixels(self):
        rays = rs.rays.pinhole(self.intrinsics, self.world_to_camera, 64, 48).astype(np.float64)
        self.assertEqual(rays.shape, (48, 64, 6))
        points = rays[..., :3] + 5 * rays[..., 3:]
        camera = points @ self.world_to_camera[:3, :3].T + self.world_to_camera[:3, 3]
        # t is depth.
        np.testing.assert_allclose(camera[..., 2], 5, rtol=1e-5)
        pixels = camera @ self.intrinsics.T / camera[..., 2:]
        y, x = np.mgrid[:48, :64] + 0.5
        np.testing.assert_allclose(pixels[..., :2], np.stack([x, y], axis=-1), atol=1e-3)

    def test_axes_of_opengl(self):
        opencv = rs.rays.pinhole(self.intrinsics, np.eye(4), 64, 48)
        opengl = rs.rays.pinhole(self.intrinsics, np.eye(4), 64, 48, axes="opengl")
        np.testing.assert_allclose(opengl[..., 3:], opencv[..., 3:] * [1, -1, -1])
        with self.assertRaisesRegex(ValueError, "'opencv' or 'opengl'"):
            rs.rays.pinhole(self.intrinsics, np.eye(4), 64, 48, axes="y-up")

    def test_first_pixel(self):
        rays = rs.rays.pinhole([[1, 0, 0], [0, 1, 0], [0, 0, 1]], np.eye(4), 2, 2)
        self.assertEqual(rays[0, 0].tolist(), [0, 0, 0, 0.5, 0.5, 1])
        self.assertEqual(rays[0, 1].tolist(), [0, 0, 0, 1.5, 0.5, 1])


class Lidar(unittest.TestCase):
    def test_angles_and_pose(self):
        pose = np.array([[0, -1, 0, 10], [1, 0, 0, 20], [0, 0, 1, 30], [0, 0, 0, 1.0]])
        rays = rs.rays.lidar([0, np.pi / 2], [0, np.pi / 2, np.pi], pose)
        self.assertEqual(rays.shape, (2, 3, 6))
        self.assertEqual(rays[0, 0, :3].tolist(), [10, 20, 30])
        expected = [[0, 1, 0], [-1, 0, 0], [0, -1, 0]]
        np.testing.assert_allclose(rays[0, :, 3:], expected, atol=1e-6)
        np.testing.assert_allclose(rays[1, :, 3:], [[0, 0, 1]] * 3, atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(rays[..., 3:], axis=-1), 1, rtol=1e-6)


if __name__ == "__main__":
    unittest.main()
