"""Wheels that are packed without compiling: they install, have their hashes, and are the same each time."""

import base64
import hashlib
import subprocess
import sys
import tempfile
import unittest
import venv
import zipfile
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[2]


def pack(what, built, folder):
    """Packs a wheel and returns its path."""
    command = [sys.executable, CHECKOUT / "scripts/pack_wheel.py", what, built, folder]
    subprocess.run(command, check=True, capture_output=True)
    (wheel,) = Path(folder).glob("*.whl")
    return wheel


class Wheels(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def test_the_program_is_installed_and_runs(self):
        # Any program will do.
        program = self.folder / "raystream"
        program.write_bytes(Path("/bin/echo").read_bytes())
        wheel = pack("program", program, self.folder / "a")
        self.assertEqual(wheel.read_bytes(), pack("program", program, self.folder / "b").read_bytes())
        venv.create(self.folder / "venv", with_pip=True)
        pip = [self.folder / "venv/bin/pip", "install", "--quiet", "--disable-pip-version-check", "--no-index", wheel]
        subprocess.run(pip, check=True)
        output = subprocess.run([self.folder / "venv/bin/raystream", "hello"], capture_output=True, text=True)
        self.assertEqual((output.returncode, output.stdout), (0, "hello\n"))

    def test_the_module_comes_with_its_package_and_all_hashes(self):
        library = self.folder / "lib_raystream.so"
        library.write_bytes(Path("/bin/echo").read_bytes())
        with zipfile.ZipFile(pack("module", library, self.folder / "a")) as wheel:
            names = set(wheel.namelist())
            package = CHECKOUT / "python/raystream"
            files = [file for file in package.rglob("*") if file.suffix in (".py", ".pyi")]
            self.assertLessEqual({f"raystream/{file.relative_to(package)}" for file in files}, names)
            self.assertLessEqual({"raystream/py.typed", "raystream/_raystream.abi3.so"}, names)
            (record,) = [name for name in names if name.endswith("/RECORD")]
            lines = [line.rsplit(",", 2) for line in wheel.read(record).decode().splitlines()]
            self.assertEqual({name for name, _, _ in lines}, names)
            for name, digest, size in lines:
                if name != record:
                    content = wheel.read(name)
                    found = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
                    self.assertEqual((digest, size), (f"sha256={found}", str(len(content))))
            (metadata,) = [wheel.read(name).decode() for name in names if name.endswith("/METADATA")]
            self.assertIn("\nRequires-Dist: numpy", metadata)
            self.assertIn("Provides-Extra: test\n", metadata)


if __name__ == "__main__":
    unittest.main()
