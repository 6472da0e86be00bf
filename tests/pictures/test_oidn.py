"""`--denoise oidn` with the library that a wheel brings: less noise, the noisy picture's hash, and clear errors."""

import importlib.util
import json
import os
import pathlib
import platform
import subprocess
import time
import unittest
import unittest.mock

import numpy as np
import OpenEXR
import raystream


def library(package, *names):
    """A file of a package, which is not imported."""
    return pathlib.Path(importlib.util.find_spec(package).origin).parent.joinpath(*names)


SCENE = raystream.ROOT / "scenes" / "cornell.json"
SMALL = ["--size", "160x120", "--tracer", "cpu"]


@unittest.skipUnless(platform.machine() == "x86_64", "the wheels are for one processor")
class Oidn(raystream.Case):
    def setUp(self):
        super().setUp()
        self.oidn = library("pyoidn", "oidn", "lib", "libOpenImageDenoise.so.2")
        self.environment(RAYSTREAM_OIDN="")

    def environment(self, **variables):
        patch = unittest.mock.patch.dict(os.environ, {name: str(value) for name, value in variables.items()})
        self.enterContext(patch)

    def picture(self, output, *options, spp=32, scene=SCENE):
        """Renders the Cornell box; returns what the statistics say of its picture."""
        self.raystream("render", scene, "-o", output, "--spp", spp, "--stats", "stats.json", *SMALL, *options)
        return json.loads((self.folder / "stats.json").read_text())["image"]

    def refused(self, *arguments):
        """What a command says that ends with exit code 2."""
        run = subprocess.run([raystream.PROGRAM, *map(str, arguments)], cwd=self.folder, capture_output=True, text=True)
        self.assertEqual(run.returncode, 2, run.stdout + run.stderr)
        return run.stderr

    def error(self, reference, test):
        said = self.raystream("compare", reference, test, "--metric", "relmse", "--json")
        return json.loads(said)["metrics"]["relmse"]

    def test_error_is_a_fifth_at_most_and_the_noisy_picture_is_kept(self):
        self.picture("reference.exr", "--seed", 7, spp=1024)
        plain = self.picture("plain.exr")
        image = self.picture("oidn.exr", "--denoise", "oidn", "--oidn", self.oidn)
        self.assertEqual(image["hash"], plain["hash"])
        self.assertNotIn(image["denoised_hash"], (None, image["hash"]))
        before, after = self.error("reference.exr", "plain.exr"), self.error("reference.exr", "oidn.exr")
        self.assertLess(after, before / 5, f"{before} before")
        file = self.enterContext(OpenEXR.File(str(self.folder / "oidn.exr"), separate_channels=True))
        header, channels = file.header(), file.channels()
        self.assertRegex(header["raystream/denoiser"], r"^oidn 2\.\d+\.\d+$")
        self.assertEqual(header["raystream/picture_hash"], plain["hash"])
        self.assertEqual(header["raystream/denoised_hash"], image["denoised_hash"])
        noisy = self.enterContext(OpenEXR.File(str(self.folder / "plain.exr"), separate_channels=True)).channels()
        for name in "RGB":
            layer, own = channels[f"noisy.{name}"].pixels, noisy[name].pixels
            self.assertEqual(layer.tobytes(), own.tobytes(), "the layer is the picture without the option")
            self.assertTrue(np.isfinite(channels[name].pixels).all() and (channels[name].pixels >= 0).all())

    def test_library_is_found_by_environment_unless_the_option_names_another(self):
        self.environment(RAYSTREAM_OIDN=self.oidn)
        self.picture("a.png", "--denoise", "oidn", spp=2)
        self.assertIn("nowhere.so", self.refused("render", SCENE, "--denoise", "oidn", "--oidn", "nowhere.so", *SMALL))
        self.environment(RAYSTREAM_OIDN="nowhere.so")
        self.picture("b.png", "--denoise=oidn", "--oidn", self.oidn, spp=2)
        self.picture("c.png", "--denoise", spp=2)

    def test_libraries_that_cannot_be_used_are_refused_before_the_scene_is_read(self):
        (self.folder / "text.so").write_text("no library")
        old = library("oidn", "lib.linux.x64", "libOpenImageDenoise.so.1.4.3")
        (self.folder / "libtbb.so.12").symlink_to(old.parent / "libtbb.so.12.5")
        self.environment(LD_LIBRARY_PATH=self.folder)
        for options, says in [
            (["--oidn", "nowhere.so"], "nowhere.so can be loaded; install Open Image Denoise 2, or name its file with"),
            (["--oidn", "text.so"], "text.so can be loaded"),
            (["--oidn", "libtbb.so.12"], "libtbb.so.12 is not Open Image Denoise"),
            (["--oidn", old], "1.4.3 has version 1, and raystream calls version 2"),
            ([], "no library libOpenImageDenoise.so.2 or libOpenImageDenoise.so can be loaded"),
        ]:
            told = self.refused("render", "no-scene.json", "-o", "x.png", "--denoise", "oidn", *options)
            self.assertIn(says, told)
            self.assertFalse((self.folder / "x.png").exists())
        self.assertIn("ask for true", self.refused("render", SCENE, "--denoise=optix"))

    def test_parts_need_no_library_and_their_sum_does(self):
        whole = self.picture("whole.npz", "--denoise", "oidn", "--oidn", self.oidn, spp=4)
        for name, samples in ("a.rayfilm", "0..2"), ("b.rayfilm", "2..4"):
            self.raystream("render", SCENE, "--spp", 4, "--samples", samples, "--partial", name, "--denoise", "oidn",
                           *SMALL)
        told = self.refused("merge", "a.rayfilm", "b.rayfilm", "-o", "sum.npz")
        self.assertIn("no library", told)
        self.raystream("merge", "a.rayfilm", "b.rayfilm", "-o", "sum.npz", "--oidn", self.oidn, "--stats", "m.json")
        merged = json.loads((self.folder / "m.json").read_text())["image"]
        self.assertEqual(merged["hash"], whole["hash"])
        whole, merged = (np.load(self.folder / name)["image"] for name in ("whole.npz", "sum.npz"))
        self.assertLess(np.abs(whole - merged).max(), 1e-3)

    def test_frames_and_views_are_denoised_each(self):
        self.environment(RAYSTREAM_OIDN=self.oidn)
        self.raystream("render", SCENE, "-o", "%d.exr", "--frames", "0..2", "--turntable", 20, "--spp", 2, *SMALL,
                       "--denoise", "oidn", "--stats", "stats.json")
        self.raystream("render", SCENE, "-o", "view%d.exr", "--views", 2, "--spp", 2, *SMALL, "--denoise", "oidn",
                       "--stats", "views.json")
        for stats in "stats.json", "views.json":
            frames = json.loads((self.folder / stats).read_text())["frames"]
            self.assertEqual(len(frames), 2)
            for frame in frames:
                self.assertNotIn(frame["denoised_hash"], (None, frame["hash"]))

    def test_watched_picture_is_denoised_again_after_an_edit(self):
        shader = "fn pattern(at: Point) -> Finish {{ var f = matte(at); f.colour = vec3({}, 0.4, 0.4); return f; }}\n"
        (self.folder / "grey.wgsl").write_text(shader.format(0.4))
        options = ["--spp", "4", *SMALL, "--denoise", "oidn", "--oidn", self.oidn, "--surface", "white=grey.wgsl"]
        self.raystream("render", SCENE, "-o", "first.npy", *options)
        watch = subprocess.Popen([raystream.PROGRAM, "render", SCENE, "-o", "watched.npy", "--watch", *options],
                                 cwd=self.folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            self.wait_for("first.npy", "watched.npy", watch)
            (self.folder / "grey.wgsl").write_text(shader.format(0.9))
            self.raystream("render", SCENE, "-o", "second.npy", *options)
            self.wait_for("second.npy", "watched.npy", watch)
        finally:
            watch.terminate()
            watch.wait()
        self.assertGreater(np.abs(self.read("first.npy") - self.read("second.npy")).max(), 0.1)

    def read(self, name):
        return np.load(self.folder / name)

    def wait_for(self, expected, watched, process):
        """Waits until a watched picture is what another run has written, but for what OIDN's threads round."""
        expected, until = self.read(expected), time.monotonic() + 60
        while time.monotonic() < until and process.poll() is None:
            path = self.folder / watched
            if path.exists() and np.allclose(self.read(watched), expected, atol=1e-3):
                return
            time.sleep(0.1)
        self.fail(f"{watched} is not the picture that was expected; exit code {process.poll()}")

    def test_service_denoises_where_it_has_the_library_and_answers_anew(self):
        for library in ("nowhere.so", self.oidn):
            serve = ["serve", "--listen", "127.0.0.1:0", "--data", "data", "--tracer", "cpu", "--oidn", library]
            server = subprocess.Popen([raystream.PROGRAM, *map(str, serve)], cwd=self.folder, stdout=subprocess.PIPE,
                                      text=True)
            try:
                address = server.stdout.readline().split("/#token=")[0].strip()
                at = ["--server", address, "--token-file", "data/token"]
                submit = ["submit", SCENE, *at, "--json", "--size", "32x24", "--spp", "2", "--denoise", "oidn"]
                if library != self.oidn:
                    self.assertIn("no library", self.refused(*submit))
                    continue
                jobs = [json.loads(self.raystream(*submit))["id"] for _ in range(2)]
                self.assertNotEqual(*jobs, "each request is a job of its own")
                self.raystream("fetch", jobs[1], *at, "--wait", "-o", "job.exr")
                header = self.enterContext(OpenEXR.File(str(self.folder / "job.exr"))).header()
                self.assertRegex(header["raystream/denoiser"], "^oidn 2")
                self.assertNotEqual(header["raystream/denoised_hash"], header["raystream/picture_hash"])
            finally:
                server.terminate()
                server.wait()
                server.stdout.close()


if __name__ == "__main__":
    unittest.main()
