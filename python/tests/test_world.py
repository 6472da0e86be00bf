"""Worlds: meshes at many places."""

import copy
import pickle
import unittest

import numpy as np
import raystream as rs
from shapes import CORNERS, FACES, rays


def shift(x, y=0.0, z=0.0):
    """A translation."""
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


class Worlds(unittest.TestCase):
    def setUp(self):
        self.mesh = rs.Mesh(CORNERS, FACES)
        self.world = rs.World()
        self.ids = [self.world.add(self.mesh, shift(3 * i)) for i in range(4)]
        self.rays = rays(2000, spread=4)

    def merged(self, offsets):
        vertices = np.concatenate([CORNERS + np.float32([x, 0, 0]) for x in offsets])
        faces = np.concatenate([FACES + 8 * i for i in range(len(offsets))])
        return rs.Mesh(vertices, faces)

    def test_a_world_answers_as_one_mesh_of_all(self):
        expected = self.merged([0, 3, 6, 9]).cast(self.rays, want="t primitive normal")
        hits = self.world.cast(self.rays, want="t primitive instance normal")
        np.testing.assert_array_equal(hits.t, expected.t)
        both = np.where(hits.hit, hits.instance * 12 + hits.primitive, -1)
        np.testing.assert_array_equal(both, expected.primitive)
        np.testing.assert_array_equal(hits.normal, expected.normal)
        np.testing.assert_array_equal(self.world.count(self.rays), self.merged([0, 3, 6, 9]).count(self.rays))
        self.assertEqual(len(self.world), 4)

    def test_moved_instances(self):
        self.world.set_transforms(self.ids[1:3], np.stack([shift(-3), shift(-6)]))
        expected = self.merged([0, -3, -6, 9]).cast(self.rays).t
        np.testing.assert_array_equal(self.world.cast(self.rays).t, expected)
        with self.assertRaisesRegex(IndexError, "no instance 9"):
            self.world.set_transforms(9, shift(0))
        with self.assertRaises(ValueError):
            self.world.set_transforms(0, np.zeros((4, 4)))
        np.testing.assert_array_equal(self.world.cast(self.rays).t, expected)

    def test_float64_meshes_stand_where_they_are(self):
        world, far = rs.World(), np.array([1000.0, 0, 0])
        world.add(rs.Mesh(CORNERS.astype(np.float64) + far, FACES), shift(-1000))
        np.testing.assert_allclose(world.cast(self.rays).t, self.mesh.cast(self.rays).t, rtol=1e-4, atol=1e-4)

    def test_copies_are_their_own(self):
        before = self.world.cast(self.rays).hash()
        others = [copy.copy(self.world), copy.deepcopy(self.world), pickle.loads(pickle.dumps(self.world))]
        self.world.set_transforms(self.ids[0], shift(50))
        for other in others:
            self.assertEqual(other.cast(self.rays).hash(), before)
            self.assertEqual(len(other), 4)
        self.assertNotEqual(self.world.cast(self.rays).hash(), before)


if __name__ == "__main__":
    unittest.main()
