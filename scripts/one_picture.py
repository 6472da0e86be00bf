#!/usr/bin/env python3
"""One picture, whoever traces it: a table of hashes.

Renders each scene with the CPU, a GPU, both, and a GPU that fails in every way that can be injected, and prints a row
of a Markdown table a scene: whether all hashes are the CPU's, and what shares of the GPU's rays were flagged, traced
again, and traced again because alpha decides about a candidate.

    python scripts/one_picture.py target/release/raystream SCENE.. [-- OPTIONS of raystream render]
"""

import json
import os
import subprocess
import sys
import tempfile

FAULTS = ["gpu-lost@2", "gpu-hang@2", "gpu-oom", "gpu-inexact", "gpu-corrupt@14"]
OPTIONS = ["--size", "320x180", "--spp", "2"]


def render(program, scene, options, folder):
    """The report of a render, and how it ended."""
    stats = os.path.join(folder, "stats.json")
    command = [program, "render", scene, "-o", os.path.join(folder, "out.png"), "--stats", stats, *options]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode not in (0, 1):
        sys.exit(f"{' '.join(command)}: {done.stderr}")
    with open(stats, encoding="utf-8") as file:
        return json.load(file), done.returncode


def row(program, scene, options, folder):
    """The row of a scene."""
    cpu, _ = render(program, scene, [*options, "--tracer", "cpu"], folder)
    expected = cpu["image"]["hash"]

    def verdict(arguments, code):
        report, ended = render(program, scene, [*options, *arguments], folder)
        same = report["image"]["hash"] == expected
        return report, ("same" if same else "DIFFERS") + ("" if ended == code else f", exit code {ended}")

    gpu, alone = verdict(["--tracer", "gpu"], 0)
    unit = gpu["units"]["gpu"]
    share = lambda name: f"{unit[name] / max(unit['rays'], 1):.1e}"
    cells = [os.path.basename(scene), f"{cpu['scene']['triangles']:,}", alone]
    cells.append(verdict(["--tracer", "hybrid"], 0)[1])
    cells += [verdict(["--tracer", "gpu", "--inject", fault, "--strict"], 1)[1] for fault in FAULTS]
    return cells + [share("flagged"), share("retraced"), share("masked")]


def main():
    arguments = sys.argv[1:]
    options = OPTIONS
    if "--" in arguments:
        at = arguments.index("--")
        arguments, options = arguments[:at], arguments[at + 1 :]
    if len(arguments) < 2:
        sys.exit(__doc__)
    program, scenes = arguments[0], arguments[1:]
    heads = ["scene", "triangles", "GPU", "hybrid", *FAULTS, "flagged", "traced again", "of them masked"]
    print("| " + " | ".join(heads) + " |\n" + "|---" * len(heads) + "|", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        for scene in scenes:
            print("| " + " | ".join(row(program, scene, options, folder)) + " |", flush=True)


if __name__ == "__main__":
    main()
