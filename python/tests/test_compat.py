"""Stand-ins for other libraries, by what their users expect. Each is installed in a process of its own."""

import os
import subprocess
import sys
import unittest
import warnings

import numpy as np
import raystream as rs
from raystream.compat import _parity
from raystream.compat.open3d import RaycastingScene
from shapes import CORNERS, FACES

HERE = os.path.dirname(os.path.abspath(__file__))


def in_a_process(program):
    """Runs a program that has the tests' shapes."""
    program = f"import sys\nsys.path.insert(0, {HERE!r})\nimport numpy as np\n{program}"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    if result.returncode:
        raise AssertionError(result.stderr)
    return result.stdout


class Embreex(unittest.TestCase):
    def test_what_its_tests_mean_to_assert(self):
        in_a_process(
            """
import raystream.compat.embreex
raystream.compat.embreex.install()
from embreex import rtcore, rtcore_scene
from embreex.mesh_construction import ElementMesh, TriangleMesh

square = np.array([[7, -1, -1], [7, 1, -1], [7, -1, 1], [7, 1, 1]], np.float32)
origins = np.array([[0.1, -0.2, 0], [0.1, 0.2, 0], [0.1, 0.3, 0], [0.1, -8.2, 0]], np.float32)
directions = np.tile(np.float32([1, 0, 0]), (4, 1))
for corners in ((square, np.array([[0, 1, 2], [1, 3, 2]], np.uint32)), (square[[[0, 1, 2], [1, 3, 2]]],)):
    scene = rtcore_scene.EmbreeScene(rtcore.EmbreeDevice())
    TriangleMesh(scene, *corners)
    assert scene.run(origins, directions).tolist() == [0, 1, 1, -1]
    np.testing.assert_allclose(scene.run(origins, directions, query="DISTANCE"), [6.9, 6.9, 6.9, 1e37], rtol=1e-6)
    assert scene.run(origins, directions, query="OCCLUDED").tolist() == [0, 0, 0, -1]
    hits = scene.run(origins, directions, output=1, dists=100)
    assert hits["geomID"].tolist() == [0, 0, 0, -1] and hits["primID"].tolist() == [0, 1, 1, -1]
    np.testing.assert_allclose(hits["tfar"], [6.9, 6.9, 6.9, 100], rtol=1e-6)
    np.testing.assert_allclose(hits["u"][:3], [0.4, 0.1, 0.15], atol=1e-6)
    np.testing.assert_allclose(hits["v"][:3], [0.5, 0.4, 0.35], atol=1e-6)
    assert scene.run(origins, directions[:1]).tolist() == [0, 1, 1, -1]

cube = [[1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 0], [1, 0, 1], [1, 1, 1], [0, 1, 1], [0, 0, 1]]
tetrahedron = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
for corners, origins, element, v in (
    (cube, [[-0.1, 0.9, 0.1], [-0.1, 0.8, 0.2]], 10, [0.8, 0.6]),
    (tetrahedron, [[-0.1, 0.1, 0.1], [-0.1, 0.2, 0.2]], 2, [0.1, 0.2]),
):
    scene = rtcore_scene.EmbreeScene()
    ElementMesh(scene, np.array(corners, np.float32), np.arange(len(corners), dtype=np.uint32)[None])
    hits = scene.run(np.array(origins, np.float32), directions[:2], output=1)
    assert hits["primID"].tolist() == [element] * 2
    np.testing.assert_allclose(hits["u"], [0.1, 0.2], atol=1e-6)
    np.testing.assert_allclose(hits["v"], v, atol=1e-6)
    np.testing.assert_allclose(hits["Ng"], [[-1, 0, 0]] * 2)
"""
        )

    def test_geometries_are_told_apart(self):
        in_a_process(
            """
from raystream.compat.embreex import EmbreeScene, TriangleMesh
from shapes import CORNERS, FACES
scene = EmbreeScene()
for x in (0, 3):
    TriangleMesh(scene, CORNERS + np.float32([x, 0, 0]), FACES)
hits = scene.run(np.float32([[3.5, 0.25, 5], [0.5, 0.25, 5]]), np.float32([[0, 0, -1]]), output=1)
assert hits["geomID"].tolist() == [1, 0] and (hits["primID"] < 12).all(), hits
"""
        )


class Open3d(unittest.TestCase):
    """Without Open3D answers are arrays of NumPy."""

    def setUp(self):
        self.scene = RaycastingScene()
        self.scene.add_triangles(CORNERS, FACES.astype(np.uint32))

    def test_rays(self):
        rays = np.float32([[0.5, 0.5, -1, 0, 0, 1], [0.5, 0.5, 0.5, 0, 0, 1], [10, 10, 10, 1, 0, 0]])
        hits = self.scene.cast_rays(rays)
        self.assertEqual(hits["t_hit"].tolist(), [1, 0.5, np.inf])
        self.assertEqual(hits["geometry_ids"].tolist(), [0, 0, RaycastingScene.INVALID_ID])
        self.assertEqual(hits["primitive_ids"][2], RaycastingScene.INVALID_ID)
        self.assertEqual(hits["primitive_normals"].tolist(), [[0, 0, -1], [0, 0, 1], [0, 0, 0]])
        self.assertEqual(self.scene.count_intersections(rays).tolist(), [2, 1, 0])
        self.assertEqual(self.scene.test_occlusions(rays, tfar=0.75).tolist(), [False, True, False])
        lists = self.scene.list_intersections(rays)
        self.assertEqual(lists["ray_splits"].tolist(), [0, 2, 3, 3])
        self.assertEqual(lists["ray_ids"].tolist(), [0, 0, 1])
        self.assertEqual(lists["t_hit"].tolist(), [1, 2, 0.5])

    def test_points(self):
        points = np.float32([[0.5, 0.5, 0.5], [-0.5, -0.5, -0.5], [0, 0, 0]])
        np.testing.assert_allclose(self.scene.compute_distance(points), [0.5, 0.75**0.5, 0])
        np.testing.assert_allclose(self.scene.compute_signed_distance(points), [-0.5, 0.75**0.5, 0])
        self.assertEqual(self.scene.compute_occupancy(points[:2]).tolist(), [1, 0])
        near = self.scene.compute_closest_points(np.float32([[0.25, 0.5, 3]]))
        self.assertEqual(near["points"].tolist(), [[0.25, 0.5, 1]])
        self.assertEqual(near["primitive_normals"].tolist(), [[0, 0, 1]])

    def test_occupancy_at_corners_needs_no_votes(self):
        # Rays of these points run through corners and edges of the cube.
        grid = np.stack(np.meshgrid(*[np.linspace(-0.5, 1.5, 9)] * 3), axis=-1).astype(np.float32)
        inside = ((grid >= 0) & (grid <= 1)).all(axis=-1)
        np.testing.assert_array_equal(self.scene.compute_occupancy(grid), inside)
        np.testing.assert_array_equal(self.scene.compute_occupancy(grid, nsamples=3), inside)

    def test_cameras(self):
        rays = RaycastingScene.create_rays_pinhole(
            fov_deg=90, center=[0, 0, 0], eye=[0, 0, -2], up=[0, -1, 0], width_px=4, height_px=2
        )
        self.assertEqual(rays.shape, (2, 4, 6))
        np.testing.assert_allclose(rays[0, 0], [0, 0, -2, 0.75, 0.25, 1], atol=1e-6)
        same = RaycastingScene.create_rays_pinhole(90, [0, 0, 0], [0, 0, -2], [0, -1, 0], 4, 2)
        np.testing.assert_array_equal(rays, same)


class Parity(unittest.TestCase):
    def test_open_meshes_are_judged_with_one_warning(self):
        mesh = rs.Mesh(CORNERS, FACES[:-1])
        _parity._warned = False
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            for _ in range(2):
                _parity.contains(mesh, [[0.5, 0.5, 0.5]])
        self.assertEqual(len(caught), 1)
        self.assertIn("3 open edges", str(caught[0].message))


class Trimesh(unittest.TestCase):
    def setUp(self):
        try:
            import trimesh  # noqa: F401
        except ImportError:
            self.skipTest("trimesh is not installed")

    PREFACE = """
import raystream.compat.trimesh
raystream.compat.trimesh.install()
import trimesh
"""

    def test_rays_through_corners_hit_once(self):
        in_a_process(
            self.PREFACE
            + """
for use_embree in (True, False):
    box = trimesh.creation.box(use_embree=use_embree)
    assert type(box.ray) is raystream.compat.trimesh.RayMeshIntersector
    origins, vectors = np.zeros_like(box.vertices), box.vertices.copy()
    assert box.ray.intersects_any(origins, vectors).all()
    _, index_ray, _ = box.ray.intersects_location(origins, vectors)
    assert (np.bincount(index_ray, minlength=8) == 1).all()
"""
        )

    def test_large_coordinates(self):
        in_a_process(
            self.PREFACE
            + """
# A wall at the coordinates of a city, and a ray that starts a centimetre before it and leaves.
ends = np.array([[528980.85, 183526.1], [528982.3, 183523.55]])
corners = np.array([[*end, z] for end in ends for z in (0, 3)])
wall = trimesh.Trimesh(corners, [[1, 0, 2], [1, 2, 3]], process=False)
normal = trimesh.unitize(np.cross(corners[1] - corners[0], corners[2] - corners[0]))
middle = corners.mean(axis=0)
for distance in (0.01, 1e-4):
    origin = middle + distance * normal
    assert not wall.ray.intersects_any([origin], [normal])[0]
    assert wall.ray.intersects_any([origin], [-normal])[0]
"""
        )

    def test_inside_and_distances(self):
        in_a_process(
            self.PREFACE
            + """
box = trimesh.creation.box()
points = np.array([[0, 0, 0], [0.5, 0.5, 0.5], [0.75, 0, 0], [0.4, 0.1, 0]])
assert box.contains(points).tolist() == [True, True, False, True]
np.testing.assert_allclose(trimesh.proximity.signed_distance(box, points), [0.5, 0, -0.25, 0.1], atol=1e-12)
closest, distance, triangle = box.nearest.on_surface(points)
np.testing.assert_allclose(closest[2], [0.5, 0, 0])
np.testing.assert_allclose(box.face_normals[triangle[2]], [1, 0, 0])
box.apply_translation([10, 0, 0])
assert box.contains(points + [10, 0, 0]).tolist() == [True, True, False, True]
assert not box.contains(points).any()
"""
        )

    def test_hits_at_the_origin_count(self):
        in_a_process(
            self.PREFACE
            + """
for scale in (1e-4, 0.1, 1.0, 10, 1e4, 1e8):
    box = trimesh.creation.box().subdivide()
    box.apply_scale(scale)
    triangles, _ = box.ray.intersects_id([[0, 0, scale / 2]], [[0, 0, -1]])
    assert len(triangles) == 2, scale
"""
        )


if __name__ == "__main__":
    unittest.main()
