"""Control groups that hold processes to a share of a core. Linux, as root."""

import contextlib
import os
import pathlib
import sys
import time

# Microseconds: a short period, so that a worker's pauses are much shorter than its units.
PERIOD = 20_000


class Group:
    """A control group (version 1 or 2) that holds its processes to a share of a core. What else runs waits for them.

    With a `turn` its processes stay on one core, chosen by that number. What they write is then never in the cache of
    another core, as on a machine of their own.
    """

    def __init__(self, share, period=PERIOD, turn=None):
        cores = sorted(os.sched_getaffinity(0))
        self.pinning = [] if turn is None else ["taskset", "--cpu-list", str(cores[turn % len(cores)])]
        self.name = f"raystream-{os.getpid()}-{time.monotonic_ns()}"
        quota = max(1000, int(share * period))
        first, second = pathlib.Path("/sys/fs/cgroup/cpu"), pathlib.Path("/sys/fs/cgroup")
        try:
            if (first / "cpu.cfs_quota_us").exists() or (first / "cgroup.procs").exists():
                self.folder = first / self.name
                self.folder.mkdir()
                (self.folder / "cpu.cfs_period_us").write_text(str(period))
                (self.folder / "cpu.cfs_quota_us").write_text(str(quota))
                (self.folder / "cpu.shares").write_text("262144")
            elif (second / "cgroup.controllers").exists():
                self.folder = second / self.name
                self.folder.mkdir()
                (self.folder / "cpu.max").write_text(f"{quota} {period}")
                (self.folder / "cpu.weight").write_text("10000")
            else:
                sys.exit("there are no control groups here: workers cannot be held to a share of a core")
        except OSError as error:
            sys.exit(f"a control group with a share of the processor cannot be made: {error}; run this as root")

    def command(self, words):
        """A command that enters the group before it becomes the program."""
        script = 'echo $$ > "$0"; exec "$@"'
        return ["sh", "-c", script, str(self.folder / "cgroup.procs"), *self.pinning, *map(str, words)]

    def remove(self):
        for _ in range(50):
            with contextlib.suppress(OSError):
                self.folder.rmdir()
                return
            time.sleep(0.1)
