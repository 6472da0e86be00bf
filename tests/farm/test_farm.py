"""Runs the templates of examples/farm on a small picture: Open Job Description's by its own tool, Slurm's scripts by a
stand-in, which sets SLURM_ARRAY_TASK_ID as Slurm does. Needs target/release/raystream and, beside this Python, openjd.
"""

import os
import pathlib
import random
import subprocess
import sys
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
TEMPLATES = ROOT / "examples" / "farm"
OPENJD = pathlib.Path(sys.executable).parent / "openjd"
SCENE = ROOT / "scenes" / "cornell.json"
OPTIONS = ["--size", "40x32", "--tracer", "cpu", "--seed", "5"]


class Farm(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))
        path = f"{ROOT / 'target' / 'release'}{os.pathsep}{os.environ['PATH']}"
        self.environment = {**os.environ, "PATH": path}

    def run_in_folder(self, *command, **variables):
        environment = {**self.environment, **variables}
        run = subprocess.run(command, capture_output=True, text=True, cwd=self.folder, env=environment)
        self.assertEqual(run.returncode, 0, run.stdout + run.stderr)
        return run.stdout + run.stderr

    def openjd(self, template, *more, **parameters):
        parameters = [f"--job-param={name}={value}" for name, value in parameters.items()]
        return self.run_in_folder(OPENJD, "run", TEMPLATES / template, *more, *parameters)

    def render(self, name, *more):
        self.run_in_folder("raystream", "render", SCENE, *OPTIONS, "-o", name, *more)
        return (self.folder / name).read_bytes()

    def test_templates_are_valid(self):
        for template in ["openjd.yaml", "openjd-frames.yaml"]:
            self.run_in_folder(OPENJD, "check", TEMPLATES / template)

    def test_openjd_renders_ranges_of_samples_and_merges_them(self):
        told = self.openjd(
            "openjd.yaml",
            "--step=Merge",
            "--run-dependencies",
            Scene=SCENE,
            Output="merged.npy",
            Folder=".",
            Spp=21,
            Options=" ".join(OPTIONS),
        )
        self.assertIn("openjd_progress: 100.0", told)
        self.assertEqual((self.folder / "merged.npy").read_bytes(), self.render("whole.npy", "--spp=21"))

    def test_openjd_renders_frames(self):
        options = " ".join([*OPTIONS, "--spp", "3"])
        self.openjd("openjd-frames.yaml", Scene=SCENE, Folder=".", Frames="4-5", Name="a.%d.npy", Options=options)
        for frame in [4, 5]:
            more = ["--spp=3", "--turntable=3", f"--frames={frame}..{frame + 1}"]
            self.run_in_folder("raystream", "render", SCENE, *OPTIONS, "-o", "b.%d.npy", *more)
            pictures = [(self.folder / f"{name}.{frame}.npy").read_bytes() for name in "ab"]
            self.assertEqual(*pictures)

    def test_slurm_renders_an_array_and_merges_it(self):
        shared = {"SCENE": str(SCENE), "SPP": "21", "PARTS": "5", "OPTIONS": " ".join(OPTIONS), "OUT": "merged.npy"}
        parts = list(range(5))
        random.Random(1).shuffle(parts)
        for part in parts:
            self.run_in_folder("bash", TEMPLATES / "slurm-part.sh", SLURM_ARRAY_TASK_ID=str(part), **shared)
        # A task that is requeued after its end finds nothing to do.
        self.run_in_folder("bash", TEMPLATES / "slurm-part.sh", SLURM_ARRAY_TASK_ID="3", **shared)
        self.run_in_folder("bash", TEMPLATES / "slurm-merge.sh", **shared)
        self.assertEqual((self.folder / "merged.npy").read_bytes(), self.render("whole.npy", "--spp=21"))

    def test_a_task_that_cannot_run_says_why(self):
        command = [OPENJD, "run", TEMPLATES / "openjd.yaml", "--step=Render", "--maximum-tasks=1"]
        parameters = {"Scene": "missing.glb", "Output": "a.npy", "Folder": "."}
        command += [f"--job-param={name}={value}" for name, value in parameters.items()]
        run = subprocess.run(command, capture_output=True, text=True, cwd=self.folder, env=self.environment)
        self.assertNotEqual(run.returncode, 0)
        self.assertIn("openjd_fail: ", run.stdout + run.stderr)
        self.assertIn("missing.glb", run.stdout + run.stderr)


if __name__ == "__main__":
    unittest.main()
