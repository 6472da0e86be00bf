"""Rays: first hits, occlusion, counts, lists, sums."""

import pickle
import unittest

import numpy as np
import raystream as rs
from shapes import CORNERS, FACES, icosphere, rays


class Triangle(unittest.TestCase):
    def setUp(self):
        corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
        self.mesh = rs.Mesh(corners, [[0, 1, 2]], [7.5], normals=[[0, 0, 1], [0, 1, 0], [1, 0, 0]])
        self.down = np.array([[0.25, 0.5, 2, 0, 0, -2], [3, 3, 2, 0, 0, -1]], np.float32)

    def test_all_columns_of_a_hit_and_a_miss(self):
        want = "t primitive instance uv normal shading_normal position position64 attribute"
        hits = self.mesh.cast(self.down, want=want)
        self.assertEqual(list(hits), want.split())
        self.assertEqual(hits.t.tolist(), [1.0, np.inf])
        self.assertEqual(hits.primitive.tolist(), [0, -1])
        self.assertEqual(hits.instance.tolist(), [0, -1])
        self.assertEqual(hits.uv.tolist(), [[0.25, 0.5], [0, 0]])
        self.assertEqual(hits.normal.tolist(), [[0, 0, 1], [0, 0, 0]])
        self.assertEqual(hits.position[0].tolist(), [0.25, 0.5, 0])
        self.assertTrue(np.isnan(hits.position[1]).all() and np.isnan(hits.position64[1]).all())
        self.assertEqual(hits.attribute[0], 7.5)
        expected = np.array([0.5, 0.25, 0.25]) / np.linalg.norm([0.5, 0.25, 0.25])
        np.testing.assert_allclose(hits.shading_normal, [expected, [0, 0, 0]], atol=1e-6)
        self.assertEqual(hits.hit.tolist(), [True, False])

    def test_only_wanted_columns_are_there(self):
        hits = self.mesh.cast(self.down, want=["normal"])
        self.assertEqual(hits.keys(), ["normal"])
        with self.assertRaisesRegex(AttributeError, "no column \"t\""):
            hits.t
        with self.assertRaises(KeyError):
            hits["t"]
        with self.assertRaisesRegex(ValueError, "no column \"depth\".*t, primitive"):
            self.mesh.cast(self.down, want="depth")
        with self.assertRaisesRegex(ValueError, "names no column"):
            self.mesh.cast(self.down, want="")

    def test_columns_that_a_mesh_lacks_are_refused(self):
        bare = rs.Mesh(CORNERS, FACES)
        for column in ("attribute", "shading_normal"):
            with self.assertRaisesRegex(ValueError, "the mesh has no"):
                bare.cast(self.down, want=column)

    def test_t_is_in_lengths_of_the_direction(self):
        for length in (0.5, 1.0, 4.0):
            self.assertEqual(float(self.mesh.cast([0.25, 0.5, 2.0], [0, 0, -length]).t), 2 / length)

    def test_intervals_are_closed_and_may_be_arrays(self):
        row = np.array([0.25, 0.5, 2, 0, 0, -1], np.float32)
        self.assertTrue(self.mesh.occluded(row, t_max=2.0))
        self.assertTrue(self.mesh.occluded(row, t_min=2.0))
        self.assertFalse(self.mesh.occluded(row, t_max=1.9999))
        ends = np.array([1.0, 2.0, 3.0], np.float32)
        np.testing.assert_array_equal(self.mesh.occluded(np.tile(row, (3, 1)), t_max=ends), [False, True, True])
        np.testing.assert_array_equal(self.mesh.cast(np.tile(row, (3, 1)), t_min=ends).t, [2, 2, np.inf])

    def test_points_that_see_each_other(self):
        above, below = [0.2, 0.2, 1.0], [[0.2, 0.2, -1.0], [0.9, 0.9, -1.0], [0.2, 0.2, 0.0]]
        np.testing.assert_array_equal(self.mesh.visible(above, below), [False, True, True])

    def test_rays_that_are_none_miss_and_are_counted(self):
        broken = np.array([self.down[0]] * 4)
        broken[1, 0], broken[2, 3:], broken[3, 4] = np.nan, 0, np.inf
        np.testing.assert_array_equal(self.mesh.cast(broken).primitive, [0, -1, -1, -1])
        with self.assertRaisesRegex(ValueError, "3 of 4 rays .* ray 1"):
            self.mesh.cast(broken, check=True)
        self.mesh.cast(self.down, check=True)


class Counting(unittest.TestCase):
    def test_rays_through_corners_and_edges_cross_a_cube_twice(self):
        mesh = rs.Mesh(CORNERS, FACES)
        rng = np.random.default_rng(1)
        targets = [CORNERS[rng.integers(0, 8, 3000)]]
        ends = CORNERS[FACES[rng.integers(0, 12, 3000)]]
        share = rng.random((3000, 1), np.float32)
        targets.append(ends[:, 0] * share + ends[:, 1] * (1 - share))
        for scale in (1e-6, 1.0, 1e6):
            scaled = rs.Mesh(CORNERS * np.float32(scale), FACES)
            for target in targets:
                outside = rng.normal(size=target.shape) * 5 * scale + 0.5
                inside = (0.2 + 0.6 * rng.random(target.shape)) * scale
                parity = scaled.contains(outside).astype(int)
                for origins, odd in ((outside, parity), (inside, 1)):
                    origins = origins.astype(np.float32)
                    directions = (target * np.float32(scale) - origins).astype(np.float32)
                    wrong = (scaled.count(origins, directions) + odd) % 2
                    self.assertEqual(int(wrong.sum()), 0, scale)
        self.assertEqual(int(mesh.count([0.5, 0.5, 2, 0, 0, -1])), 2)

    def test_a_ray_may_hit_where_the_count_is_0(self):
        mesh = rs.Mesh(CORNERS, FACES)
        touching = [[-1, y, 1, 1, 0, 0] for y in (0.25, 0.5, 1)] + [[2, -1, 1, -1, 1, 0]]
        hits = mesh.cast(touching).hit
        count = mesh.count(touching)
        self.assertTrue(hits.any() and (count % 2 == 0).all(), (hits, count))
        self.assertTrue((hits & (count == 0)).any(), (hits, count))

    def test_lists_are_sorted_and_as_long_as_counts(self):
        vertices, faces = icosphere(2)
        mesh = rs.Mesh(vertices, faces)
        question = rays(5000)
        lists, count = mesh.all_hits(question, want="t primitive uv instance"), mesh.count(question)
        np.testing.assert_array_equal(np.diff(lists.offsets), count)
        np.testing.assert_array_equal(lists.ray, np.repeat(np.arange(5000), count))
        self.assertTrue("ray" in lists and lists.ray is lists["ray"] and lists.ray.dtype == np.int64)
        self.assertEqual([*lists.keys()], ["offsets", "ray", "t", "primitive", "instance", "uv"])
        self.assertEqual(pickle.loads(pickle.dumps(lists)).hash(), lists.hash())
        self.assertTrue((np.diff(lists.t)[np.diff(lists.ray) == 0] >= 0).all())
        first = mesh.cast(question, rule="half-open")
        np.testing.assert_array_equal(lists.t[lists.offsets[:-1][count > 0]], first.t[count > 0])
        nearest = mesh.all_hits(question, max_hits=1)
        np.testing.assert_array_equal(np.diff(nearest.offsets), np.minimum(count, 1))
        np.testing.assert_array_equal(mesh.at_least(2, question), count >= 2)

    def test_sums_along_rays(self):
        vertices, faces = icosphere(2)
        numbers = np.random.default_rng(2).normal(size=len(faces)).astype(np.float32)
        mesh = rs.Mesh(vertices, faces, numbers)
        question = rays(2000)
        lists = mesh.all_hits(question)
        expected = np.zeros(2000)
        np.add.at(expected, lists.ray, numbers[lists.primitive].astype(np.float64))
        np.testing.assert_array_equal(mesh.sum_along(question), expected.astype(np.float32))
        np.testing.assert_array_equal(mesh.sum_along(question, attribute=numbers * 2), mesh.sum_along(question) * 2)
        with self.assertRaisesRegex(ValueError, "3 numbers for 320"):
            mesh.sum_along(question, attribute=[1, 2, 3])

    def test_rules_have_names(self):
        with self.assertRaisesRegex(ValueError, "\"closed\" or \"half-open\""):
            rs.Mesh(CORNERS, FACES).cast([0] * 6, rule="open")


class Answers(unittest.TestCase):
    def test_the_same_bytes_for_any_number_of_threads(self):
        vertices, faces = icosphere(4)
        mesh, question = rs.Mesh(vertices, faces), rays(200_000)
        hashes = {mesh.cast(question, want="t primitive uv normal", threads=threads).hash() for threads in (1, 2, 5)}
        self.assertEqual(len(hashes), 1)
        for name in ("occluded", "count"):
            one, two = (getattr(mesh, name)(question, threads=threads) for threads in (1, 3))
            np.testing.assert_array_equal(one, two)

    def test_hashes_tell_answers_apart(self):
        mesh = rs.Mesh(CORNERS, FACES)
        question = rays(100)
        hits = mesh.cast(question)
        self.assertEqual(hits.hash(), mesh.cast(question).hash())
        self.assertNotEqual(hits.hash(), mesh.cast(question[::-1]).hash())
        self.assertNotEqual(hits.hash(), mesh.cast(question.reshape(10, 10, 6)).hash())
        self.assertNotEqual(hits.hash(), mesh.cast(question, want="t").hash())

    def test_a_refitted_mesh_answers_as_a_new_one(self):
        vertices, faces = icosphere(2)
        mesh, question = rs.Mesh(vertices, faces), rays(3000)
        moved = vertices * np.float32(1.5)
        before = mesh.cast(question).hash()
        mesh.refit(moved)
        self.assertEqual(mesh.cast(question).hash(), rs.Mesh(moved, faces).cast(question).hash())
        self.assertNotEqual(mesh.cast(question).hash(), before)
        np.testing.assert_array_equal(mesh.vertices, moved)
        with self.assertRaisesRegex(ValueError, "make a new one"):
            mesh.refit(moved[:-1])
        with self.assertRaisesRegex(ValueError, "vertex 5 .*NaN"):
            broken = moved.copy()
            broken[5, 1] = np.nan
            mesh.refit(broken)
        self.assertEqual(mesh.cast(question).hash(), rs.Mesh(moved, faces).cast(question).hash())

    def test_float64_vertices_are_refitted_around_their_new_middle(self):
        vertices, faces = icosphere(2)
        mesh, question, want = rs.Mesh(vertices, faces), rays(3000).astype(np.float64), "t primitive uv position64"
        for far in ([4e6, -3e6, 2e6], [0, 0, 0], [-7e9, 1e3, 0.1]):
            moved = vertices.astype(np.float64) * [1, 2, 1.5] + far
            asked = np.c_[question[:, :3] + far, question[:, 3:]]
            mesh.refit(moved)
            fresh = rs.Mesh(moved, faces)
            hits = mesh.cast(asked, want=want)
            self.assertEqual(hits.hash(), fresh.cast(asked, want=want).hash())
            self.assertGreater(hits.hit.mean(), 0.1)
            points = moved[:50] + 0.25
            self.assertEqual(mesh.signed_distance(points).tobytes(), fresh.signed_distance(points).tobytes())
            self.assertEqual((mesh.vertices.dtype, mesh.is_closed), (np.float64, True))
        with self.assertRaisesRegex(ValueError, "vertex 5 .*NaN"):
            mesh.refit(np.where(np.arange(len(moved))[:, None] == 5, np.nan, moved))
        self.assertEqual(mesh.cast(asked, want=want).hash(), hits.hash())
        mesh.refit(vertices)
        self.assertEqual(mesh.cast(question).hash(), rs.Mesh(vertices, faces).cast(question).hash())


if __name__ == "__main__":
    unittest.main()
