"""`raystream compare` agrees with published implementations of its metrics."""

import json
import os

os.environ["OPENCV_IO_ENABLE_OPENEXR"] = "1"
import cv2
import flip_evaluator
import numpy as np
import raystream
from skimage.metrics import mean_squared_error, peak_signal_noise_ratio, structural_similarity


def pictures():
    """Pairs of pictures, 0 to 1: noise, edges that move, a tint, and dots."""
    random = np.random.default_rng(1)
    y, x = np.mgrid[0:61, 0:83]
    waves = 0.5 + 0.5 * np.sin(np.stack([x / 5, y / 7, (x + y) / 11], axis=-1))
    edges = np.repeat(((x // 8 + y // 8) % 2)[..., None], 3, axis=-1) * 0.9
    dots = waves.copy()
    dots[::9, ::9] = 1.0
    yield waves, np.clip(waves + random.normal(0, 0.1, waves.shape), 0, 1)
    yield edges, np.roll(edges, 1, axis=1)
    yield waves, waves * [1.0, 0.8, 0.9]
    yield waves, dots
    yield random.random(waves.shape), random.random(waves.shape)


class Compare(raystream.Case):
    def save(self, name, picture):
        """Writes a PNG file; returns the values that it stores."""
        stored = np.round(picture * 65535).astype(np.uint16)
        cv2.imwrite(str(self.folder / name), stored[..., ::-1])
        return stored.astype(np.float64) / 65535

    def compare(self, *arguments, code=0):
        return json.loads(self.raystream("compare", *arguments, "--json", code=code))

    def test_metrics_of_what_is_shown(self):
        for pair in pictures():
            reference, test = (self.save(name, picture) for name, picture in zip(("a.png", "b.png"), pair))
            values = self.compare("a.png", "b.png")["metrics"]
            options = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
            ssim = structural_similarity(reference, test, data_range=1.0, channel_axis=2, **options)
            self.assertAlmostEqual(values["ssim"], ssim, delta=1e-5)
            psnr = peak_signal_noise_ratio(reference, test, data_range=1.0)
            self.assertAlmostEqual(values["psnr"], psnr, delta=1e-3)
            images = reference.astype(np.float32), test.astype(np.float32)
            _, flip, settings = flip_evaluator.evaluate(*images, "LDR", applyMagma=False)
            self.assertAlmostEqual(settings["ppd"], 3840 * np.pi / 180, delta=0.1)
            self.assertAlmostEqual(values["flip"], flip, delta=2e-5)

    def test_flip_of_each_pixel(self):
        for pair in pictures():
            reference, test = (self.save(name, picture) for name, picture in zip(("a.png", "b.png"), pair))
            self.raystream("compare", "a.png", "b.png", "-o", "flip.png")
            shown = cv2.imread(str(self.folder / "flip.png"), cv2.IMREAD_UNCHANGED)[..., ::-1] / 255.0
            images = reference.astype(np.float32), test.astype(np.float32)
            magma, _, _ = flip_evaluator.evaluate(*images, "LDR", applyMagma=True)
            # Our colours are a polynomial through the table of magma.
            self.assertLess(np.abs(shown - magma).max(), 0.06)
            self.assertLess(np.abs(shown - magma).mean(), 0.02)

    def test_metrics_of_radiance(self):
        random = np.random.default_rng(2)
        reference = random.gamma(0.5, 2.0, (20, 30, 3)).astype(np.float32)
        test = (reference * random.uniform(0.5, 2.0, reference.shape)).astype(np.float32)
        np.save(self.folder / "a.npy", reference)
        np.save(self.folder / "b.npy", test)
        cv2.imwrite(str(self.folder / "b.exr"), test[..., ::-1])
        values = self.compare("a.npy", "b.npy")["metrics"]
        self.assertEqual(values, self.compare("a.npy", "b.exr")["metrics"])
        reference, test = reference.astype(np.float64), test.astype(np.float64)
        mse = mean_squared_error(reference, test)
        self.assertAlmostEqual(values["mse"], mse, delta=1e-6 * mse)
        relmse = np.mean((test - reference) ** 2 / (reference**2 + 0.01))
        self.assertAlmostEqual(values["relmse"], relmse, delta=1e-6 * relmse)
        self.raystream("compare", "a.npy", "b.npy", "-o", "d.npy")
        self.assertTrue(np.allclose(np.load(self.folder / "d.npy"), test - reference, atol=1e-5))

    def test_limits_decide_the_exit_code(self):
        for name, light in (("a.png", 0.5), ("b.png", 0.6)):
            self.save(name, np.full((16, 16, 3), light))
        self.compare("a.png", "b.png", "--max", "flip=0.9", "--min", "psnr=19.9")
        report = self.compare("a.png", "b.png", "--metric", "mse", "--max", "flip=0.001", code=1)
        self.assertIn("flip is ", report["failed"][0])
        self.save("c.png", np.full((16, 17, 3), 0.5))
        self.raystream("compare", "a.png", "c.png", code=2)
