#!/usr/bin/env python3
"""One picture of many glTF sample models, each rendered small and labelled.

    python3 -m venv .venv && .venv/bin/pip install pillow
    .venv/bin/python scripts/contact_sheet.py FOLDER -o docs/results/gltf-features.jpg

FOLDER has a folder for each model, as Khronos' glTF-Sample-Assets has. docs/results/gltf-features.md says what is to be
seen in each part of the picture. All models are lit by the same gradient with a bright patch, from above.
"""

import argparse
import pathlib
import subprocess
import tempfile

from PIL import Image, ImageDraw, ImageFont

TILE = (320, 240)
COLUMNS = 4
LABEL = 20
"""Pixels below each picture."""

MODELS = [
    ("Avocado, quantised", "Avocado/glTF-Quantized/Avocado.gltf", []),
    (
        "BoxVertexColors",
        "BoxVertexColors/glTF-Binary/BoxVertexColors.glb",
        ["--eye", "2.3,1.75,2.1", "--target", "0.5,0.5,0.5"],
    ),
    ("Cameras, perspective", "Cameras/glTF-Embedded/Cameras.gltf", ["--camera", "camera 0"]),
    ("Cameras, orthographic", "Cameras/glTF-Embedded/Cameras.gltf", ["--camera", "camera 1"]),
    ("CesiumMilkTruck", "CesiumMilkTruck/glTF-Binary/CesiumMilkTruck.glb", []),
    ("Duck", "Duck/glTF-Binary/Duck.glb", []),
    ("SimpleInstancing", "SimpleInstancing/glTF-Binary/SimpleInstancing.glb", []),
    ("UnlitTest", "UnlitTest/glTF-Binary/UnlitTest.glb", []),
]
"""Label, file, and the arguments that show it as its published picture does."""


def write_sky(path):
    """A Radiance file: grey below, white above, and a patch that is brighter."""
    width, height = 64, 32
    rows = bytearray()
    for y in range(height):
        for x in range(width):
            is_patch = 6 <= y < 10 and 40 <= x < 46
            value = 12.0 if is_patch else 0.9 if y < height // 2 else 0.45
            # RGBE: a mantissa of each channel and a shared exponent.
            exponent = max(-127, int(value).bit_length())
            mantissa = min(255, int(value / 2.0**exponent * 256.0))
            rows += bytes([mantissa, mantissa, mantissa, 128 + exponent])
    header = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n"
    path.write_bytes(header.encode() + bytes(rows))


def render(args, folder, name, arguments):
    """The picture of a model."""
    out = folder / "out.png"
    size = f"{TILE[0]}x{TILE[1]}"
    command = [args.raystream, "render", args.folder / name, "-o", out, "--size", size, "--spp", args.spp]
    command += ["--env", folder / "sky.hdr", "--view", "standard", "--tracer", "cpu", *arguments]
    subprocess.run([str(part) for part in command], check=True)
    return Image.open(out).convert("RGB")


def main():
    """Renders all models and writes the sheet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("-o", "--output", type=pathlib.Path, required=True)
    parser.add_argument("--raystream", default="target/release/raystream")
    parser.add_argument("--spp", type=int, default=256)
    args = parser.parse_args()
    rows = -(-len(MODELS) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * TILE[0], rows * (TILE[1] + LABEL)), "white")
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(14)
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        write_sky(folder / "sky.hdr")
        for i, (label, name, arguments) in enumerate(MODELS):
            x, y = i % COLUMNS * TILE[0], i // COLUMNS * (TILE[1] + LABEL)
            sheet.paste(render(args, folder, name, arguments), (x, y))
            draw.text((x + 6, y + TILE[1] + 2), label, fill="black", font=font)
    sheet.save(args.output, quality=90)


if __name__ == "__main__":
    main()
