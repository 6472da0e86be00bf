"""Meshes of files."""

import tempfile
import unittest
from pathlib import Path

import numpy as np
import raystream as rs

CORNERS = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
FACES = [[0, 1, 2], [0, 3, 1]]

FILES = {
    "a.off": "OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 3 1\n",
    "a.obj": "mtllib none.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 4 2\n",
    "a.ply": "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    "0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 3 1\n",
}

FACET = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"


class Load(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def written(self, name, text):
        path = self.folder / name
        path.write_text(text)
        return path

    def test_files_become_meshes(self):
        for name, text in FILES.items():
            mesh = rs.load(self.written(name, text))
            np.testing.assert_array_equal(mesh.vertices, np.float32(CORNERS), name)
            np.testing.assert_array_equal(mesh.faces, FACES, name)
            self.assertEqual(mesh.cast([0.25, 0.25, 2, 0, 0, -1]).t, 2)
            self.assertIsNone(mesh.normals)
        mesh = rs.load(str(self.written("a.stl", f"solid a\n{FACET}endsolid a\n")), threads=1)
        np.testing.assert_array_equal(mesh.vertices, np.float32(CORNERS[:3]))

    def test_normals_of_the_file_are_interpolated(self):
        text = "NOFF\n3 1 0\n0 0 0 0 0 1\n1 0 0 1 0 0\n0 1 0 0 0 1\n3 0 1 2\n"
        mesh = rs.load(self.written("a.off", text))
        hits = mesh.cast([0.5, 0.25, 2, 0, 0, -1], want="normal shading_normal")
        np.testing.assert_allclose(hits.shading_normal, np.full(3, 0.5**0.5) * [1, 0, 1], atol=1e-6)
        np.testing.assert_array_equal(hits.normal, [0, 0, 1])

    def test_warnings_are_logged(self):
        with self.assertLogs("raystream", "WARNING") as logged:
            rs.load(self.written("a.obj", FILES["a.obj"]))
        self.assertIn("none.mtl", "".join(logged.output))

    def test_errors_name_file_and_place(self):
        with self.assertRaisesRegex(FileNotFoundError, "nowhere.ply"):
            rs.load(self.folder / "nowhere.ply")
        with self.assertRaisesRegex(ValueError, "a.obj, line 1: "):
            rs.load(self.written("a.obj", "v 0 0 x\n"))
        with self.assertRaisesRegex(ValueError, "unknown file extension"):
            rs.load(self.written("a.xyz", ""))


if __name__ == "__main__":
    unittest.main()
