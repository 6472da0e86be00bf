"""Points: the nearest on a surface, distances, inside and outside."""

import unittest

import numpy as np
import raystream as rs
from shapes import CORNERS, FACES, icosphere


def box_distance(points):
    """The signed distance of points from the unit cube, negative inside, and the nearest points outside of it."""
    beyond = np.abs(points - 0.5) - 0.5
    return np.linalg.norm(np.maximum(beyond, 0), axis=-1) + np.minimum(beyond.max(axis=-1), 0)


class Points(unittest.TestCase):
    def setUp(self):
        self.mesh = rs.Mesh(CORNERS, FACES)
        self.points = (np.random.default_rng(3).random((4000, 3)) * 3 - 1).astype(np.float32)

    def test_signed_distances_of_a_cube(self):
        expected = box_distance(self.points.astype(np.float64))
        np.testing.assert_allclose(self.mesh.signed_distance(self.points), expected, atol=1e-6)
        np.testing.assert_allclose(self.mesh.distance(self.points), np.abs(expected), atol=1e-6)
        np.testing.assert_array_equal(self.mesh.contains(self.points), expected <= 0)

    def test_points_on_the_surface_are_inside_and_at_distance_0(self):
        weights = np.array([[0.5, 0.25, 0.25], [1, 0, 0], [0.5, 0.5, 0]])
        points = np.einsum("wc,fcd->fwd", weights, CORNERS[FACES].astype(np.float64))
        self.assertTrue(self.mesh.contains(points).all())
        np.testing.assert_array_equal(self.mesh.signed_distance(points), 0)

    def test_nearest_points_lie_on_their_triangles(self):
        vertices, faces = icosphere(3)
        mesh = rs.Mesh(vertices, faces)
        near = mesh.nearest(self.points)
        corners = vertices[faces[near.primitive]].astype(np.float64)
        weights = np.stack([1 - near.uv.sum(axis=1), near.uv[:, 0], near.uv[:, 1]], axis=1)
        on_triangle = np.einsum("nc,ncd->nd", weights, corners)
        np.testing.assert_allclose(near.position, on_triangle, atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(self.points - near.position, axis=1), near.distance, atol=1e-6)
        # No vertex is nearer.
        least = np.linalg.norm(self.points[:, None] - vertices[None], axis=2).min(axis=1)
        self.assertTrue((near.distance <= least + 1e-6).all())

    def test_limits(self):
        near = self.mesh.nearest([[0.5, 0.5, 3], [0.5, 0.5, 1.25]], max_distance=1, want="distance primitive position")
        self.assertEqual(near.distance.tolist(), [np.inf, 0.25])
        self.assertEqual(near.primitive[0], -1)
        self.assertTrue(np.isnan(near.position[0]).all())

    def test_open_meshes_have_no_inside(self):
        mesh = rs.Mesh(CORNERS, FACES[:-1])
        self.assertEqual((mesh.open_edges, mesh.is_closed), (3, False))
        for name in ("contains", "signed_distance"):
            with self.assertRaisesRegex(ValueError, "3 of its edges"):
                getattr(mesh, name)(self.points)
        self.assertEqual(mesh.contains(self.points, allow_open=True).shape, (4000,))
        self.assertEqual((self.mesh.open_edges, self.mesh.is_closed), (0, True))

    def test_a_refitted_mesh_is_counted_anew(self):
        soup = rs.Mesh(CORNERS[FACES])
        self.assertTrue(soup.is_closed)
        torn = CORNERS[FACES].copy()
        torn[0] += 0.25
        soup = rs.Mesh(torn.reshape(-1, 3), np.arange(36).reshape(-1, 3))
        self.assertFalse(soup.is_closed)
        soup.refit(CORNERS[FACES].reshape(-1, 3))
        self.assertTrue(soup.is_closed)

    def test_shapes(self):
        grid = self.points.reshape(10, 20, 20, 3)
        self.assertEqual(self.mesh.distance(grid).shape, (10, 20, 20))
        self.assertEqual(self.mesh.nearest(grid).position.shape, (10, 20, 20, 3))
        self.assertEqual(self.mesh.contains(grid[0, 0, 0]).shape, ())


if __name__ == "__main__":
    unittest.main()
