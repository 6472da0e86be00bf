"""Runs raystream's service in a temporary folder, and pages of it in headless Chromium; over TLS, where pages speak
HTTP/2, if RAYSTREAM_TLS is set."""

import base64
import json
import os
import pathlib
import shutil
import socket
import ssl
import struct
import subprocess
import tempfile
import time
import unittest
import urllib.error
import urllib.request

from playwright.sync_api import sync_playwright

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = os.environ.get("RAYSTREAM", ROOT / "target" / "release" / "raystream")
CHROMIUM = os.environ.get("CHROMIUM", "/usr/bin/chromium")
TLS = bool(os.environ.get("RAYSTREAM_TLS"))
# Of tests that no transport changes: once is enough.
page_alone = unittest.skipIf(TLS, "tested without TLS")
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
         "--disable-component-update", "--disable-sync"]

# A red sphere on a grey floor.
SCENE = {
    "environment": [0.9, 0.95, 1.0],
    "materials": {"floor": {"colour": [0.5, 0.5, 0.5]}, "ball": {"colour": [0.8, 0.1, 0.05]}},
    "shapes": [
        {"shape": "sphere", "centre": [0, 1, 0], "radius": 1, "cells": 24, "material": "ball"},
        {"shape": "sphere", "centre": [0, -100, 0], "radius": 100, "cells": 64, "material": "floor"},
    ],
    "camera": {"eye": [0, 1.5, 5], "target": [0, 1, 0], "fov_degrees": 40},
}


def free_port():
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


def triangle_glb():
    """The smallest GLB: one triangle."""
    positions = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0],
                       "max": [1, 1, 0]}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36}],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", 36, b"BIN\0") + positions
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def moving_gltf():
    """A triangle that moves to the right for a second, or upwards for two, before a wall, and a camera."""
    numbers = [("VEC3", (-0.5, -0.5, 0, 0.5, -0.5, 0, 0, 0.5, 0)), ("VEC3", (-9, -9, -1, 9, -9, -1, 0, 12, -1)),
               ("SCALAR", (0, 1)), ("VEC3", (-1, 0, 0, 1, 0, 0)), ("SCALAR", (0, 2)), ("VEC3", (0, 0, 0, 0, 1, 0))]
    data = b"".join(struct.pack(f"<{len(values)}f", *values) for _, values in numbers)
    views, accessors, start = [], [], 0
    for number, (kind, values) in enumerate(numbers):
        views.append({"buffer": 0, "byteOffset": start, "byteLength": 4 * len(values)})
        count = len(values) // (3 if kind == "VEC3" else 1)
        accessors.append({"bufferView": number, "componentType": 5126, "type": kind, "count": count})
        start += 4 * len(values)
    animations = [{"name": name, "samplers": [{"input": first, "output": first + 1}],
                   "channels": [{"sampler": 0, "target": {"node": 0, "path": "translation"}}]}
                  for name, first in (("right", 2), ("up", 4))]
    return json.dumps({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1, 2]}],
        "nodes": [{"mesh": 0}, {"mesh": 1}, {"camera": 0, "translation": [0, 0.2, 4]}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": mesh}}]} for mesh in (0, 1)],
        "animations": animations, "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": len(data),
                     "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}],
    })


class Service:
    """`raystream view` of a scene, a file's name and its text; `start` and `kill` may alternate."""

    def __init__(self, folder, scene, *options):
        self.folder, self.options = folder, options
        if TLS:
            self.options += self.certificate()
        self.port = free_port()
        name, text = scene
        self.scene = folder / name
        self.scene.write_text(text)
        self.process = None

    def certificate(self):
        """Makes a certificate; the options that name it."""
        files = self.folder / "certificate.pem", self.folder / "key.pem"
        made = ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes",
                "-days", "1", "-subj", "/CN=raystream", "-addext", "subjectAltName=IP:127.0.0.1", "-out", files[0],
                "-keyout", files[1]]
        subprocess.run(made, check=True, capture_output=True)
        return "--tls-certificate", files[0], "--tls-key", files[1]

    @property
    def url(self):
        return f"{'https' if TLS else 'http'}://127.0.0.1:{self.port}/"

    def open(self, path):
        """Requests an address of the service; the answer."""
        trusts = ssl.create_default_context(cafile=self.folder / "certificate.pem") if TLS else None
        return urllib.request.urlopen(self.url + path, timeout=5, context=trusts)

    @property
    def token(self):
        return (self.folder / "data" / "token").read_text().strip()

    def start(self):
        command = [PROGRAM, "view", self.scene, "--listen", f"127.0.0.1:{self.port}", "--data", self.folder / "data",
                   "--no-browser", *self.options]
        self.log = open(self.folder / "log", "ab")
        self.process = subprocess.Popen(list(map(str, command)), stdout=self.log, stderr=self.log)
        until = time.monotonic() + 60
        while time.monotonic() < until:
            try:
                self.open("healthz").close()
                return
            except (urllib.error.URLError, ConnectionError):
                if self.process.poll() is not None:
                    break
                time.sleep(0.05)
        raise AssertionError("the service did not start:\n" + (self.folder / "log").read_text())

    def render(self, spec):
        """The PNG that `raystream render` makes of a spec beside the scene."""
        (self.folder / "spec.json").write_text(json.dumps(spec))
        command = [PROGRAM, "render", "--options", "spec.json", "-o", "again.png"]
        subprocess.run(list(map(str, command)), cwd=self.folder, check=True, capture_output=True)
        return (self.folder / "again.png").read_bytes()

    def kill(self):
        if self.process:
            self.process.kill()
            self.process.wait()
            self.log.close()
            self.process = None


class Case(unittest.TestCase):
    """A test with a service and a browser."""

    OPTIONS = ()
    SCENE = "scene.json", json.dumps(SCENE)

    @classmethod
    def setUpClass(cls):
        if not shutil.which(CHROMIUM):
            raise AssertionError(f"{CHROMIUM} is missing; install Chromium, or set CHROMIUM")
        cls.folder = pathlib.Path(cls.enterClassContext(tempfile.TemporaryDirectory()))
        cls.service = Service(cls.folder, cls.SCENE, *cls.OPTIONS)
        cls.addClassCleanup(cls.service.kill)
        cls.service.start()
        playwright = cls.enterClassContext(sync_playwright())
        cls.browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        cls.addClassCleanup(cls.browser.close)

    def page(self, *, token=None, width=1280, height=800, **options):
        """A page of a new profile, logged in with the token unless another one is given."""
        # The system does not know who has signed the certificate.
        context = self.browser.new_context(viewport={"width": width, "height": height}, ignore_https_errors=TLS,
                                           **options)
        self.addCleanup(context.close)
        page = context.new_page()
        self.errors = []
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        given = self.service.token if token is None else token
        page.goto(self.service.url + (f"#token={given}" if given else ""))
        return page

    def live(self, **options):
        """A page whose live view has shown the full picture."""
        page = self.page(**options)
        self.wait_for(page, "raystream.frames > 0 && !raystream.moving")
        return page

    def wait_for(self, page, expression, timeout=60):
        page.wait_for_function(f"() => window.raystream && ({expression.replace('raystream.', 'window.raystream.')})",
                               timeout=1000 * timeout)

    def tearDown(self):
        self.assertEqual(getattr(self, "errors", []), [])

    def pixels(self, page):
        """The canvas as a string: equal pictures have equal ones."""
        return page.evaluate("document.getElementById('picture').toDataURL()")

    def colours(self, page, png):
        """The pixels of a PNG as a string."""
        return page.evaluate("""async (text) => {
            const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
            const bitmap = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
            const canvas = new OffscreenCanvas(bitmap.width, bitmap.height);
            const context = canvas.getContext("2d");
            context.drawImage(bitmap, 0, 0);
            const { data } = context.getImageData(0, 0, bitmap.width, bitmap.height);
            const digest = await crypto.subtle.digest("SHA-256", data);
            return `${bitmap.width}x${bitmap.height} ${new Uint8Array(digest)}`;
        }""", base64.b64encode(png).decode())

    def drag(self, page, dx, dy, steps=8, button="left"):
        box = page.get_by_test_id("picture").bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(x, y)
        page.mouse.down(button=button)
        for step in range(1, steps + 1):
            page.mouse.move(x + dx * step / steps, y + dy * step / steps)
        page.mouse.up(button=button)
