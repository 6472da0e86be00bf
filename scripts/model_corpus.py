#!/usr/bin/env python3
"""All models of Khronos' glTF-Asset-Generator, each rendered beside the picture that was published with it.

    git clone https://github.com/KhronosGroup/glTF-Asset-Generator
    python3 -m venv .venv && .venv/bin/pip install pillow
    .venv/bin/python scripts/model_corpus.py glTF-Asset-Generator/Output sheets

Renders each model from the manifest's camera by raystream's default light. Writes a sheet for each folder of models:
published pictures above, raystream's below. Prints a table in Markdown: models shown, refused, and failures, which are
ends by anything but a picture or an error. Exits with 1 if there is one.
"""

import argparse
import concurrent.futures
import json
import pathlib
import subprocess
import sys
import tempfile

from PIL import Image, ImageDraw, ImageFont

SIZE, LABEL, COLUMNS = 160, 14, 8
FOV = 45.8
"""Degrees: that of the published pictures."""


def groups(manifest):
    """The folders of models, and the models of each."""
    for entry in manifest:
        if "models" in entry:
            yield entry["folder"], entry["models"]


def render(args, folder, model, out):
    """The exit code, and what was said."""
    eye = model.get("camera", {}).get("translation")
    view = [f"--eye={','.join(map(str, eye))}", "--target=0,0,0", f"--fov={FOV}"] if eye else []
    file = args.folder / folder / model["fileName"]
    command = [args.raystream, "render", file, "-o", out, "--size", f"{SIZE}x{SIZE}", "--spp", args.spp, *view]
    command += ["--view", "standard", "--tracer", "cpu", "--threads", 1, *args.options]
    try:
        done = subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=120)
    except subprocess.TimeoutExpired:
        return "more than 120 s", ""
    return done.returncode, done.stderr


def sheet(rows, path):
    """Published pictures above raystream's, with the models' numbers."""
    lines = -(-len(rows) // COLUMNS)
    high = 2 * SIZE + LABEL
    whole = Image.new("RGB", (min(len(rows), COLUMNS) * SIZE, lines * high), "white")
    draw, font = ImageDraw.Draw(whole), ImageFont.load_default()
    for number, (name, published, own) in enumerate(rows):
        x, y = number % COLUMNS * SIZE, number // COLUMNS * high
        for place, picture in enumerate((published, own)):
            if picture and picture.exists():
                small = Image.open(picture).convert("RGB").resize((SIZE, SIZE), Image.LANCZOS)
                whole.paste(small, (x, y + place * SIZE))
        draw.text((x + 4, y + 2 * SIZE + 1), name, fill="black", font=font)
    whole.save(path, quality=88)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path, help="the generator's folder Output, which has Manifest.json")
    parser.add_argument("sheets", type=pathlib.Path, help="folder for the sheets, which is made")
    parser.add_argument("--raystream", default="target/release/raystream")
    parser.add_argument("--spp", default=32)
    parser.add_argument("--threads", type=int, default=2, help="models at a time")
    parser.add_argument("options", nargs="*", help="further options of raystream render, after --")
    args = parser.parse_args()
    args.sheets.mkdir(parents=True, exist_ok=True)
    manifest = json.loads((args.folder / "Manifest.json").read_text())
    failures = 0
    print("| models | shown | refused | failures |\n|---|---:|---:|---:|")
    with tempfile.TemporaryDirectory() as temporary, concurrent.futures.ThreadPoolExecutor(args.threads) as pool:
        for folder, models in groups(manifest):
            outs = [pathlib.Path(temporary) / f"{folder.replace('/', '-')}-{i}.png" for i in range(len(models))]
            answers = list(pool.map(lambda of: render(args, folder, *of), zip(models, outs)))
            rows, refused, failed = [], [], []
            for model, out, (code, said) in zip(models, outs, answers):
                name = pathlib.Path(model["fileName"]).stem
                image = model.get("sampleImageName")
                rows.append((name.rpartition("_")[2], args.folder / folder / image if image else None, out))
                last = said.strip().splitlines()[-1] if said.strip() else ""
                if code == 2:
                    refused.append((name, last))
                elif code != 0:
                    failed.append((name, f"{code}: {last}"))
            shown = len(models) - len(refused) - len(failed)
            print(f"| {folder} ({len(models)}) | {shown} | {len(refused)} | {len(failed)} |", flush=True)
            for name, last in refused + failed:
                print(f"{name}: {last}", file=sys.stderr)
            failures += len(failed)
            sheet(rows, args.sheets / f"{folder.replace('/', '-')}.jpg")
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
