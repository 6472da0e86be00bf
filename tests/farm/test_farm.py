"""Runs the templates of examples/farm on a small picture: Open Job Description's by its own tool, the others by
stand-ins, which set what Slurm, Kubernetes and Flamenco set. Kubernetes' are also checked against its schemas. Needs
target/release/raystream with the feature service, node, and, beside this Python, what requirements.txt names.
"""

import json
import os
import pathlib
import random
import subprocess
import sys
import tempfile
import unittest

import kubernetes_validate
import yaml

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

    def kubernetes(self, name):
        return yaml.safe_load((TEMPLATES / name).read_text())

    def run_container(self, name, **variables):
        """Runs the command of a template's container, in the folder in place of its volume."""
        [container] = self.kubernetes(name)["spec"]["template"]["spec"]["containers"]
        values = {variable["name"]: variable["value"] for variable in container["env"]}
        self.assertLessEqual(set(variables) - {"JOB_COMPLETION_INDEX"}, set(values))
        return self.run_in_folder(*container["command"], *container["args"], **{**values, **variables})

    def test_kubernetes_takes_its_templates(self):
        for name in ["kubernetes-parts.yaml", "kubernetes-merge.yaml", "kubernetes-workers.yaml"]:
            template = self.kubernetes(name)
            kubernetes_validate.validate(template, "1.37", strict=True)
            with self.assertRaises(kubernetes_validate.ValidationError):
                kubernetes_validate.validate({**template, "spec": {"template": {}, "parts": 8}}, "1.37", strict=True)

    def test_kubernetes_renders_indexed_pods_and_merges_them(self):
        parts = self.kubernetes("kubernetes-parts.yaml")["spec"]
        shared = {"SCENE": str(SCENE), "SPP": "21", "OPTIONS": " ".join(OPTIONS)}
        self.assertEqual((parts["completionMode"], parts["completions"]), ("Indexed", 8))
        for part in random.Random(2).sample(range(8), 8):
            self.run_container("kubernetes-parts.yaml", JOB_COMPLETION_INDEX=str(part), **shared)
        self.run_container("kubernetes-merge.yaml", OUT="merged.npy")
        self.assertEqual((self.folder / "merged.npy").read_bytes(), self.render("whole.npy", "--spp=21"))

    def test_kubernetes_starts_workers_with_options_that_exist(self):
        [container] = self.kubernetes("kubernetes-workers.yaml")["spec"]["template"]["spec"]["containers"]
        command = [word.replace("$(POD)", "pod-1") for word in container["command"]]
        # The arguments before --help are parsed.
        self.assertIn("Usage: raystream worker", self.run_in_folder(*command, "--help"))
        run = subprocess.run([*command, "--nats-keys=a", "--help"], capture_output=True, env=self.environment)
        self.assertEqual(run.returncode, 2)

    def flamenco(self, **settings):
        """Compiles a job and runs its tasks, those first on which others depend. Returns their names."""
        compiler = ROOT / "tests" / "farm" / "flamenco.mjs"
        told = self.run_in_folder("node", compiler, TEMPLATES / "flamenco.js", json.dumps(settings))
        job, done = json.loads(told), []
        for setting in job["settings"]:
            self.assertIn(setting["type"], ["string", "int32"])
        waiting = job["tasks"]
        random.Random(3).shuffle(waiting)
        while waiting:
            task = next(task for task in waiting if set(task["dependencies"]) <= set(done))
            for command in task["commands"]:
                self.assertEqual((command["name"], command["parameters"]["exe"]), ("exec", "{raystream}"))
                self.run_in_folder("raystream", *command["parameters"]["args"])
            waiting.remove(task)
            done.append(task["name"])
        return done

    def test_flamenco_renders_ranges_of_samples_and_merges_them(self):
        settings = {"scene": str(SCENE), "output": "merged.npy", "spp": 21, "parts": 5, "options": " ".join(OPTIONS)}
        done = self.flamenco(**settings)
        self.assertEqual((len(done), done[-1]), (6, "merge"))
        self.assertEqual((self.folder / "merged.npy").read_bytes(), self.render("whole.npy", "--spp=21"))
        self.assertEqual(len(self.flamenco(**{**settings, "spp": 2})), 3)

    def test_flamenco_renders_frames(self):
        options = " ".join([*OPTIONS, "--turntable=3"])
        settings = {"scene": str(SCENE), "output": "a.%d.npy", "spp": 3, "frames": "4-5", "options": options}
        self.assertEqual(sorted(self.flamenco(**settings)), ["frame-4", "frame-5"])
        self.run_in_folder(
            "raystream", "render", SCENE, *OPTIONS, "-o", "b.%d.npy", "--spp=3", "--turntable=3", "--frames=4..6"
        )
        for frame in [4, 5]:
            pictures = [(self.folder / f"{name}.{frame}.npy").read_bytes() for name in "ab"]
            self.assertEqual(*pictures)

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
