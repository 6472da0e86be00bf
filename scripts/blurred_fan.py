#!/usr/bin/env python3
"""A fan blurred by its motion, by raystream and by Cycles: the same geometry, lamp, camera, shutter and samples.

    python3 -m venv .venv && .venv/bin/pip install bpy==5.0.1 numpy pillow
    .venv/bin/python scripts/blurred_fan.py fan.png

Four blades turn once a second before a wall. Both programs open the shutter for a twelfth of a second around the same
moment. Writes Cycles' picture beside raystream's, and prints for each number of shutter steps how far means of blocks
of 10 x 10 pixels are apart.
"""

import argparse
import base64
import json
import math
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
from PIL import Image

from agree_with_mitsuba import quad
from cycles_stage import empty_stage, light_from_around, look_from, pixels_of
from peer_rooms import box, joined

EYE, TARGET, FOV = (1.2, 0.6, 4.2), (0, 0.1, 0), 45
SIZE, BLOCK = (480, 360), 10
TIME, SHUTTER, FPS = 0.5, 1 / 12, 24
LAMP = 12.0
COLOURS = [(0.8, 0.1, 0.05), (0.2, 0.2, 0.2), (0.6, 0.6, 0.55), (0, 0, 0)]


def parts():
    """The blades, which turn about z, the hub, wall and floor, and the lamp."""
    points, faces = box((0.15, -0.12, -0.03), (1.1, 0.12, 0.03))
    quarter = np.array([(0, 1, 0), (-1, 0, 0), (0, 0, 1)])
    blades = joined((points @ np.linalg.matrix_power(quarter, k), faces) for k in range(4))
    room = joined([quad((-3, -2, -1), (6, 0, 0), (0, 4.5, 0)), quad((-3, -1.3, 3), (6, 0, 0), (0, 0, -4))])
    return [blades, box((-0.15,) * 3, (0.15,) * 3), room, quad((-1, 2.4, 0.2), (2, 0, 0), (0, 0, 1.6))]


def write_gltf(path):
    """The fan with an animation of a turn in eight keys."""
    data, views, accessors = bytearray(), [], []

    def accessor(values, kind, component):
        raw = np.ascontiguousarray(values).tobytes()
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(raw)})
        data.extend(raw)
        accessors.append({"bufferView": len(views) - 1, "componentType": component, "type": kind, "count": len(values)})
        return len(accessors) - 1

    meshes, materials = [], []
    for number, ((points, faces), colour) in enumerate(zip(parts(), COLOURS)):
        attributes = {"POSITION": accessor(points.astype(np.float32), "VEC3", 5126)}
        indices = accessor(faces.astype(np.uint32).ravel(), "SCALAR", 5125)
        meshes.append({"primitives": [{"attributes": attributes, "indices": indices, "material": number}]})
        matte = {"baseColorFactor": [*colour, 1], "metallicFactor": 0}
        extensions = {"KHR_materials_specular": {"specularFactor": 0}}
        materials.append({"pbrMetallicRoughness": matte, "doubleSided": True, "extensions": extensions})
    materials[3]["emissiveFactor"] = [1, 1, 1]
    materials[3]["extensions"]["KHR_materials_emissive_strength"] = {"emissiveStrength": LAMP}
    keys = np.arange(9, dtype=np.float32) / 8
    turns = np.stack([0 * keys, 0 * keys, np.sin(math.pi * keys), np.cos(math.pi * keys)], axis=1)
    sampler = {"input": accessor(keys, "SCALAR", 5126), "output": accessor(turns, "VEC4", 5126)}
    channel = {"sampler": 0, "target": {"node": 0, "path": "rotation"}}
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    document = {
        "asset": {"version": "2.0"}, "scenes": [{"nodes": [0, 1, 2, 3]}], "nodes": [{"mesh": k} for k in range(4)],
        "extensionsUsed": ["KHR_materials_emissive_strength", "KHR_materials_specular"], "meshes": meshes,
        "materials": materials, "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": len(data), "uri": uri}],
        "animations": [{"name": "turn", "samplers": [sampler], "channels": [channel]}],
    }
    path.write_text(json.dumps(document))


def by_raystream(args, folder, steps):
    out, text = folder / "out.npy", lambda vector: ",".join(map(str, vector))
    command = [args.raystream, "render", folder / "fan.gltf", "-o", out, "--time", TIME, "--shutter", SHUTTER]
    command += ["--shutter-steps", steps, f"--eye={text(EYE)}", f"--target={text(TARGET)}", "--fov", FOV]
    command += ["--size", f"{SIZE[0]}x{SIZE[1]}", "--spp", args.spp, "--env", "0,0,0"]
    subprocess.run([str(word) for word in command], check=True, capture_output=True)
    return np.load(out)[..., :3]


def by_cycles(args, folder):
    import bpy

    stage = empty_stage(SIZE, args.spp)
    render, cycles = stage.render, stage.cycles
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    for kind in ("max", "diffuse", "min_light"):
        setattr(cycles, f"{kind}_bounces", 8)
    objects = []
    for number, ((points, faces), colour) in enumerate(zip(parts(), COLOURS)):
        mesh = bpy.data.meshes.new("mesh")
        mesh.from_pydata(points.tolist(), [], faces.tolist())
        mesh.shade_flat()
        material = bpy.data.materials.new("surface")
        material.use_nodes = True
        nodes, links = material.node_tree.nodes, material.node_tree.links
        nodes.clear()
        kind = "ShaderNodeEmission" if number == 3 else "ShaderNodeBsdfDiffuse"
        surface = nodes.new(kind)
        surface.inputs["Color"].default_value = (1, 1, 1, 1) if number == 3 else (*colour, 1)
        if number == 3:
            surface.inputs["Strength"].default_value = LAMP
        links.new(surface.outputs[0], nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
        mesh.materials.append(material)
        objects.append(bpy.data.objects.new("part", mesh))
        stage.collection.objects.link(objects[-1])
    blades = objects[0]
    render.fps = FPS
    for frame in (0, 10 * FPS):
        blades.rotation_euler = (0, 0, 2 * math.pi * frame / FPS)
        blades.keyframe_insert("rotation_euler", frame=frame)
    action = blades.animation_data.action
    for curve in action.layers[0].strips[0].channelbag(action.slots[0]).fcurves:
        for key in curve.keyframe_points:
            key.interpolation = "LINEAR"
    stage.frame_set(round(TIME * FPS))
    render.use_motion_blur, render.motion_blur_shutter = True, SHUTTER * FPS
    render.motion_blur_position, blades.cycles.motion_steps = "CENTER", 7
    light_from_around(stage, (0, 0, 0))
    look_from(stage, EYE, TARGET, FOV)
    render.filepath = str(folder / "cycles.exr")
    bpy.ops.render.render(write_still=True)
    return pixels_of(render.filepath, SIZE)[::-1]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", type=pathlib.Path, help="Cycles' picture, then one of raystream's for each --steps")
    parser.add_argument("--raystream", default="target/release/raystream")
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--steps", default="16,64", help="numbers of shutter steps")
    args = parser.parse_args()
    blocks = lambda image: image.reshape(SIZE[1] // BLOCK, BLOCK, SIZE[0] // BLOCK, BLOCK, 3).mean(axis=(1, 3))
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        write_gltf(folder / "fan.gltf")
        own = {steps: by_raystream(args, folder, steps) for steps in args.steps.split(",")}
        cycles = by_cycles(args, folder)
    print(f"means: Cycles {cycles.mean():.4f}")
    for steps, image in own.items():
        apart = np.abs(blocks(image) - blocks(cycles))
        print(f"{steps} steps {image.mean():.4f}; apart {apart.mean():.5f} in the mean, {apart.max():.5f} at most")
    shown = np.clip(np.concatenate([cycles, *own.values()], axis=1) * 0.8, 0, 1) ** (1 / 2.2)
    Image.fromarray((shown * 255).astype(np.uint8)).save(args.output)


if __name__ == "__main__":
    sys.exit(main())
