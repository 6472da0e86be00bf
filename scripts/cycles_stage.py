"""What pictures by Cycles beside raystream's have in common. Needs the package `bpy`, which is imported when used."""

import math

import numpy as np


def empty_stage(size, samples):
    """A scene without objects that Cycles renders on the CPU: a box filter, no denoising, no adaptive samples."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    stage = bpy.context.scene
    render, cycles = stage.render, stage.cycles
    render.engine, cycles.device = "CYCLES", "CPU"
    render.resolution_x, render.resolution_y = size
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
    cycles.samples, cycles.pixel_filter_type = samples, "BOX"
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    return stage


def light_from_around(stage, colour):
    """The same radiance from every direction."""
    import bpy

    stage.world = bpy.data.worlds.new("sky")
    stage.world.use_nodes = True
    stage.world.node_tree.nodes["Background"].inputs["Color"].default_value = [*colour, 1]


def look_from(stage, eye, target, fov):
    """Makes a camera whose vertical field of view has so many degrees. Returns its lens."""
    import bpy
    import mathutils

    lens = bpy.data.cameras.new("camera")
    lens.sensor_fit, lens.angle = "VERTICAL", math.radians(fov)
    camera = bpy.data.objects.new("camera", lens)
    back = np.subtract(eye, target)
    back = back / np.linalg.norm(back)
    right = np.cross([0, 1, 0], back)
    right = right / np.linalg.norm(right)
    columns = np.stack([right, np.cross(back, right), back, eye], axis=1)
    camera.matrix_world = mathutils.Matrix([*columns.tolist(), [0, 0, 0, 1]])
    stage.collection.objects.link(camera)
    stage.camera = camera
    return lens


def pixels_of(path, size):
    """Red, green and blue of an image file, rows from below."""
    import bpy

    image = bpy.data.images.load(str(path))
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return pixels.reshape(size[1], size[0], 4)[..., :3]
