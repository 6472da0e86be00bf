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

    def test_triangles_carry_the_numbers_and_normals_of_their_instance(self):
        up = np.tile(np.float32([0, 1, 0]), (8, 1))
        meshes = [rs.Mesh(CORNERS, FACES, 100 * i + np.arange(12), normals=up) for i in range(2)]
        world, turned = rs.World(), np.eye(4)
        turned[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
        world.add(meshes[0])
        world.set_visible(world.add(self.mesh), False)
        world.add(meshes[1], shift(3) @ turned)
        hits = world.cast(self.rays, want="primitive instance attribute shading_normal")
        self.assertEqual(set(np.unique(hits.instance)), {-1, 0, 2})
        expected = np.where(hits.hit, 50 * hits.instance + hits.primitive, np.nan)
        np.testing.assert_array_equal(hits.attribute, np.float32(expected))
        np.testing.assert_array_equal(hits.shading_normal[hits.instance == 0], [[0, 1, 0]] * (hits.instance == 0).sum())
        np.testing.assert_array_equal(
            hits.shading_normal[hits.instance == 2], [[-1, 0, 0]] * (hits.instance == 2).sum()
        )
        numbers = np.concatenate([mesh.attributes for mesh in meshes])
        sums = world.sum_along(self.rays)
        np.testing.assert_array_equal(sums, world.sum_along(self.rays, attribute=numbers))
        lists = world.all_hits(self.rays, want="primitive instance")
        np.testing.assert_array_equal(
            sums, np.bincount(lists.ray, 50 * lists.instance + lists.primitive, len(self.rays))
        )
        with self.assertRaisesRegex(ValueError, "23 numbers for 24 triangles"):
            world.sum_along(self.rays, attribute=numbers[1:])
        world.set_visible(1, True)
        with self.assertRaisesRegex(ValueError, "the mesh of instance 1 has no normals; pass normals="):
            world.cast(self.rays, want="shading_normal")
        with self.assertRaisesRegex(ValueError, "the mesh of instance 1 has no attributes"):
            world.sum_along(self.rays)

    def test_instances_go_and_hide(self):
        self.world.remove(self.ids[0])
        self.world.set_visible(self.ids[3], False)
        self.assertEqual(len(self.world), 3)
        hits = self.world.cast(self.rays, want="t instance")
        np.testing.assert_array_equal(hits.t, self.merged([3, 6]).cast(self.rays).t)
        self.assertEqual(set(np.unique(hits.instance)), {-1, 1, 2})
        pickled = pickle.loads(pickle.dumps(self.world))
        self.assertEqual(pickled.cast(self.rays, want="t instance").hash(), hits.hash())
        self.world.set_visible([3], True)
        np.testing.assert_array_equal(self.world.cast(self.rays).t, self.merged([3, 6, 9]).cast(self.rays).t)
        with self.assertRaisesRegex(IndexError, "no instance 0"):
            self.world.set_visible(0, True)
        self.assertEqual(self.world.add(self.mesh), 4)

    def test_refitted_meshes_are_set(self):
        small = rs.Mesh(CORNERS, FACES)
        small.refit(CORNERS * np.float32(0.5))
        self.mesh.refit(CORNERS * np.float32(0.5))
        np.testing.assert_array_equal(self.world.cast(self.rays).t, self.merged([0, 3, 6, 9]).cast(self.rays).t)
        self.world.set_mesh(self.ids, self.mesh)
        other = rs.World()
        for i in range(4):
            other.add(small, shift(3 * i))
        self.assertEqual(self.world.cast(self.rays).hash(), other.cast(self.rays).hash())

    def test_nearest_points_of_instances(self):
        points = self.rays[:, :3]
        near = self.world.nearest(points, want="distance instance")
        np.testing.assert_array_equal(near.distance, self.merged([0, 3, 6, 9]).distance(points))
        self.assertEqual(set(near.instance), {0, 1, 2, 3})

    def test_sums_over_instances(self):
        numbers = np.arange(48, dtype=np.float32)
        expected = self.merged([0, 3, 6, 9]).sum_along(self.rays, attribute=numbers)
        np.testing.assert_array_equal(self.world.sum_along(self.rays, attribute=numbers), expected)
        self.world.set_visible(0, False)
        expected = self.merged([3, 6, 9]).sum_along(self.rays, attribute=numbers[:36])
        np.testing.assert_array_equal(self.world.sum_along(self.rays, attribute=numbers[:36]), expected)
        with self.assertRaisesRegex(ValueError, "48 numbers for 36"):
            self.world.sum_along(self.rays, attribute=numbers)

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
