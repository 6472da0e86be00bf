"""The service's OpenAPI document against the service: schemathesis sends what the document allows and what it does not.
No request may be answered with 5xx, with a code, media type or body that the document does not have, or without the
token. Needs target/release/raystream (or RAYSTREAM) and, beside this Python, schemathesis.
"""

import hashlib
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import time
import unittest
import urllib.request

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = os.environ.get("RAYSTREAM", ROOT / "target" / "release" / "raystream")
SCHEMATHESIS = pathlib.Path(sys.executable).parent / "schemathesis"
SECONDS = os.environ.get("RAYSTREAM_OPENAPI_SECONDS", "8")
SCENE = json.dumps({
    "environment": [1, 1, 1],
    "materials": {"grey": {"colour": [0.5, 0.5, 0.5]}},
    "shapes": [{"shape": "sphere", "centre": [0, 0, 0], "radius": 1, "cells": 4, "material": "grey"}],
}).encode()
CHECKS = "not_a_server_error,status_code_conformance,content_type_conformance,response_schema_conformance," \
         "unsupported_method,ignored_auth"
# Streams of events end when the client leaves; crates/cli/tests/serve reads them.
STREAMS = "/events$"


class OpenApi(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(cls.enterClassContext(tempfile.TemporaryDirectory()))
        command = [PROGRAM, "serve", "--listen", "127.0.0.1:0", "--data", cls.folder / "data", "--tracer", "cpu"]
        # What the long job leaves is for requests.
        command += ["--threads", "1"]
        log = cls.enterClassContext(open(cls.folder / "log", "wb"))
        cls.process = subprocess.Popen(list(map(str, command)), stdout=subprocess.PIPE, stderr=log, text=True)
        cls.addClassCleanup(cls.process.wait)
        cls.addClassCleanup(cls.process.kill)
        cls.addClassCleanup(cls.process.stdout.close)
        cls.url, cls.token = cls.process.stdout.readline().strip().split("/#token=")
        sha256 = hashlib.sha256(SCENE).hexdigest()
        cls.send("PUT", f"/api/v1/scenes/{sha256}", SCENE)
        job = cls.job(sha256, {"size": "8x8", "spp": 1, "aov": "depth"})
        while cls.send("GET", f"/api/v1/jobs/{job}")["state"] != "done":
            time.sleep(0.1)
        # The one that is steered has work for as long as the tests take.
        long = cls.job(sha256, {"size": "640x360", "spp": 65536})
        cls.doomed = [cls.job(sha256, {"size": "8x8", "spp": 2, "seed": seed}) for seed in range(3)]
        cls.doomed += [long, "missing"]
        cls.known = {
            "sha256": [sha256, "0" * 64],
            "id": [job, long, "missing"],
            "file": ["0.png", "0.exr", "0.npz", "0.npy", "1.png", "depth.npy", "albedo.npy", "..%2Ftoken"],
            "frame": ["0", "1", "x"],
            "scene": [sha256, "0" * 64, "x"],
        }

    @classmethod
    def send(cls, method, path, body=None):
        headers = {"Authorization": f"Bearer {cls.token}"}
        if method == "POST":
            body, headers["Content-Type"] = json.dumps(body).encode(), "application/json"
        request = urllib.request.Request(cls.url + path, data=body, headers=headers, method=method)
        with urllib.request.urlopen(request, timeout=60) as answer:
            return json.load(answer)

    @classmethod
    def job(cls, sha256, options):
        return cls.send("POST", "/api/v1/jobs", {"scene": sha256, **options})["id"]

    def check(self, document):
        # One worker: CPython 3.11 may fail when two threads parse sources at once (its issue 106905).
        path = self.folder / "openapi.json"
        path.write_text(json.dumps(document))
        run = subprocess.run(
            [SCHEMATHESIS, "--no-color", "run", path, "--url", self.url, "--header",
             f"Authorization: Bearer {self.token}", "--checks", CHECKS, "--exclude-path-regex", STREAMS,
             "--max-time", SECONDS, "--workers", "1", "--request-timeout", "20", "--continue-on-failure",
             "--suppress-health-check", "all", "--warnings", "off", "--seed", "7",
             "--generation-database", "none"],
            capture_output=True, text=True, cwd=self.folder)
        self.assertEqual(run.returncode, 0, run.stdout + run.stderr)
        self.assertIsNone(self.process.poll(), "the service goes on")
        cases = re.search(r"(\d+) generated, (\d+) passed", run.stdout)
        self.assertIsNotNone(cases, run.stdout)
        # On a quiet machine there are several times as many.
        self.assertGreater(int(cases[2]), 30, "it tries something")

    def document(self):
        with urllib.request.urlopen(self.url + "/openapi.json", timeout=60) as answer:
            return json.load(answer)

    def test_the_document_as_it_is(self):
        self.check(self.document())

    def test_jobs_and_scenes_that_there_are(self):
        document = self.document()
        for methods in document["paths"].values():
            for method, operation in methods.items():
                # What is deleted is of no use to the other routes.
                known = {**self.known, "id": self.doomed} if method == "delete" else self.known
                for parameter in operation["parameters"]:
                    if parameter["name"] in known:
                        parameter["schema"] = {"enum": known[parameter["name"]]}
        request = document["components"]["schemas"]["JobRequest"]["properties"]
        request["scene"] = {"enum": self.known["scene"]}
        request["size"] = {"enum": ["8x8", "0x0", "x", [8, 8]]}
        request["spp"] = {"type": "integer", "maximum": 4}
        request["aov"] = {"enum": ["z", "nothing", 1]}
        self.check(document)


if __name__ == "__main__":
    unittest.main()
