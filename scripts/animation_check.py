#!/usr/bin/env python3
"""Compares the vertices of animated glTF files with an evaluation in numpy that shares no code with raystream.

    scripts/animation_check.py RAYSTREAM FILE.. [--markdown]

Each animation of each file is evaluated at five times, the last of them after its last key, and compared corner by
corner with `raystream mesh FILE --time T`. Nodes (translation, rotation, scale, by plain channels or by pointers),
STEP, LINEAR and CUBICSPLINE, skins with any number of joints for each vertex, and morph targets are evaluated in 64-bit
floats. The difference may be 1e-5 of the largest coordinate, or 1e-5 where that is below 1. Needs NumPy.
"""

import argparse
import base64
import json
import pathlib
import re
import struct
import subprocess
import sys
import tempfile
import urllib.parse

import numpy as np

LIMIT = 1e-5
# The times of a comparison, as shares of the animation's length.
TIMES = [0.0, 0.13, 0.5, 0.87, 1.1]
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
TYPES = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
TRIANGLES, STRIP, FAN = 4, 5, 6


class File:
    """A glTF or GLB file with its buffers."""

    def __init__(self, path):
        self.path = path
        data = path.read_bytes()
        binary = b""
        if data[:4] == b"glTF":
            length = struct.unpack_from("<I", data, 12)[0]
            text, rest = data[20 : 20 + length], data[20 + length :]
            binary = rest[8 : 8 + struct.unpack_from("<I", rest)[0]] if rest else b""
        else:
            text = data
        self.json = json.loads(text)
        self.buffers = [self.buffer(buffer.get("uri"), binary) for buffer in self.json.get("buffers", [])]

    def buffer(self, uri, binary):
        if uri is None:
            return binary
        if uri.startswith("data:"):
            return base64.b64decode(uri.split(",", 1)[1])
        return (self.path.parent / urllib.parse.unquote(uri)).read_bytes()

    def part(self, view, offset, kind, width, count):
        """Elements in a buffer view."""
        view = self.json["bufferViews"][view]
        kind = np.dtype(kind).newbyteorder("<")
        stride = view.get("byteStride", 0) or kind.itemsize * width
        start = view.get("byteOffset", 0) + offset
        return np.ndarray((count, width), kind, self.buffers[view["buffer"]], start, (stride, kind.itemsize)).copy()

    def accessor(self, index, normalise=True):
        """The elements of an accessor as rows."""
        accessor = self.json["accessors"][index]
        kind, width, count = TYPES[accessor["componentType"]], WIDTHS[accessor["type"]], accessor["count"]
        if "bufferView" in accessor:
            rows = self.part(accessor["bufferView"], accessor.get("byteOffset", 0), kind, width, count)
        else:
            rows = np.zeros((count, width), kind)
        if sparse := accessor.get("sparse"):
            places, values = sparse["indices"], sparse["values"]
            where = self.part(
                places["bufferView"], places.get("byteOffset", 0), TYPES[places["componentType"]], 1, sparse["count"]
            )
            rows[where[:, 0]] = self.part(
                values["bufferView"], values.get("byteOffset", 0), kind, width, sparse["count"]
            )
        if not normalise or kind == np.float32:
            return rows if not normalise else rows.astype(np.float64)
        rows = rows.astype(np.float64)
        if accessor.get("normalized"):
            rows = np.maximum(rows / np.iinfo(kind).max, -1.0)
        return rows


def slerp(a, b, share):
    """Between two quaternions as glTF's appendix C has it, the shorter way."""
    cosine = a @ b
    if cosine < 0:
        b, cosine = -b, -cosine
    if cosine > 1 - 1e-12:
        return a + share * (b - a)
    angle = np.arccos(cosine)
    return (np.sin((1 - share) * angle) * a + np.sin(share * angle) * b) / np.sin(angle)


def value_at(file, sampler, time, is_rotation):
    """The value of a channel at a time; all targets of weights in one row."""
    times = file.accessor(sampler["input"])[:, 0]
    values = file.accessor(sampler["output"])
    way = sampler.get("interpolation", "LINEAR")
    parts = 3 if way == "CUBICSPLINE" else 1
    # One row a key: of a cubic the tangent before, the value, the tangent after.
    keys = values.reshape(len(times), parts, -1)
    unit = lambda row: row / np.linalg.norm(row) if is_rotation else row
    if time <= times[0]:
        return unit(keys[0, parts // 2])
    if time >= times[-1]:
        return unit(keys[-1, parts // 2])
    at = int(np.searchsorted(times, time, side="right")) - 1
    length = times[at + 1] - times[at]
    share = (time - times[at]) / length
    if way == "STEP":
        return unit(keys[at, 0])
    if way == "LINEAR":
        a, b = keys[at, 0], keys[at + 1, 0]
        return unit(slerp(a, b, share) if is_rotation else a + share * (b - a))
    square, cube = share**2, share**3
    spline = (
        (2 * cube - 3 * square + 1) * keys[at, 1]
        + length * (cube - 2 * square + share) * keys[at, 2]
        + (3 * square - 2 * cube) * keys[at + 1, 1]
        + length * (cube - square) * keys[at + 1, 0]
    )
    return unit(spline)


def targets(animation):
    """The list, the number, the key and the sampler of each channel that poses a node, or weighs a mesh's targets."""
    for channel in animation["channels"]:
        target = channel["target"]
        of, number, key = "nodes", target.get("node"), target["path"]
        if key == "pointer":
            pointer = target["extensions"]["KHR_animation_pointer"]["pointer"]
            pose = r"/(nodes)/(\d+)/(translation|rotation|scale|weights)|/(meshes)/(\d+)/(weights)"
            found = re.fullmatch(pose, pointer)
            if not found:
                continue
            of, number, key = [group for group in found.groups() if group]
        if number is not None:
            yield of, int(number), key, animation["samplers"][channel["sampler"]]


def matrix_of(node):
    """A node's matrix relative to its parent."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    x, y, z, w = np.array(node.get("rotation", [0, 0, 0, 1]), np.float64)
    length = np.sqrt(x * x + y * y + z * z + w * w)
    x, y, z, w = x / length, y / length, z / length, w / length
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, :3] *= np.array(node.get("scale", [1, 1, 1]), np.float64)
    matrix[:3, 3] = node.get("translation", [0, 0, 0])
    return matrix


def corners_at(file, animation, time):
    """The corners of all triangles in the world, in the order of the file's nodes: n triangles by three corners."""
    root = file.json
    posed = {key: [dict(part) for part in root[key]] for key in ["nodes", "meshes"]}
    nodes = posed["nodes"]
    for of, number, key, sampler in targets(animation):
        posed[of][number][key] = value_at(file, sampler, time, key == "rotation")
    places, order = {}, []
    scene = root["scenes"][root.get("scene", 0)]
    pending = [(number, np.eye(4)) for number in reversed(scene["nodes"])]
    while pending:
        number, above = pending.pop()
        places[number] = above @ matrix_of(nodes[number])
        order.append(number)
        pending += [(child, places[number]) for child in reversed(nodes[number].get("children", []))]
    triangles = []
    for number in order:
        node = nodes[number]
        if "mesh" not in node:
            continue
        mesh = posed["meshes"][node["mesh"]]
        weights = node.get("weights", mesh.get("weights", []))
        for primitive in mesh["primitives"]:
            positions = bent(file, primitive, weights, node, places, number)
            triangles.append(positions[indices(file, primitive, len(positions))])
    return np.concatenate(triangles)


def bent(file, primitive, weights, node, places, number):
    """The vertices of a primitive in the world."""
    attributes = primitive["attributes"]
    positions = file.accessor(attributes["POSITION"])
    for weight, target in zip(weights, primitive.get("targets", [])):
        if "POSITION" in target:
            positions = positions + weight * file.accessor(target["POSITION"])
    positions = np.concatenate([positions, np.ones((len(positions), 1))], axis=1)
    if "skin" not in node or "JOINTS_0" not in attributes:
        return (positions @ places[number].T)[:, :3]
    skin = file.json["skins"][node["skin"]]
    rest = np.tile(np.eye(4), (len(skin["joints"]), 1, 1))
    if "inverseBindMatrices" in skin:
        rest = file.accessor(skin["inverseBindMatrices"])[: len(rest)].reshape(-1, 4, 4).transpose(0, 2, 1)
    joints = np.stack([places[joint] for joint in skin["joints"]]) @ rest
    sets = [key[7:] for key in attributes if key.startswith("JOINTS_")]
    followed = np.concatenate([file.accessor(attributes[f"JOINTS_{set}"], False) for set in sets], axis=1)
    shares = np.concatenate([file.accessor(attributes[f"WEIGHTS_{set}"]) for set in sets], axis=1)
    shares = shares / shares.sum(axis=1, keepdims=True)
    matrices = np.zeros((len(positions), 4, 4))
    for joint, share in zip(followed.T, shares.T):
        matrices += share[:, None, None] * joints[np.where(share > 0, joint, 0)]
    return np.einsum("vij,vj->vi", matrices, positions)[:, :3]


def indices(file, primitive, count):
    """The corners of a primitive's triangles."""
    mode = primitive.get("mode", TRIANGLES)
    every = file.accessor(primitive["indices"], False)[:, 0] if "indices" in primitive else np.arange(count)
    if mode == TRIANGLES:
        return every[: len(every) // 3 * 3].reshape(-1, 3)
    if mode == STRIP:
        rows = np.stack([every[:-2], every[1:-1], every[2:]], axis=1)
        rows[1::2] = rows[1::2, [0, 2, 1]]
        return rows
    if mode == FAN:
        return np.stack([every[1:-1], every[2:], np.full(len(every) - 2, every[0])], axis=1)
    sys.exit(f"{file.path}: a primitive of mode {mode} has no triangles")


def of_raystream(program, path, name, time):
    """The corners that raystream has."""
    with tempfile.TemporaryDirectory() as folder:
        arrays = pathlib.Path(folder) / "mesh.npz"
        command = [program, "mesh", path, "-o", arrays, "--time", repr(time), "--animation", name, "--allow-missing"]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            sys.exit(f"{path}: {done.stderr.strip()}")
        with np.load(arrays) as mesh:
            return mesh["vertices"].astype(np.float64)[mesh["triangles"]]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("raystream")
    parser.add_argument("files", type=pathlib.Path, nargs="+")
    parser.add_argument("--markdown", action="store_true", help="print rows of a table")
    args = parser.parse_args()
    failed, pattern = False, "| {} | {} | {} | {:.3g} | {:.1e} |" if args.markdown else "{}: {}; {}, {:.3g}: {:.1e}"
    for path in args.files:
        file = File(path)
        animations = file.json.get("animations", [])
        worst, largest, triangles, moved = 0.0, 0.0, 0, 0.0
        for number, animation in enumerate(animations):
            ends = [file.accessor(sampler["input"])[:, 0].max() for sampler in animation["samplers"]]
            poses = []
            for share in TIMES:
                time = float(share * max(ends))
                expected = corners_at(file, animation, time)
                found = of_raystream(args.raystream, path, animation.get("name", f"animation {number}"), time)
                if found.shape != expected.shape:
                    sys.exit(f"{path}: {len(found)} triangles, not {len(expected)}")
                # A triangle that is mirrored is turned round.
                turned = np.abs(found[:, [0, 2, 1]] - expected).max(axis=(1, 2), initial=0.0)
                straight = np.abs(found - expected).max(axis=(1, 2), initial=0.0)
                size = max(1.0, np.abs(expected).max())
                worst = max(worst, np.minimum(turned, straight).max() / size)
                largest, triangles = max(largest, np.abs(expected).max()), len(expected)
                poses.append(expected)
            moved = max(moved, *(np.abs(pose - poses[0]).max() for pose in poses))
        is_wrong = not animations or worst > LIMIT or moved == 0.0
        failed |= is_wrong
        print(pattern.format(path.stem, len(animations), triangles, largest, worst) + (" WRONG" if is_wrong else ""))
    sys.exit(failed)


if __name__ == "__main__":
    main()
