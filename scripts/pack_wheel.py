#!/usr/bin/env python3
"""Packs what Cargo has built into a wheel, without compiling anything: the module for Python, or the program.

cargo build --release --workspace --features service,raystream-python/extension-module
scripts/pack_wheel.py module target/release/lib_raystream.so target/wheel
scripts/pack_wheel.py program target/release/raystream target/wheel

The wheel is for this platform; --platform names another, manylinux_2_28_x86_64 for instance, once a program has been
linked for it. The same input gives the same bytes.
"""

import argparse
import base64
import hashlib
import subprocess
import sysconfig
import tempfile
import tomllib
import zipfile
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parent.parent

# Of the wheel that carries the program. The module's facts are those of python/pyproject.toml.
PROGRAM = {
    "name": "raystream-cli",
    "description": "Path-traces scenes, traces rays, serves pictures: the program raystream",
    "requires-python": ">=3.8",
    "license": "MIT OR Apache-2.0",
    "classifiers": ["Programming Language :: Rust", "Topic :: Multimedia :: Graphics :: 3D Rendering"],
}


class Wheel:
    """A wheel being written: a zip whose last file has the hashes of all others."""

    def __init__(self, folder, project, version, tag):
        name = project["name"].replace("-", "_")
        self.stem = f"{name}-{version}"
        self.path = Path(folder) / f"{self.stem}-{tag}.whl"
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.zip = zipfile.ZipFile(self.path, "w", zipfile.ZIP_DEFLATED, compresslevel=9)
        self.records = []

    def add(self, name, content, mode=0o644):
        """Adds a file."""
        entry = zipfile.ZipInfo(name)  # of the year 1980, always
        entry.external_attr = (0o100000 | mode) << 16
        entry.compress_type = zipfile.ZIP_DEFLATED
        self.zip.writestr(entry, content, compresslevel=9)
        digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
        self.records.append(f"{name},sha256={digest},{len(content)}\n")

    def finish(self, metadata, tag):
        """Adds the facts about the wheel."""
        info = f"{self.stem}.dist-info"
        for file in sorted(CHECKOUT.glob("LICENSE*")):
            self.add(f"{info}/licenses/{file.name}", file.read_bytes())
        self.add(f"{info}/METADATA", metadata.encode())
        lines = ["Wheel-Version: 1.0", "Generator: pack_wheel", "Root-Is-Purelib: false", f"Tag: {tag}", ""]
        self.add(f"{info}/WHEEL", "\n".join(lines).encode())
        self.zip.writestr(zipfile.ZipInfo(f"{info}/RECORD"), "".join(self.records) + f"{info}/RECORD,,\n")
        self.zip.close()


def metadata_of(project, version, readme):
    """The file METADATA of a project."""
    lines = ["Metadata-Version: 2.4", f"Name: {project['name']}", f"Version: {version}"]
    lines += [f"Summary: {project['description']}", f"License-Expression: {project['license']}"]
    lines += [f"License-File: {file.name}" for file in sorted(CHECKOUT.glob("LICENSE*"))]
    lines += [f"Requires-Python: {project['requires-python']}"]
    lines += [f"Keywords: {','.join(project['keywords'])}"] if "keywords" in project else []
    lines += [f"Classifier: {classifier}" for classifier in project.get("classifiers", [])]
    lines += [f"Requires-Dist: {needed}" for needed in project.get("dependencies", [])]
    for extra, needed in project.get("optional-dependencies", {}).items():
        lines += [f"Provides-Extra: {extra}", *(f"Requires-Dist: {one} ; extra == '{extra}'" for one in needed)]
    return "\n".join([*lines, "Description-Content-Type: text/markdown", "", readme.read_text()])


def stripped(file):
    """The content of a program or a library without symbols, where there is a tool for that."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "stripped"
        try:
            subprocess.run(["strip", "-o", copy, file], check=True)
        except FileNotFoundError:
            return file.read_bytes()
        return copy.read_bytes()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["module", "program"])
    parser.add_argument("built", type=Path, help="the library or the program that Cargo has built")
    parser.add_argument("folder", type=Path, help="where the wheel goes")
    parser.add_argument("--platform", default=sysconfig.get_platform().replace("-", "_").replace(".", "_"))
    arguments = parser.parse_args()

    version = tomllib.loads((CHECKOUT / "Cargo.toml").read_text())["workspace"]["package"]["version"]
    package = CHECKOUT / "python"
    if arguments.what == "module":
        project = tomllib.loads((package / "pyproject.toml").read_text())["project"]
        tag, readme = f"cp310-abi3-{arguments.platform}", package / "README.md"
    else:
        project, tag, readme = PROGRAM, f"py3-none-{arguments.platform}", CHECKOUT / "README.md"
    wheel = Wheel(arguments.folder, project, version, tag)
    if arguments.what == "module":
        for file in sorted((package / "raystream").rglob("*")):
            if file.suffix in (".py", ".pyi") or file.name == "py.typed":
                wheel.add(str(file.relative_to(package)), file.read_bytes())
        wheel.add("raystream/_raystream.abi3.so", stripped(arguments.built), 0o755)
    else:
        wheel.add(f"{wheel.stem}.data/scripts/{arguments.built.name}", stripped(arguments.built), 0o755)
    wheel.finish(metadata_of(project, version, readme), tag)
    print(f"{wheel.path}: {wheel.path.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
