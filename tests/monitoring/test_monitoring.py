"""docs/monitoring against what it is for: a real Prometheus scrapes a service under some load, every expression of the
dashboard is answered with data, alerts fire on what is ill and not on what is well, and Grafana's own types know each
key of the dashboard. Needs target/release/raystream (or RAYSTREAM), prometheus and promtool, and, beside this Python,
grafana-foundation-sdk.
"""

import hashlib
import http.server
import json
import os
import pathlib
import re
import shutil
import socket
import subprocess
import tempfile
import threading
import time
import unittest
import urllib.error
import urllib.parse
import urllib.request

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = os.environ.get("RAYSTREAM", ROOT / "target" / "release" / "raystream")
PROMETHEUS = os.environ.get("PROMETHEUS", "prometheus")
PROMTOOL = os.environ.get("PROMTOOL", "promtool")
FILES = ROOT / "docs" / "monitoring"
SCENE = json.dumps({
    "environment": [1, 1, 1],
    "materials": {"grey": {"colour": [0.5, 0.5, 0.5]}},
    "shapes": [{"shape": "sphere", "centre": [0, 0, 0], "radius": 1, "cells": 4, "material": "grey"}],
}).encode()


def free_port():
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


def dashboard():
    return json.loads((FILES / "dashboard.json").read_text())


def differences(ours, theirs, path=""):
    """Keys and values of `ours` that `theirs` lacks."""
    if isinstance(ours, dict) and isinstance(theirs, dict):
        for key, value in ours.items():
            if key not in theirs:
                yield f"{path}/{key}"
            else:
                yield from differences(value, theirs[key], f"{path}/{key}")
    elif isinstance(ours, list) and isinstance(theirs, list) and len(ours) == len(theirs):
        for index, (own, other) in enumerate(zip(ours, theirs)):
            yield from differences(own, other, f"{path}/{index}")
    elif ours != theirs:
        yield f"{path}: {ours} is {theirs}"


class Rules(unittest.TestCase):
    def tool(self, *arguments, folder=FILES):
        return subprocess.run([PROMTOOL, *arguments], cwd=folder, capture_output=True, text=True)

    def test_alerts_fire_where_they_should_and_nowhere_else(self):
        tested = self.tool("test", "rules", "alerts_test.yml")
        self.assertEqual(tested.returncode, 0, tested.stdout + tested.stderr)
        rules = (FILES / "alerts.yml").read_text()
        names = re.findall(r"alert: (\w+)", rules)
        self.assertEqual(names, re.findall(r"alertname: (\w+)", (FILES / "alerts_test.yml").read_text()))
        # The test would tell: a rule that never fires, and one that always does.
        for before, after in [("raystream_data_folder_refuses == 1", "raystream_data_folder_refuses == 2"),
                              ("raystream_oldest_waiting_seconds > 3600", "raystream_oldest_waiting_seconds > 3")]:
            with tempfile.TemporaryDirectory() as folder:
                self.assertIn(before, rules)
                (pathlib.Path(folder) / "alerts.yml").write_text(rules.replace(before, after))
                shutil.copy(FILES / "alerts_test.yml", folder)
                self.assertNotEqual(self.tool("test", "rules", "alerts_test.yml", folder=folder).returncode, 0)

    def test_grafana_knows_every_key_of_the_dashboard(self):
        from grafana_foundation_sdk.cog import plugins
        from grafana_foundation_sdk.cog.encoder import JSONEncoder
        from grafana_foundation_sdk.models.dashboard import Dashboard

        plugins.register_default_plugins()

        def lost(ours):
            theirs = json.loads(JSONEncoder().encode(Dashboard.from_json(ours)))
            return list(differences(ours, theirs))

        self.assertEqual(lost(dashboard()), [])
        wrong = dashboard()
        wrong["panels"][0]["titel"] = "a key that it does not know"
        self.assertEqual(lost(wrong), ["/panels/0/titel"])


class Refuser(http.server.BaseHTTPRequestHandler):
    """Whoever calls it hears that it does not work."""

    def do_POST(self):
        self.send_error(500)

    def log_message(self, *_):
        pass


class Live(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(cls.enterClassContext(tempfile.TemporaryDirectory()))
        data = cls.folder / "data"
        log = cls.enterClassContext(open(cls.folder / "log", "wb"))
        command = [PROGRAM, "serve", "--listen", "127.0.0.1:0", "--data", data, "--tracer", "cpu",
                   "--webhook-network", "127.0.0.1", "--max-jobs", "3"]
        cls.service = cls.begin(command, log)
        cls.url, cls.token = cls.service.stdout.readline().strip().split("/#token=")
        made = subprocess.run([PROGRAM, "token", "add", "prometheus", "--role", "metrics", "--data", data, "-o",
                               cls.folder / "metrics.token"], capture_output=True, text=True)
        assert made.returncode == 0, made.stderr
        # The times of what has happened before it is first seen are no rates.
        cls.load()
        cls.port = free_port()
        (cls.folder / "prometheus.yml").write_text(f"""
global: {{scrape_interval: 1s, evaluation_interval: 1s}}
rule_files: [{FILES / "alerts.yml"}]
scrape_configs:
  - job_name: raystream
    authorization: {{credentials_file: {cls.folder / "metrics.token"}}}
    static_configs: [{{targets: ["{cls.url.split("//")[1]}"]}}]
""")
        cls.begin([PROMETHEUS, f"--config.file={cls.folder / 'prometheus.yml'}",
                   f"--storage.tsdb.path={cls.folder / 'tsdb'}", f"--web.listen-address=127.0.0.1:{cls.port}"], log)
        cls.wait_for(lambda: cls.ask('up{job="raystream"} == 1'))
        cls.load()
        time.sleep(5)

    @classmethod
    def begin(cls, command, log):
        process = subprocess.Popen(list(map(str, command)), stdout=subprocess.PIPE, stderr=log, text=True)
        cls.addClassCleanup(process.wait)
        cls.addClassCleanup(process.kill)
        cls.addClassCleanup(process.stdout.close)
        return process

    @classmethod
    def send(cls, method, path, body=None, token=None):
        headers = {"Authorization": f"Bearer {token or cls.token}", "Content-Type": "application/json"}
        request = urllib.request.Request(cls.url + path, data=body, method=method, headers=headers)
        try:
            with urllib.request.urlopen(request, timeout=30) as answer:
                return answer.status, answer.read()
        except urllib.error.HTTPError as refusal:
            return refusal.code, refusal.read()

    @classmethod
    def load(cls):
        """Jobs that end well and badly, refusals, and a webhook that fails."""
        refuser = http.server.HTTPServer(("127.0.0.1", 0), Refuser)
        threading.Thread(target=refuser.serve_forever, daemon=True).start()
        cls.addClassCleanup(refuser.server_close)
        cls.addClassCleanup(refuser.shutdown)
        sha256 = hashlib.sha256(SCENE).hexdigest()
        cls.send("PUT", f"/api/v1/scenes/{sha256}", SCENE)
        hook = {"url": f"http://127.0.0.1:{refuser.server_port}/", "secret": "s"}
        for seed in range(3):
            job = {"scene": sha256, "size": "16x16", "spp": 4, "seed": time.time_ns() % 2**31 + seed, "webhook": hook}
            status, answer = cls.send("POST", "/api/v1/jobs", json.dumps(job).encode())
            assert status == 202, answer
            name = json.loads(answer)["id"]
            cls.wait_for(lambda: json.loads(cls.send("GET", f"/api/v1/jobs/{name}")[1])["state"] == "done")
        cls.send("GET", "/api/v1/jobs", token="wrong")
        time.sleep(1.5)

    @staticmethod
    def wait_for(is_so):
        until = time.monotonic() + 60
        while not is_so():
            assert time.monotonic() < until
            time.sleep(0.2)

    @classmethod
    def ask(cls, expression):
        query = urllib.parse.urlencode({"query": expression})
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{cls.port}/api/v1/query?{query}", timeout=10) as answer:
                return json.loads(answer.read())["data"]["result"]
        except urllib.error.HTTPError as refusal:
            # Prometheus reads what it has stored before it answers.
            if refusal.code == 503:
                return []
            raise AssertionError(f"{expression}: {refusal.read().decode()}") from None
        except urllib.error.URLError:
            return []

    def test_each_expression_of_the_dashboard_has_data(self):
        asked = 0
        for panel in dashboard()["panels"]:
            for target in panel["targets"]:
                expression = target["expr"].replace("$instance", ".*").replace("$__rate_interval", "30s")
                found = self.ask(expression.replace("$", ""))
                numbers = [value for series in found for value in [series["value"][1]] if value != "NaN"]
                self.assertTrue(numbers, f"{panel['title']}: {expression}")
                asked += 1
        self.assertGreater(asked, 15)
        for grown in ['raystream_job_seconds_count{state="done"}', "raystream_refused_tokens_total"]:
            self.assertGreater(float(self.ask(f"sum(rate({grown}[30s]))")[0]["value"][1]), 0, grown)

    def test_alerts_are_about_measurements_that_there_are_and_none_fires(self):
        rules = (FILES / "alerts.yml").read_text()
        for name in set(re.findall(r"raystream_\w+", rules)):
            self.assertTrue(self.ask(f"count({name})"), name)
        for labels in re.findall(r"raystream_\w+\{(?:state|result)=\"(?:done|running|quarantined|failed)\"\}", rules):
            if "job_seconds" not in labels:
                self.assertTrue(self.ask(labels), labels)
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port}/api/v1/rules", timeout=10) as answer:
            [group] = json.loads(answer.read())["data"]["groups"]
        for rule in group["rules"]:
            self.assertEqual((rule["health"], rule["state"]), ("ok", "inactive"), rule)

    def test_each_measurement_says_what_it_is(self):
        token = (self.folder / "metrics.token").read_text().strip()
        status, text = self.send("GET", "/metrics", token=token)
        self.assertEqual((status, self.send("GET", "/api/v1/jobs", token=token)[0]), (200, 403))
        text = text.decode()
        kinds = dict(re.findall(r"^# TYPE (\S+) (\S+)$", text, re.M))
        helped = set(re.findall(r"^# HELP (\S+) \S", text, re.M))
        self.assertGreater(len(kinds), 15)
        self.assertEqual(set(kinds) - helped, set(), "without HELP")
        self.assertNotIn("summary", kinds.values())
        for name, kind in kinds.items():
            self.assertEqual(name.endswith("_total"), kind == "counter", name)
        checked = subprocess.run([PROMTOOL, "check", "metrics"], input=text, capture_output=True, text=True)
        self.assertEqual(checked.returncode, 0, checked.stdout + checked.stderr)


if __name__ == "__main__":
    unittest.main()
