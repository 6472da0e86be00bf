"""A service with its own nats-server, and workers, for the scripts that measure farms. Only the standard library."""

import contextlib
import http.client
import json
import pathlib
import re
import signal
import statistics
import subprocess
import sys
import time

from farm_links import COORDINATOR, OUTSIDE

ROOT = pathlib.Path(__file__).resolve().parent.parent
PROGRAM = ROOT / "target" / "release" / "raystream"
# Seconds that anything but a job or a walk may take.
PATIENCE = 300


class Service:
    """`raystream serve` with a nats-server, in a folder of its own, with words of its command line.

    `links` are those of the machines on which all of it runs, the coordinator's own with its nats-server; otherwise it
    is at the loopback address. `wrap` makes the service's command another one.
    """

    def __init__(self, program, folder, *options, links=None, wrap=list):
        self.program, self.folder, self.processes, self.logs, self.links = program, folder, [], [], links
        words = ["serve", "--data", folder / "data", *options]
        if links:
            self.nats, wrap = f"nats://{COORDINATOR}:4222", links.of("coordinator")
            server = ["nats-server", "-a", COORDINATOR, "-p", "4222"]
            self.start_program("nats", wrap(server))
            words += ["--nats", self.nats, "--insecure", "--listen", f"{OUTSIDE}:0"]
        else:
            words += ["--spawn-nats", "--listen", "127.0.0.1:0"]
        self.process = self.start("service", words, wrap, stdout=subprocess.PIPE)
        line = self.process.stdout.readline().decode().strip()
        if "/#token=" not in line:
            sys.exit(f"the service does not start:\n{(folder / 'service.log').read_text()}")
        url, self.token = line.split("/#token=")
        self.address = url.removeprefix("http://")
        if not links:
            self.nats = until("the service names its nats-server", self.find_nats)

    def start(self, name, words, wrap=list, **pipes):
        """A process of the program; `wrap` makes its command another one."""
        return self.start_program(name, wrap([self.program, *words]), **pipes)

    def start_program(self, name, command, **pipes):
        self.logs.append(open(self.folder / f"{name}.log", "wb"))
        process = subprocess.Popen(list(map(str, command)), stderr=self.logs[-1], **pipes)
        self.processes.append(process)
        return process

    def start_worker(self, name, wrap=list):
        """A worker of one thread with an empty cache, on the machine with its name if there are links."""
        words = ["worker", "--nats", self.nats, "--name", name, "--threads", "1", "--tracer", "cpu"]
        words += ["--cache", self.folder / f"cache-{name}"]
        if self.links:
            words, wrap = [*words, "--insecure"], self.links.of(name)
        else:
            words += ["--nats-key", self.folder / "data/nats/workers"]
        return self.start(name, words, wrap)

    def wait_for_workers(self, count):
        """Waits until so many workers are there."""
        def there():
            shown = self.ask("GET", "/api/v1/workers")["workers"]
            return len([worker for worker in shown if worker["state"] in ("idle", "busy")]) == count
        until(f"there are {count} workers", there)

    def find_nats(self):
        told = re.search(r"--nats (\S+)", (self.folder / "service.log").read_text())
        return told and told.group(1)

    def ask(self, method, path, body=None):
        """The answer's JSON; an answer that is no success ends the program."""
        headers = {"Authorization": f"Bearer {self.token}", "Cache-Control": "no-cache"}
        if isinstance(body, dict):
            body, headers["Content-Type"] = json.dumps(body), "application/json"
        connection = http.client.HTTPConnection(self.address, timeout=PATIENCE)
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        text = answer.read()
        connection.close()
        if answer.status >= 300:
            sys.exit(f"{method} {path}: {answer.status} {text.decode(errors='replace')}")
        return json.loads(text)

    def render(self, scene, **options):
        """A job from its request to its end: its state and its picture's hash."""
        job = self.ask("POST", "/api/v1/jobs", {"scene": scene, **options})["id"]
        while (state := self.ask("GET", f"/api/v1/jobs/{job}"))["state"] in ("queued", "running"):
            time.sleep(0.1)
        if state["state"] != "done":
            sys.exit(f"the job is {state['state']}: {state['error']}")
        return state

    def end(self):
        end(reversed(self.processes))
        [log.close() for log in self.logs]


def end(processes):
    """Asks processes to end, and ends those that do not."""
    processes = list(processes)
    for process in processes:
        process.send_signal(signal.SIGTERM)
    for process in processes:
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(20)
        process.kill()
        process.wait()


def until(what, found):
    """What `found` returns once it is something."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        if result := found():
            return result
        time.sleep(0.05)
    sys.exit(f"it takes too long until {what}")


def seconds(state):
    """Seconds between the request of a job and its end."""
    return (state["ended_ms"] - state["created_ms"]) / 1000


def spread(values):
    return {"median": statistics.median(values), "best": min(values), "worst": max(values)}


def write(path, name, program, rows):
    """The file of a script's measurements: the machine as `raystream info` names it, the command, the rows."""
    told = subprocess.run([program, "info"], check=True, capture_output=True, text=True).stdout
    find = lambda word: (re.search(rf"^{word}: *(.*)$", told, re.MULTILINE) or [None, None])[1]
    machine = {
        "processor": find("processor"), "threads": int(find("host threads")),
        "simd": find("simd").split(",")[0].split(" ")[0],
    }
    given = [
        pathlib.Path(word).name if "/" in word else word
        for before, word in zip(sys.argv[1:], sys.argv[2:]) if "--program" not in (before, word)
    ]
    sheet = {"machine": machine, "command": [f"scripts/{name}", path.name, *given], "rows": rows}
    path.write_text(json.dumps(sheet, indent=1) + "\n")
