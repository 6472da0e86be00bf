#!/usr/bin/env python3
"""Compares depths and labels of Drake's route with the pictures that drake-blender publishes for its tests.

    scripts/agree_with_drake_blender.py DRAKE_BLENDER URL

DRAKE_BLENDER is a checkout of https://github.com/RobotLocomotion/drake-blender, URL what `raystream serve` prints. The
limits are those of its tests: 1 mm of depth, equal labels, and at most 2 % of the pixels beyond that. Needs NumPy,
Pillow and requests.
"""

import io
import pathlib
import sys

import numpy
import requests
from PIL import Image

# Scene, kind, published picture, limit, and the sensor's range in metres.
CASES = [
    ("two_rgba_boxes", "depth", "depth", 1, (0.01, 10)),
    ("two_rgba_boxes", "depth", "depth_clipped", 1, (0.32, 0.33)),
    ("two_rgba_boxes", "label", "label", 0, None),
    ("one_rgba_one_texture_boxes", "depth", "depth", 1, (0.01, 10)),
]
# The camera of those pictures.
FORM = {
    "scene_sha256": "not compared", "width": 640, "height": 480, "near": 0.01, "far": 10, "focal_x": 579.411,
    "focal_y": 579.411, "fov_x": 0.785398, "fov_y": 0.785398, "center_x": 319.5, "center_y": 239.5,
}
MOST = 0.02


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    folder, (url, token) = pathlib.Path(sys.argv[1]) / "test", sys.argv[2].split("/#token=")
    headers = {"Authorization": f"Bearer {token}", "Accept": "image/png"}
    failed = False
    for scene, kind, picture, limit, depths in CASES:
        form = {**FORM, "image_type": kind}
        if depths:
            form["min_depth"], form["max_depth"] = depths
        with open(folder / f"{scene}.gltf", "rb") as file:
            answer = requests.post(f"{url}/render", data=form, files={"scene": file}, headers=headers, timeout=300)
        if answer.status_code != 200:
            sys.exit(answer.text)
        own = numpy.array(Image.open(io.BytesIO(answer.content))).astype(float)
        theirs = numpy.array(Image.open(folder / f"{picture}.png")).astype(float)
        # Labels have an alpha there, which is 255.
        theirs = theirs[..., :3] if kind == "label" else theirs
        share = numpy.count_nonzero(numpy.abs(own - theirs) > limit) / own.size
        print(f"{scene}, {picture}: {100 * share:.2f} % of the values differ by more than {limit}")
        failed |= share > MOST
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
