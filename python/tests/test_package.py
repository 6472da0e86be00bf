"""What the package weighs, and what its import takes and touches."""

import os
import subprocess
import sys
import unittest
import zlib
from pathlib import Path

import raystream as rs

IMPORTS = """
import time, numpy
begun = time.perf_counter()
import raystream
print((time.perf_counter() - begun) * 1e3)
"""

LIBRARIES = """
import raystream
import os
print(open("/proc/self/maps").read())
print([open(f"/proc/self/task/{task}/comm").read() for task in os.listdir("/proc/self/task")])
"""


def output(program):
    """What a program prints."""
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout


class Package(unittest.TestCase):
    @unittest.skipIf("RAYSTREAM_SANITIZER" in os.environ, "its module is not optimised")
    def test_its_wheel_is_small(self):
        files = [file for file in Path(rs.__file__).parent.rglob("*") if file.is_file() and file.suffix != ".pyc"]
        # As a wheel holds them. Wheels for others (scripts/wheels) are below 10 MB; CI's shares its libraries with the
        # program, and so has what only the service asks of them.
        self.assertLess(sum(len(zlib.compress(file.read_bytes())) for file in files), 10.5e6)

    def test_its_import_is_quick(self):
        self.assertLess(min(float(output(IMPORTS)) for _ in range(5)), 50)

    @unittest.skipUnless(Path("/proc/self/maps").exists(), "this system does not list its libraries")
    def test_its_import_touches_no_driver_and_starts_no_thread(self):
        maps = output(LIBRARIES)
        self.assertIn("_raystream", maps)
        self.assertNotIn("raystream-0", maps)
        for library in ("libcuda", "libvulkan", "libGL", "libEGL", "nvidia"):
            self.assertNotIn(library, maps)


if __name__ == "__main__":
    unittest.main()
