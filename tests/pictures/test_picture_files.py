"""Picture files as the programs of others read them: OpenEXR's own library, OpenCV, NumPy, Pillow."""

import json
import os
import struct

os.environ["OPENCV_IO_ENABLE_OPENEXR"] = "1"
import cv2
import numpy as np
import OpenEXR
import PIL.Image
import raystream

LAYERS = (
    "depth,z,normal,shading-normal,position,albedo,uv,emission,object,material,instance,primitive,samples,variance,"
    "crypto-object,crypto-material,crypto-asset"
)
PREFIXES = {"z": "", "normal": "N.", "shading-normal": "Ns.", "position": "P."}
CRYPTOMATTES = {"object": "CryptoObject", "material": "CryptoMaterial", "asset": "CryptoAsset"}


def channels_of(layer):
    letters = {"depth": "Z", "z": "Z", "uv": "UV", "samples": "Y"}
    colours = layer in ("albedo", "emission", "variance")
    ids = layer in ("object", "material", "instance", "primitive")
    return letters.get(layer, "X" if ids else "RGB" if colours else "XYZ")


class PictureFiles(raystream.Case):
    def open(self, path):
        file = self.enterContext(OpenEXR.File(str(path), separate_channels=True))
        return {name: channel.pixels for name, channel in file.channels().items()}, file.header()

    def assert_same_bits(self, a, b, what):
        self.assertEqual((a.shape, a.dtype), (b.shape, b.dtype), what)
        self.assertEqual(a.tobytes(), b.tobytes(), what)

    def test_exr_and_npz_hold_the_same_values(self):
        for compression in ("none", "rle", "zips", "zip", "piz"):
            options = ("--aov", LAYERS, "--transparent", "--exr-compression", compression)
            channels, header = self.open(self.render("a.exr", *options))
            arrays = np.load(self.render("a.npz", *options))
            for i, name in enumerate("RGB"):
                self.assert_same_bits(channels[name], np.ascontiguousarray(arrays["image"][..., i]), name)
            self.assert_same_bits(channels["A"], arrays["alpha"], "alpha")
            for layer in LAYERS.split(","):
                if layer.startswith("crypto-"):
                    continue
                letters = channels_of(layer)
                for i, letter in enumerate(letters):
                    values = arrays[layer][..., i] if len(letters) > 1 else arrays[layer]
                    name = PREFIXES.get(layer, f"{layer}.") + letter
                    self.assert_same_bits(channels[name], np.ascontiguousarray(values), name)
            metadata = json.loads(arrays["metadata.json"])
            for name, text in metadata.items():
                self.assertEqual(header[f"raystream/{name}"], text)
            self.assertEqual(metadata["spp"], "16")
            names = json.loads(arrays["ids.json"])
            self.assertEqual(json.loads(header["raystream/object_names"]), names["object"])
            self.assertEqual(set(names["material"]) & {"red", "green"}, {"red", "green"})

    def test_cryptomatte_masks_select_what_they_name(self):
        channels, header = self.open(self.render("a.exr", "--aov", LAYERS, "--transparent"))
        arrays = np.load(self.render("a.npz", "--aov", LAYERS, "--transparent"))
        names = json.loads(arrays["ids.json"])
        keys = [key[:-4] for key in header if key.startswith("cryptomatte/") and key.endswith("/name")]
        kinds = {header[f"{key}name"]: key for key in keys}
        self.assertEqual(set(kinds), set(CRYPTOMATTES.values()))
        for kind, type_name in CRYPTOMATTES.items():
            key = kinds[type_name]
            self.assertEqual(header[f"{key}hash"], "MurmurHash3_32")
            self.assertEqual(header[f"{key}conversion"], "uint32_to_float32")
            manifest = json.loads(header[f"{key}manifest"])
            rows, total = arrays[f"crypto-{kind}"], 0.0
            pixels = channels["R"].size
            samples = np.bincount(rows[:, 0], weights=rows[:, 2], minlength=pixels)
            for name, digits in manifest.items():
                mask = self.mask(channels, type_name, digits)
                ids = [i for i, other in enumerate(names[f"crypto-{kind}"]) if other == name]
                own = rows[np.isin(rows[:, 1], ids)]
                exact = np.bincount(own[:, 0], weights=own[:, 2], minlength=pixels) / samples
                self.assertTrue(np.allclose(mask.ravel(), exact, atol=1e-7), name)
                total = total + mask
            self.assertTrue(np.allclose(total, channels["A"], atol=1e-6), "masks add up to alpha")

    def mask(self, channels, type_name, digits):
        """Coverage of an id over all ranks, as compositors compute it."""
        (wanted,) = struct.unpack(">f", bytes.fromhex(digits))
        mask = np.zeros_like(channels["R"])
        for level in range(3):
            for id_letter, coverage_letter in ("RG", "BA"):
                ids = channels[f"{type_name}{level:02}.{id_letter}"]
                mask += np.where(ids == np.float32(wanted), channels[f"{type_name}{level:02}.{coverage_letter}"], 0)
        return mask

    def test_masks_are_where_the_objects_are(self):
        channels, header = self.open(self.render("a.exr", "--aov", "crypto-object,object,position"))
        key = next(key for key in header if key.endswith("manifest"))
        manifest = json.loads(header[key])
        self.assertEqual(set(manifest), {"left", "right", "behind"})
        masks = {name: self.mask(channels, "CryptoObject", digits) for name, digits in manifest.items()}
        # Pixels that lie wholly on one object, by the position that they show.
        x, z = channels["P.X"], channels["P.Z"]
        whole = lambda name: masks[name] == 1
        self.assertTrue((x[whole("left")] < 0).all() and whole("left").sum() > 50)
        self.assertTrue((x[whole("right")] > 0).all() and whole("right").sum() > 50)
        self.assertTrue((z[whole("behind")] < -1.9).all() and whole("behind").sum() > 10)
        names = json.loads(header["raystream/object_names"])
        for name, mask in masks.items():
            self.assertTrue((channels["object.X"][mask == 1] == names.index(name)).all(), name)

    def test_opencv_reads_colours_and_alpha(self):
        path = self.render("a.exr", "--aov", LAYERS, "--transparent")
        channels, _ = self.open(path)
        bgra = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        for i, name in enumerate("BGRA"):
            self.assert_same_bits(np.ascontiguousarray(bgra[..., i]), channels[name], name)

    def test_world_to_ndc_finds_positions(self):
        channels, header = self.open(self.render("a.exr", "--aov", "position,object", spp=64))
        to_ndc, to_camera = (np.asarray(header[name]) for name in ("worldToNDC", "worldToCamera"))
        height, width = channels["R"].shape
        inside = cv2.erode((channels["object.X"] == 0).astype(np.uint8), np.ones((3, 3))) == 1
        points = np.stack([channels[f"P.{axis}"][inside] for axis in "XYZ"] + [np.ones(inside.sum())], axis=-1)
        seen = points @ to_ndc
        seen = seen[:, :2] / seen[:, 3:] * [width, height]
        y, x = np.nonzero(inside)
        self.assertLess(np.abs(seen - np.stack([x + 0.5, y + 0.5], axis=-1)).mean(), 0.1)
        self.assertTrue(((points @ to_camera)[:, 2] > 5).all(), "z is forward")

    def test_half_floats(self):
        channels, _ = self.open(self.render("a.exr", "--aov", "z,normal,object", "--exr-half"))
        types = {name: channels[name].dtype.name for name in ("R", "N.X", "Z", "object.X")}
        self.assertEqual(types, {"R": "float16", "N.X": "float16", "Z": "float32", "object.X": "uint32"})

    def test_files_beside_a_png(self):
        path = self.render("a.png", "--aov", LAYERS, "--transparent", "--png-bits", "16")
        arrays = np.load(self.render("b.npz", "--aov", LAYERS, "--transparent"))
        for layer in LAYERS.split(","):
            self.assert_same_bits(np.load(self.folder / f"a.{layer}.npy"), arrays[layer], layer)
        self.assertEqual(json.loads((self.folder / "a.ids.json").read_text()), json.loads(arrays["ids.json"]))
        metadata = json.loads(arrays["metadata.json"])
        with PIL.Image.open(path) as png:
            texts = {name[10:]: text for name, text in png.text.items() if name.startswith("raystream/")}
        self.assertEqual(texts, metadata)
        bgra = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        self.assertEqual(bgra.dtype, np.uint16)
        self.assertTrue(np.array_equal(bgra[..., 3], np.round(arrays["alpha"] * 65535)))

    def test_layers_as_png(self):
        layers = "depth,normal,object,albedo"
        self.render("a.png", "--aov", layers, "--aov-format", "png", "--png-bits", "16")
        arrays = np.load(self.render("b.npz", "--aov", layers))
        path = self.folder / "a.depth.png"
        with PIL.Image.open(path) as png:
            unit = float(png.text["raystream/unit"])
        stored = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        self.assertEqual(stored.dtype, np.uint16)
        hit = np.isfinite(arrays["depth"])
        self.assertTrue((stored[~hit] == 0).all())
        self.assertLessEqual(np.abs(stored[hit] * unit - arrays["depth"][hit]).max(), 0.501 * unit)
        normal = cv2.imread(str(self.folder / "a.normal.png"), cv2.IMREAD_UNCHANGED)[..., ::-1]
        self.assertLess(np.abs(normal / 65535.0 * 2 - 1 - arrays["normal"]).max(), 2e-5)
        ids = cv2.imread(str(self.folder / "a.object.png"), cv2.IMREAD_UNCHANGED)[..., ::-1].astype(np.uint32)
        ids = ids[..., 0] + 256 * ids[..., 1] + 65536 * ids[..., 2]
        self.assertTrue(np.array_equal(np.where(ids == 16777215, 4294967295, ids), arrays["object"]))
