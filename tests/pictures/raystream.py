"""Runs raystream in a temporary folder."""

import os
import pathlib
import subprocess
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = os.environ.get("RAYSTREAM", ROOT / "target" / "release" / "raystream")

# Two matte squares side by side in front of a third that is half as large and farther away.
SCENE = """mtllib m.mtl
v -2 -1 0\nv 0 -1 0\nv 0 1 0\nv -2 1 0
v 2 -1 0\nv 2 1 0
v -1 1 -2\nv 1 1 -2\nv 1 3 -2\nv -1 3 -2
vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1
o left\nusemtl red\nf 1/1 2/2 3/3 4/4
o right\nusemtl green\nf 2/1 5/2 6/3 3/4
o behind\nusemtl red\nf 7/1 8/2 9/3 10/4
"""
MATERIALS = "newmtl red\nKd 0.8 0.1 0.1\nnewmtl green\nKd 0.1 0.8 0.1\n"
VIEW = ["--eye", "0.3,0.4,6", "--target", "0,0.5,0", "--fov", "50", "--size", "48x32", "--env", "1,0.9,0.8"]


class Case(unittest.TestCase):
    """A test with a folder, in which the scene lies."""

    def setUp(self):
        self.folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))
        (self.folder / "scene.obj").write_text(SCENE)
        (self.folder / "m.mtl").write_text(MATERIALS)

    def raystream(self, *arguments, code=0):
        """What a command prints; it must end with this exit code."""
        run = subprocess.run([PROGRAM, *map(str, arguments)], cwd=self.folder, capture_output=True, text=True)
        self.assertEqual(run.returncode, code, run.stdout + run.stderr)
        return run.stdout

    def render(self, output, *options, spp=16):
        self.raystream("render", "scene.obj", "-o", output, "--spp", spp, "--tracer", "cpu", *VIEW, *options)
        return self.folder / output
