"""What arguments may be, and what becomes of them."""

import tracemalloc
import unittest

import numpy as np
import raystream as rs
from shapes import CORNERS, FACES, rays


class Foreign:
    """An array of another library, which speaks DLPack and nothing else."""

    def __init__(self, array):
        self._array = array

    def __dlpack__(self, **keywords):
        return self._array.__dlpack__(**keywords)

    def __dlpack_device__(self):
        return self._array.__dlpack_device__()


class Arguments(unittest.TestCase):
    def setUp(self):
        self.mesh = rs.Mesh(CORNERS, FACES)
        self.rays = rays(60)
        self.expected = self.mesh.cast(self.rays).t

    def test_any_leading_shape(self):
        for shape in ((60,), (6, 10), (3, 4, 5), (1, 60, 1)):
            hits = self.mesh.cast(self.rays.reshape(*shape, 6), want="t normal")
            self.assertEqual(hits.t.shape, shape)
            self.assertEqual(hits.normal.shape, (*shape, 3))
            np.testing.assert_array_equal(hits.t.ravel(), self.expected)
        self.assertEqual(self.mesh.cast(self.rays[0]).t.shape, ())
        self.assertEqual(self.mesh.cast(np.zeros((0, 6), np.float32)).t.shape, (0,))
        self.assertEqual(self.mesh.count(np.zeros((2, 0, 6), np.float32)).shape, (2, 0))

    def test_origins_and_directions_broadcast(self):
        origins, directions = self.rays[:, :3], self.rays[:, 3:]
        np.testing.assert_array_equal(self.mesh.cast(origins, directions).t, self.expected)
        one = self.mesh.cast([0.5, 0.5, 3], directions).t
        np.testing.assert_array_equal(one, self.mesh.cast(np.tile([0.5, 0.5, 3], (60, 1)), directions).t)
        table = self.mesh.cast(origins[:, None], directions[None])
        self.assertEqual(table.t.shape, (60, 60))
        np.testing.assert_array_equal(np.diagonal(table.t), self.expected)

    def test_other_kinds_are_converted(self):
        for other in (
            self.rays.astype(np.float64),
            np.asfortranarray(self.rays),
            self.rays.tolist(),
            np.repeat(self.rays, 2, axis=0)[::2],
            Foreign(self.rays),
            self.rays.astype(">f4"),
        ):
            np.testing.assert_array_equal(self.mesh.cast(other).t, self.expected)
        half = self.rays.astype(np.float16)
        np.testing.assert_array_equal(self.mesh.cast(half).t, self.mesh.cast(half.astype(np.float32)).t)

    def test_contiguous_float32_is_not_copied(self):
        many = np.tile(self.rays, (10_000, 1))
        out = self.mesh.cast(many)
        self.mesh.cast(many, out=out)
        tracemalloc.start()
        self.mesh.cast(many, out=out)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        self.assertLess(peak, many.nbytes / 100)

    def test_wrong_shapes_are_named(self):
        cases = [
            (lambda: self.mesh.cast(np.zeros((4, 5))), r"rays without directions have the shape \[4, 5\]"),
            (lambda: self.mesh.cast(np.zeros((4, 3)), np.zeros((5, 3))), "broadcast"),
            (lambda: self.mesh.cast(np.zeros((4, 3)), np.zeros((4, 2))), "directions have the shape"),
            (lambda: self.mesh.distance(np.zeros(2)), "points have the shape"),
            (lambda: self.mesh.cast(self.rays, t_max=np.zeros(7)), "t_max"),
            (lambda: self.mesh.cast("rays"), "rays"),
            (lambda: rs.Mesh(np.zeros((3, 2)), FACES), "vertices have the shape"),
            (lambda: rs.Mesh(CORNERS), r"must be \(f, 3, 3\)"),
            (lambda: rs.Mesh(CORNERS, FACES, [1.0]), "attributes have the shape"),
            (lambda: self.mesh.cast(self.rays, threads=0), "threads must be"),
        ]
        for call, message in cases:
            with self.assertRaisesRegex(ValueError, message):
                call()

    def test_defects_of_meshes_are_named(self):
        broken = CORNERS.copy()
        broken[6, 2] = np.inf
        with self.assertRaisesRegex(ValueError, "vertex 6"):
            rs.Mesh(broken, FACES)
        broken = CORNERS.astype(np.float64) + 5000
        broken[3] = 5001, np.nan, 5002
        with self.assertRaisesRegex(ValueError, r"vertex 3 is at \[5001, NaN, 5002\]"):
            rs.Mesh(broken, FACES)
        for faces, message in (([[0, 1, 8]], "triangle 0 names vertex 8"), ([[0, 1, -1]], "vertex -1")):
            with self.assertRaisesRegex(ValueError, message):
                rs.Mesh(CORNERS, faces)
        with self.assertRaisesRegex(TypeError, "faces must be integers"):
            rs.Mesh(CORNERS, [[0.0, 1.0, 2.0]])

    def test_corners_of_triangles_are_a_mesh(self):
        soup = rs.Mesh(CORNERS[FACES])
        np.testing.assert_array_equal(soup.cast(self.rays).t, self.expected)
        self.assertTrue(soup.is_closed)
        self.assertEqual(rs.Mesh(np.zeros((0, 3)), np.zeros((0, 3), int)).triangle_count, 0)

    def test_float64_far_from_the_origin(self):
        far = np.array([4e6, 5e6, -3e6])
        mesh = rs.Mesh(CORNERS.astype(np.float64) + far, FACES)
        moved = self.rays.astype(np.float64)
        moved[:, :3] += far
        np.testing.assert_allclose(mesh.cast(moved).t, self.expected, rtol=1e-5)
        position = mesh.cast(moved, want="position64 t")
        hit = np.isfinite(position.t)
        t = position.t[hit, None].astype(np.float64)
        np.testing.assert_allclose(position.position64[hit], moved[hit, :3] + t * moved[hit, 3:], atol=1e-5)
        self.assertTrue(mesh.contains(far + 0.5))


class Outputs(unittest.TestCase):
    def setUp(self):
        self.mesh, self.rays = rs.Mesh(CORNERS, FACES), rays(50)

    def test_answers_go_where_they_are_told(self):
        out = {"t": np.zeros(50, np.float32), "uv": np.zeros((50, 2), np.float32)}
        hits = self.mesh.cast(self.rays, want="t uv primitive", out=out)
        self.assertIs(hits.t, out["t"])
        self.assertIs(hits.uv, out["uv"])
        np.testing.assert_array_equal(out["t"], self.mesh.cast(self.rays).t)
        again = self.mesh.cast(self.rays[::-1], want="t uv primitive", out=hits)
        self.assertIs(again.t, out["t"])
        flags = np.zeros(50, bool)
        self.assertIs(self.mesh.occluded(self.rays, out=flags), flags)
        np.testing.assert_array_equal(flags, self.mesh.occluded(self.rays))

    def test_unfit_outputs_are_refused(self):
        for array in (np.zeros(49, np.float32), np.zeros(50), np.zeros(100, np.float32)[::2], [0.0] * 50):
            with self.assertRaisesRegex((ValueError, TypeError), "out: t must be"):
                self.mesh.cast(self.rays, out={"t": array})
        locked = np.zeros(50, np.float32)
        locked.flags.writeable = False
        with self.assertRaisesRegex(ValueError, "out: t must be"):
            self.mesh.cast(self.rays, out={"t": locked})
        with self.assertRaises(TypeError):
            self.mesh.cast(self.rays, out=3)

    def test_answers_that_do_not_fit_are_refused_before_work(self):
        row = np.broadcast_to(np.float32(0.5), (3,))
        for call in (
            lambda: self.mesh.cast(np.broadcast_to(row, (1 << 40, 3)), [0, 0, 1]),
            lambda: self.mesh.distance(np.broadcast_to(row, (1 << 40, 3))),
        ):
            with self.assertRaises(MemoryError):
                call()


if __name__ == "__main__":
    unittest.main()
