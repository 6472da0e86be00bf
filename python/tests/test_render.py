"""Pictures: the same as everywhere, arrays, files, errors, progress, interrupts."""

import contextlib
import io
import json
import logging
import os
import pickle
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import zlib
from pathlib import Path

import numpy as np
import raystream as rs
from shapes import icosphere

CHECKOUT = Path(__file__).resolve().parents[2]
CORNELL = CHECKOUT / "scenes" / "cornell.json"
# raystream render scenes/cornell.json --size 64x48 --spp 8 --max-bounces 4 --seed 7 --aov depth,normal,object
# tells these hashes.
SPEC = {"size": [64, 48], "spp": 8, "max-bounces": 4, "seed": 7, "aov": ["depth", "normal", "object"]}
HASH = "05ed8baea32ffd89"
LAYERS = {"depth": "ffdbbf29dfe77427", "normal": "c9a51f755dbf5569", "object": "a0a496978d65a4ff"}
LARGE = "depth,z,normal,shading-normal,position,albedo,uv,emission,object,material,instance,primitive,variance"
BALL = rs.Mesh(*icosphere(3))


def sized(**more):
    """A small and quick spec, as keywords."""
    return {"size": (40, 30), "spp": 4, "max_bounces": 2, "env": "1,1,1", **more}


class Pictures(unittest.TestCase):
    def test_a_spec_has_the_hash_that_the_program_prints(self):
        for threads in (1, 3, None):
            picture = rs.render({"scene": str(CORNELL), **SPEC}, threads=threads)
            self.assertEqual((picture.hash(), picture.layer_hashes()), (HASH, LAYERS), threads)

    def test_paths_keywords_files_and_dictionaries_are_one_spec(self):
        keywords = {key.replace("-", "_"): value for key, value in SPEC.items()}
        numbers = {**keywords, "size": np.array([64, 48]), "spp": np.int64(8), "aov": "depth,normal,object"}
        self.assertEqual(rs.render(CORNELL, **keywords).hash(), HASH)
        self.assertEqual(rs.render(str(CORNELL), **numbers).hash(), HASH)
        with tempfile.TemporaryDirectory() as folder:
            shutil.copy(CORNELL, folder)
            file = Path(folder) / "spec.json"
            file.write_text(json.dumps({"scene": "cornell.json", **SPEC, "seed": 8}))
            self.assertEqual(rs.render(options=file, seed=7).hash(), HASH)
            self.assertNotEqual(rs.render(options=str(file)).hash(), HASH)
            self.assertEqual(rs.render({"seed": 7}, options=file, seed=None).hash(), HASH)

    @unittest.skipUnless(os.environ.get("RAYSTREAM_PROGRAM"), "RAYSTREAM_PROGRAM names no program")
    def test_the_program_renders_the_same_spec(self):
        program = os.environ["RAYSTREAM_PROGRAM"]
        with tempfile.TemporaryDirectory() as folder:
            spec, picture, stats = (Path(folder) / name for name in ("spec.json", "out.npz", "stats.json"))
            spec.write_text(json.dumps(rs.open(CORNELL, **sized(aov="z,albedo", filter="gaussian")).spec))
            command = [program, "render", "--options", spec, "-o", picture, "--stats", stats]
            subprocess.run(command, check=True, capture_output=True)
            ours = rs.render(options=spec)
            self.assertEqual(json.loads(stats.read_text())["image"]["hash"], ours.hash())
            with np.load(picture) as theirs:
                for name in ("image", "z", "albedo"):
                    np.testing.assert_array_equal(theirs[name], ours[name])

    def test_arrays_are_those_of_files(self):
        picture = rs.render(CORNELL, **sized(aov=["depth", "normal", "object", "crypto-object"], transparent=True))
        self.assertEqual(picture.keys(), ["image", "alpha", "depth", "normal", "object", "crypto-object"])
        self.assertEqual((picture.image.dtype, picture.image.shape), (np.float32, (30, 40, 3)))
        self.assertEqual(set(picture.layers), set(picture.keys()) - {"image"})
        self.assertEqual(picture.layers["normal"].shape, (30, 40, 3))
        self.assertEqual((picture["object"].dtype, picture["object"].shape), (np.uint32, (30, 40)))
        self.assertEqual(picture["crypto-object"].shape[1], 3)
        self.assertIs(picture.image, picture.image)
        ids = np.unique(picture["object"])
        self.assertLess(max(ids[ids != 2**32 - 1]), len(picture.names["object"]))
        self.assertEqual(set(picture.layer_hashes()), set(picture.layers))
        with tempfile.TemporaryDirectory() as folder:
            picture.save(Path(folder) / "a.npz")
            with np.load(Path(folder) / "a.npz") as arrays:
                for name in picture.keys():
                    np.testing.assert_array_equal(arrays[name], picture[name])
            picture.save(f"{folder}/a.png")
            self.assertEqual(sorted(os.listdir(folder))[:2], ["a.crypto-object.npy", "a.depth.npy"])
            self.assertEqual(Path(folder, "a.png").read_bytes()[:8], b"\x89PNG\r\n\x1a\n")
        with self.assertRaisesRegex(KeyError, "image, alpha, depth"):
            picture["albedo"]

    def test_what_notebooks_show_is_what_the_look_shows(self):
        for more in ({}, {"transparent": True}, {"exposure": 1, "view": "standard"}):
            picture = rs.render(CORNELL, **sized(**more))
            shown = picture.shown()
            self.assertEqual(shown.shape, (30, 40, 4 if "transparent" in more else 3))
            np.testing.assert_array_equal(png_pixels(picture._repr_png_()), shown)
        plain = rs.render(CORNELL, **sized()).shown()
        self.assertGreater(shown.mean(), plain.mean())

    def test_accounts_add_up(self):
        picture = rs.render(CORNELL, **sized())
        stats = picture.stats
        self.assertEqual((stats["mean_spp"], stats["passes"], stats["noise"]), (4, 1, None))
        self.assertEqual(stats["rays"]["camera"], 40 * 30 * 4)
        self.assertGreater(stats["rays"]["shadow"], 0)
        self.assertEqual(picture.metadata["picture_hash"], picture.hash())
        noisy = rs.render(CORNELL, **sized(spp=256, noise=0.3)).stats
        self.assertTrue(0 < noisy["noise"] and 8 <= noisy["mean_spp"] < 256, noisy)
        timed = rs.render(CORNELL, size=(40, 30), seconds=0.2).stats
        self.assertTrue(timed["seconds"] >= 0.2 and timed["mean_spp"] >= 1, timed)


class Scenes(unittest.TestCase):
    def test_arrays_are_the_same_scene_as_their_file(self):
        vertices, faces = icosphere(2)
        # Files hold colours as sRGB does, arrays linear ones: 0 and 1 are the same.
        colours = np.where(vertices > 0, 255, 0).astype(np.uint8)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "mesh.ply"
            file.write_bytes(ply(vertices, faces, colours))
            scene = rs.Scene(vertices, faces, normals=vertices, colours=np.float32(colours / 255.0))
            spec = sized(aov=["object", "albedo", "shading-normal"])
            ours, theirs = rs.render(scene, **spec), rs.render(file, **spec)
            self.assertEqual((ours.hash(), ours.layer_hashes()), (theirs.hash(), theirs.layer_hashes()))
            self.assertEqual(ours.names["object"], ["mesh"])
        self.assertEqual(scene.triangle_count, len(faces))
        np.testing.assert_allclose(scene.bounds, [vertices.min(0), vertices.max(0)])

    def test_meshes_are_scenes_whose_materials_can_be_changed(self):
        vertices, faces = icosphere(2)
        spec = sized(aov="albedo")
        plain = rs.render(rs.Mesh(vertices.astype(np.float64), faces), **spec)
        self.assertEqual(plain.hash(), rs.render(rs.Scene(vertices, faces), **spec).hash())
        red = rs.render(rs.Mesh(vertices, faces), material="default,base-colour=0.8,0.1,0.1", **spec)
        np.testing.assert_allclose(red["albedo"][15, 20], [0.8, 0.1, 0.1], atol=1e-6)
        spec = sized(aov="shading-normal")
        flat, smooth = (rs.render(rs.Mesh(vertices, faces, normals=normals), **spec) for normals in (None, vertices))
        self.assertNotEqual(smooth.layer_hashes(), flat.layer_hashes())

    def test_alpha_of_colours_is_seen_through(self):
        square = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
        for alpha, least, most in ((1, 1, 1), (0.5, 0.3, 0.7)):
            scene = rs.Scene(square, [[0, 1, 2], [0, 2, 3]], colours=np.full((4, 4), alpha), uvs=np.zeros((4, 2)))
            picture = rs.render(scene, **sized(spp=16, eye=(0, 0, 2), target=(0, 0, 0), transparent=True))
            seen = picture["alpha"][15, 20]
            self.assertTrue(least <= seen <= most, seen)

    def test_bad_arrays_are_refused(self):
        triangle = np.eye(3, dtype=np.float32)
        for arguments, keywords, told in [
            ((triangle, [[0, 1, 3]]), {}, "triangle 0 names vertex 3"),
            ((triangle * np.nan, [[0, 1, 2]]), {}, "vertex 0"),
            ((triangle, np.zeros((0, 3), int)), {}, "no triangles"),
            ((triangle, [[0, 1, 2]]), {"colours": np.ones((2, 3))}, "colours"),
            ((triangle, [[0, 1, 2]]), {"uvs": np.ones((3, 3))}, "uvs"),
            ((triangle, [[0, 1, 2]]), {"normals": np.full((3, 3), np.inf)}, "normals"),
            ((triangle, [[0, 1, 2]]), {"colours": np.full((3, 3), -1)}, "colours: vertex 0 has -1"),
            ((triangle, [[0, 1, 2]]), {"colours": np.full((3, 4), 255, np.uint8)}, "from 0 to 1"),
        ]:
            with self.subTest(told), self.assertRaisesRegex(ValueError, told):
                rs.Scene(*arguments, **keywords)

    def test_views_are_rendered_of_one_scene(self):
        rendering = rs.open(BALL, **sized(views=3))
        self.assertEqual((rendering.frames, len(rendering.names)), (range(3), 3))
        one_by_one = [rendering.render(frame) for frame in rendering.frames]
        shares = []
        together = rs.render(BALL, progress=shares.append, **sized(views=3))
        self.assertEqual([view.hash() for view in together], [view.hash() for view in one_by_one])
        self.assertEqual([view.frame for view in together], [0, 1, 2])
        self.assertEqual([view.name for view in together], rendering.names)
        self.assertEqual(set(together[0].layers), {"alpha", "z"})
        self.assertTrue(shares == sorted(shares) and shares[-1] == 1 and len(shares) >= 3, shares)
        self.assertIsInstance(rs.render(BALL, **sized(frames="3..4", turntable=10)), list)
        with self.assertRaisesRegex(ValueError, "no frame 3"):
            rendering.render(3)
        self.assertEqual(rendering.spec, {"size": "40x30", "spp": 4, "max-bounces": 2, "env": "1,1,1", "views": "3"})
        self.assertEqual(len(rendering.scene_hash), 16)


class Errors(unittest.TestCase):
    def told(self, kind, *arguments, **keywords):
        with self.assertRaises(kind) as raised:
            rs.render(*arguments, **keywords)
        return str(raised.exception)

    def test_specs_are_refused_with_the_remedy(self):
        told = self.told(ValueError, CORNELL, sizes=(3, 3))
        self.assertIn('"sizes" is no option of a picture; did you mean "size"?', told)
        self.assertIn("size: write WIDTHxHEIGHT", self.told(ValueError, CORNELL, size="64"))
        self.assertIn("--noise", self.told(ValueError, CORNELL, noise=0.1, region=[0, 0, 4, 4]))
        self.assertIn("eye: NaN is not finite", self.told(ValueError, CORNELL, eye=(0, float("nan"), 1)))
        self.assertIn("name its file", self.told(ValueError))
        self.assertIn("twice", self.told(ValueError, CORNELL, scene="a.obj"))
        self.assertIn("spp", self.told(TypeError, CORNELL, spp=object()))
        self.assertIn("a scene is a path", self.told(TypeError, 3))
        self.assertIn("threads", self.told(ValueError, BALL, threads=0))
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "spec.toml"
            file.write_text("seed = 1\nspp = -3\n")
            self.assertIn("spec.toml:2:1: spp:", self.told(ValueError, options=file))

    def test_files_and_memory_have_their_own_errors(self):
        self.assertIn("nowhere.glb", self.told(FileNotFoundError, "nowhere.glb"))
        self.assertIn("nowhere.toml", self.told(FileNotFoundError, options="nowhere.toml"))
        self.assertIn("unknown file extension", self.told(ValueError, "a.xyz"))
        self.assertIn("memory", self.told(MemoryError, CORNELL, size=(16384, 16384), aov=LARGE))
        picture = rs.render(BALL, **sized())
        with self.assertRaises(OSError):
            picture.save("/nowhere/at/all.png")
        with self.assertRaisesRegex(ValueError, "unknown file extension"):
            picture.save("a.gif")

    def test_warnings_come_to_the_logger(self):
        with self.assertLogs("raystream", logging.WARNING) as logged:
            rs.render(BALL, **sized(env=None))
        self.assertIn("no light", logged.output[0])


# A shell's jobs in the background ignore interrupts, and so do their children unless they say otherwise.
ENDLESS = """
import signal, sys, raystream as rs
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.path.insert(0, sys.argv[1])
from shapes import icosphere
print("ready", flush=True)
try:
    rs.render(rs.Mesh(*icosphere(5)), size=(1500, 1500), spp=60000)
except KeyboardInterrupt:
    print("interrupted", rs.render(rs.Mesh(*icosphere(1)), size=(8, 8), spp=1).image.shape)
"""


class Processes(unittest.TestCase):
    def test_progress_is_told_and_may_end_the_picture(self):
        shares, threads = [], set()

        def progress(share):
            shares.append(share)
            threads.add(threading.get_ident())

        rs.render(BALL, size=(300, 300), spp=64, env="1,1,1", progress=progress)
        self.assertTrue(shares == sorted(shares) and shares[-1] == 1, shares)
        self.assertEqual(threads, {threading.get_ident()})

        def fail(share):
            raise RuntimeError("enough")

        begun = time.monotonic()
        with self.assertRaisesRegex(RuntimeError, "enough"):
            rs.render(BALL, size=(1500, 1500), spp=60000, env="1,1,1", progress=fail)
        self.assertLess(time.monotonic() - begun, 20)

    def test_a_picture_is_interrupted(self):
        command = [sys.executable, "-c", ENDLESS, os.path.dirname(os.path.abspath(__file__))]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        with process, contextlib.ExitStack() as at_end:
            # Whatever fails: leaving the process waits for its end.
            at_end.callback(process.kill)
            self.assertEqual(process.stdout.readline(), "ready\n")
            time.sleep(1)
            begun = time.monotonic()
            process.send_signal(signal.SIGINT)
            self.assertEqual(process.communicate(timeout=60)[0], "interrupted (8, 8, 3)\n")
            self.assertLess(time.monotonic() - begun, 10)

    def test_the_lock_is_released_and_many_threads_render(self):
        hashes = []

        def work():
            hashes.append(rs.render(BALL, **sized(size=(120, 90), spp=16)).hash())

        threads = [threading.Thread(target=work) for _ in range(6)]
        for thread in threads:
            thread.start()
        turns = 0
        while any(thread.is_alive() for thread in threads):
            turns += 1
            time.sleep(0.001)
        for thread in threads:
            thread.join()
        self.assertEqual((len(hashes), len(set(hashes))), (6, 1))
        self.assertGreater(turns, 5)

    @unittest.skipUnless(hasattr(os, "fork"), "this system does not fork")
    def test_forked_children_render(self):
        spec = sized(size=(64, 64))
        expected = rs.render(BALL, **spec).hash()
        rendering = rs.open(BALL, **spec)
        child = os.fork()
        if child == 0:
            same = rs.render(BALL, **spec).hash() == expected and rendering.render().hash() == expected
            os._exit(0 if same else 1)
        for _ in range(6000):
            done, status = os.waitpid(child, os.WNOHANG)
            if done:
                break
            time.sleep(0.01)
        else:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            self.fail("the child hangs")
        self.assertEqual(os.waitstatus_to_exitcode(status), 0)

    def test_arrays_pickle(self):
        picture = rs.render(BALL, **sized(aov="depth"))
        for array in picture.layers.values():
            np.testing.assert_array_equal(pickle.loads(pickle.dumps(array)), array)


class Info(unittest.TestCase):
    def test_it_tells_what_this_build_can_do(self):
        info = rs.info()
        self.assertEqual((info["version"], info["simd"]), (rs.__version__, rs.simd))
        self.assertEqual(info["simd_levels"][0], rs.simd)
        self.assertGreaterEqual(info["threads"], 1)
        self.assertIn("picture", info["features"])


def ply(vertices, faces, colours):
    """A PLY file with normals, those of a sphere."""
    out = io.BytesIO()
    names = "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
    names += "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n{names}"
    out.write(f"{head}element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n".encode())
    for vertex, colour in zip(vertices.astype("<f4"), colours):
        out.write(vertex.tobytes() * 2 + colour.tobytes())
    for face in faces.astype("<i4"):
        out.write(b"\x03" + face.tobytes())
    return out.getvalue()


def png_pixels(png):
    """The pixels of a PNG of 8 bits, by its specification."""
    at, data = 8, b""
    while at < len(png):
        length, kind = struct.unpack(">I4s", png[at : at + 8])
        content = png[at + 8 : at + 8 + length]
        if kind == b"IHDR":
            width, height, bits, colour = struct.unpack(">IIBB", content[:10])
            channels = {2: 3, 6: 4}[colour]
        data += content if kind == b"IDAT" else b""
        at += 12 + length
    assert bits == 8
    raw, rows = zlib.decompress(data), []
    stride, before = width * channels, np.zeros(width * channels, np.int64)
    for y in range(height):
        kind, line = raw[y * (stride + 1)], np.frombuffer(raw, np.uint8, stride, y * (stride + 1) + 1)
        row = np.zeros(stride, np.int64)
        for x, value in enumerate(line):
            left = row[x - channels] if x >= channels else 0
            corner = before[x - channels] if x >= channels else 0
            paeth = left + before[x] - corner
            near = min((abs(paeth - value), i) for i, value in enumerate((left, before[x], corner)))[1]
            guess = [0, left, before[x], (left + before[x]) // 2, (left, before[x], corner)[near]][kind]
            row[x] = (int(value) + guess) % 256
        rows.append(row)
        before = row
    return np.array(rows, np.uint8).reshape(height, width, channels)


if __name__ == "__main__":
    unittest.main()
