#!/usr/bin/env python3
"""Do raystream's pictures agree with Mitsuba 3's? A z-test that knows the noise of both sides.

    python3 -m venv .venv && .venv/bin/pip install mitsuba==3.9.1 numpy
    .venv/bin/python scripts/agree_with_mitsuba.py [glass frosted metal coat mix ink sky thinlens ..]

Each scene is made here of flat triangles, written once for each program and rendered many times by both,
with other seeds each time and without Russian roulette. The spread of a block of 16 x 16 pixels over a
program's renders is its noise; two programs agree when no block differs by more than 5 standard deviations
of both and the whole picture by no more than 0.5 % in any channel. Exits with 1 when they do not.

Glass, clear and frosted, mirrors, mixes, lamps, environment maps and the medium of ink are Mitsuba's own. Mitsuba's
frosted glass loses what facets would reflect and refract a second time, raystream's does not; the glass is so smooth
here that the loss is a thousandth. Mitsuba has no glTF surface, so the BSDF below is written from the published
formulas, independently of raystream's; its reflectances are integrated here.
"""

import argparse
import base64
import json
import pathlib
import subprocess
import sys
import tempfile

import numpy as np

SIZE, BLOCK = 128, 16
EYE, TARGET, FOV = (0.0, 2.2, 5.2), (0.0, 0.9, 0.0), 40
MAX_SIGMA, MEAN_TOLERANCE = 5.0, 0.005


def sphere(centre, radius, rounds=3):
    """A ball of flat triangles."""
    g = (1 + 5**0.5) / 2
    points = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g)]
    points += [(0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]
    points = [np.array(p) / np.linalg.norm(p) for p in points]
    faces = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2)]
    faces += [(10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5)]
    faces += [(2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)]
    for _ in range(rounds):
        middles, finer = {}, []

        def middle(a, b):
            key = (min(a, b), max(a, b))
            if key not in middles:
                middles[key] = len(points)
                p = points[a] + points[b]
                points.append(p / np.linalg.norm(p))
            return middles[key]

        for a, b, c in faces:
            ab, bc, ca = middle(a, b), middle(b, c), middle(c, a)
            finer += [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        faces = finer
    return np.array(points) * radius + np.array(centre), np.array(faces)


def quad(corner, u, v):
    corner, u, v = map(np.array, (corner, u, v))
    return np.array([corner, corner + u, corner + u + v, corner + v], float), np.array([(0, 1, 2), (0, 2, 3)])


def cuboid(centre, half):
    """Six quads, their fronts outside."""
    points, faces = [], []
    for axis in range(3):
        for side in (-1, 1):
            n, a, b = np.zeros(3), np.zeros(3), np.zeros(3)
            n[axis], a[(axis + 1) % 3], b[(axis + 2) % 3] = side * half, 2 * half, 2 * half
            a, b = (a, b) if side > 0 else (b, a)
            corners, triangles = quad(np.array(centre) + n - (a + b) / 2, a, b)
            faces.append(triangles + 4 * len(points))
            points.append(corners)
    return np.concatenate(points), np.concatenate(faces)


FLOOR = (quad((-4, 0, 4), (8, 0, 0), (0, 0, -8)), {"matte": (0.5, 0.45, 0.4)})
WALL = (quad((-4, 0, -2.5), (8, 0, 0), (0, 6, 0)), {"matte": (0.3, 0.5, 0.35)})
LAMP = (quad((-1.5, 4, -1), (3, 0, 0), (0, 0, 2)), {"matte": (0, 0, 0), "lamp": (9, 8, 7)})
BALL = sphere((0, 1, 0), 1)
NEAR = (sphere((-0.7, 0.6, 2.2), 0.6), {"matte": (0.7, 0.2, 0.1)})
FAR = (sphere((0.8, 0.8, -1.2), 0.8), {"matte": (0.1, 0.2, 0.7)})
# Two fifths matte, and of the rest a third gloss and two thirds metal.
METAL, GLOSS = {"metal": (0.9, 0.6, 0.3), "roughness": 0.4}, {"gloss": (0.2, 0.3, 0.8), "roughness": 0.6}
MIX = {"mix": [{"mix": [METAL, GLOSS], "share": 1 / 3}, {"matte": (0.2, 0.6, 0.1)}], "share": 0.4}
SCENES = {
    # Under an even sky: caustics of a lamp are not normally distributed.
    "glass": dict(parts=[FLOOR, WALL, (BALL, {"glass": 1.5})], sky=(0.8, 1.0, 1.2), bounces=16),
    "frosted": dict(parts=[FLOOR, WALL, (BALL, {"frosted": 1.5, "roughness": 0.15})], sky=(0.8, 1.0, 1.2), bounces=16),
    "metal": dict(parts=[FLOOR, WALL, LAMP, (BALL, {"metal": (0.9, 0.6, 0.3), "roughness": 0.6})], bounces=4),
    "brushed": dict(
        parts=[FLOOR, WALL, LAMP, (BALL, {"metal": (0.9, 0.6, 0.3), "roughness": 0.5, "brushed": 0.7})], bounces=4
    ),
    "coat": dict(parts=[FLOOR, WALL, LAMP, (BALL, {"coat": (0.7, 0.2, 0.1), "roughness": 0.7})], bounces=4),
    "gloss": dict(parts=[FLOOR, WALL, LAMP, (BALL, {"gloss": (0.2, 0.3, 0.8), "roughness": 0.5})], bounces=4),
    "mix": dict(parts=[FLOOR, WALL, LAMP, (cuboid((0, 0.9, 0), 0.8), MIX)], bounces=4),
    # A ball of nothing but a medium, which takes colour from light by the way through it.
    "ink": dict(parts=[FLOOR, WALL, (BALL, {"ink": (0.2, 0.5, 0.8)})], sky=(0.8, 1.0, 1.2), bounces=16),
    "sky": dict(parts=[FLOOR, (BALL, {"mirror": (0.9, 0.8, 0.7)})], bounces=4),
    # Balls before and behind the plane in focus, through a wide opening; and a parallel projection.
    "thinlens": dict(parts=[FLOOR, WALL, LAMP, NEAR, FAR], bounces=4, aperture=0.3, focus=5.5),
    "parallel": dict(parts=[FLOOR, WALL, LAMP, NEAR, FAR], bounces=4, height=4.5),
}


def sky_map(u, v):
    """A gradient, clouds and a sun; u goes around, v down."""
    u, v = u[None, :, None], v[:, None, None]
    cloud = 0.2 * np.sin(2 * np.pi * 3 * u) * np.sin(np.pi * v)
    sun = 40 * np.exp(30 * (np.cos(2 * np.pi * (u - 0.3)) - 1) - ((v - 0.25) * 15) ** 2)
    return (np.array([0.6, 0.7, 1.0]) - [0.0, 0.3, 0.7] * v + cloud + sun * [1.0, 0.9, 0.7]).astype(np.float32)


def write_skies(mi, folder, width=1024, height=512):
    """The same function for both: Mitsuba's first and last rows look straight up and down, raystream's half a
    texel less; Mitsuba's middle is behind."""
    u, v = (np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height
    mi.Bitmap(sky_map(u, v)).write(str(folder / "sky.exr"))
    mi.Bitmap(sky_map(u + 0.5, np.arange(height) / (height - 1))).write(str(folder / "nodes.exr"))


# What raystream renders.


def mtl(name, material):
    colour = lambda key, c: f"{key} {c[0]} {c[1]} {c[2]}\n"
    text = f"newmtl {name}\n"
    if "glass" in material:
        return text + f"illum 7\nNi {material['glass']}\nTf 1 1 1\n"
    if "frosted" in material:
        return text + f"illum 7\nNi {material['frosted']}\nTf 1 1 1\nPr {material['roughness']}\n"
    if "mirror" in material:
        return text + "illum 3\n" + colour("Ks", material["mirror"])
    for kind, rest in {"metal": "Pm 1\n", "coat": "Ni 1.5\nPc 1\n", "gloss": "Ni 1.5\n"}.items():
        if kind in material:
            rest += f"aniso {material.get('brushed', 0)}\n"
            return text + "illum 2\n" + colour("Kd", material[kind]) + f"Pr {material['roughness']}\n" + rest
    return text + "illum 1\n" + colour("Kd", material["matte"]) + colour("Ke", material.get("lamp", (0, 0, 0)))


def write_obj(folder, scene):
    text, materials, base, coordinates = "mtllib scene.mtl\n", "", 1, 1
    for i, ((points, faces), material) in enumerate(scene["parts"]):
        materials += mtl(f"m{i}", material)
        text += f"usemtl m{i}\n" + "".join(f"v {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in points)
        if "brushed" in material:
            # Texture coordinates say along what a brushed surface is rougher: in the plane of y, along x.
            text += "".join(f"vt {x:.9g} {z:.9g}\n" for x, _, z in points)
            text += "".join("f " + " ".join(f"{v + base}/{v + coordinates}" for v in face) + "\n" for face in faces)
            coordinates += len(points)
        else:
            text += "".join("f " + " ".join(str(v + base) for v in face) + "\n" for face in faces)
        base += len(points)
    (folder / "scene.mtl").write_text(materials)
    (folder / "scene.obj").write_text(text)
    return folder / "scene.obj"


def write_gltf(folder, scene):
    """For what MTL cannot say."""
    data, views, accessors, meshes, materials = b"", [], [], [], []
    for i, ((points, faces), material) in enumerate(scene["parts"]):
        for array, kind, component in [(points.astype("<f4"), "VEC3", 5126), (faces.astype("<u4"), "SCALAR", 5125)]:
            views.append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes})
            count = array.size // (3 if kind == "VEC3" else 1)
            accessors.append({"bufferView": len(views) - 1, "componentType": component, "count": count, "type": kind})
            data += array.tobytes()
        part = {"attributes": {"POSITION": 2 * i}, "indices": 2 * i + 1, "material": i}
        meshes.append({"primitives": [part]})
        extensions = {"KHR_materials_specular": {"specularFactor": 0}}
        base = material.get("matte", (1, 1, 1))
        if "ink" in material:
            volume = {"thicknessFactor": 1, "attenuationDistance": 1, "attenuationColor": material["ink"]}
            extensions |= {"KHR_materials_ior": {"ior": 1}, "KHR_materials_volume": volume}
            extensions["KHR_materials_transmission"] = {"transmissionFactor": 1}
        pbr = {"metallicFactor": 0, "roughnessFactor": 0, "baseColorFactor": [*base, 1]}
        materials.append({"pbrMetallicRoughness": pbr, "extensions": extensions})
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    nodes = [{"mesh": i} for i in range(len(meshes))]
    whole = {"asset": {"version": "2.0"}, "buffers": [{"byteLength": len(data), "uri": uri}], "bufferViews": views}
    whole |= {"accessors": accessors, "meshes": meshes, "materials": materials, "nodes": nodes}
    whole |= {"scenes": [{"nodes": list(range(len(nodes)))}], "scene": 0}
    used = {name for material in materials for name in material["extensions"]}
    (folder / "scene.gltf").write_text(json.dumps(whole | {"extensionsUsed": sorted(used)}))
    return folder / "scene.gltf"


def write_recipe(folder, scene):
    """For mixes, which neither can say. All parts are quads."""
    materials, mixes, shapes = {}, {}, []

    def add_material(material):
        name = f"m{len(materials) + len(mixes)}"
        if "mix" in material:
            mixes[name] = None  # The name is taken.
            mixes[name] = {"of": [add_material(part) for part in material["mix"]], "share": material["share"]}
            return name
        kind = next(kind for kind in ("matte", "metal", "gloss") if kind in material)
        materials[name] = {"colour": material[kind], "metallic": int(kind == "metal")}
        materials[name] |= {"roughness": material["roughness"]} if "roughness" in material else {}
        materials[name] |= {"emission": material["lamp"]} if "lamp" in material else {}
        return name

    def add(corner, u, v, name):
        u, v = u - corner, v - corner
        shapes.append({"shape": "quad", "corner": list(corner), "u": list(u), "v": list(v), "material": name})

    for (points, _), material in scene["parts"]:
        name = add_material(material)
        for a, b, _, d in points.reshape(-1, 4, 3):
            add(a, b, d, name)
            if "lamp" in material:
                # A recipe's lamps shine on their front alone.
                above = np.array([0, 1e-3, 0])
                add(a + above, d + above, b + above, name)
    (folder / "scene.json").write_text(json.dumps({"materials": materials, "mixes": mixes, "shapes": shapes}))
    return folder / "scene.json"


def ours(args, folder, scene):
    has = lambda kind: any(kind in material for _, material in scene["parts"])
    write = write_recipe if has("mix") else write_gltf if has("ink") else write_obj
    path, out = write(folder, scene), folder / "out.npy"
    text = lambda vector: ",".join(f"{x:g}" for x in vector)
    command = [args.raystream, "render", path, "-o", out, "--tracer", "cpu", "--size", f"{SIZE}x{SIZE}"]
    command += ["--no-russian-roulette", "--max-bounces", scene["bounces"], "--spp", args.spp]
    command += [f"--eye={text(EYE)}", f"--target={text(TARGET)}"]
    command += ["--orthographic", scene["height"]] if "height" in scene else ["--fov", FOV]
    if "aperture" in scene:
        command += ["--aperture-radius", scene["aperture"], "--focus-distance", scene["focus"]]
    if "sky" in scene:
        command += [f"--env={text(scene['sky'])}"]
    elif not any("lamp" in material for _, material in scene["parts"]):
        command += ["--env", folder / "sky.exr"]
    for seed in range(args.renders):
        words = [str(word) for word in [*command, "--seed", seed]]
        subprocess.run(words, check=True, capture_output=True)
        yield np.load(out)


# What Mitsuba renders.


def reflectances(along, across):
    """What GGX facets lose in one bounce, and what they reflect of (1 - cosine)^5, over the azimuth and the cosine."""
    rng = np.random.default_rng(1)
    cosines = np.linspace(0, 1, 65)
    azimuths = np.linspace(0, np.pi / 2, 2 if along == across else 13)
    table = []
    for phi, z in [(phi, z) for phi in azimuths for z in np.maximum(cosines, 1e-4)]:
        u, v = rng.random((2, 1 << 17 if along == across else 1 << 15))
        wo = np.array([np.sqrt(1 - z * z) * np.cos(phi), np.sqrt(1 - z * z) * np.sin(phi), z])
        # Visible normals (Heitz 2018).
        vh = wo * [along, across, 1]
        vh /= np.linalg.norm(vh)
        t1 = np.array([-vh[1], vh[0], 0]) / max(np.hypot(vh[0], vh[1]), 1e-9)
        t1 = t1 if np.hypot(*t1[:2]) > 0.5 else np.array([1.0, 0, 0])
        t2 = np.cross(vh, t1)
        r, phi, s = np.sqrt(u), 2 * np.pi * v, 0.5 * (1 + vh[2])
        a, b = r * np.cos(phi), r * np.sin(phi)
        b = (1 - s) * np.sqrt(1 - a * a) + s * b
        n = a[:, None] * t1 + b[:, None] * t2 + np.sqrt(np.maximum(0, 1 - a * a - b * b))[:, None] * vh
        h = n * [along, across, 1]
        h /= np.linalg.norm(h, axis=1, keepdims=True)
        cosine = h @ wo
        wi = 2 * cosine[:, None] * h - wo
        up = wi[:, 2] > 0
        tan2 = lambda w: ((along * w[..., 0]) ** 2 + (across * w[..., 1]) ** 2) / np.maximum(w[..., 2], 1e-6) ** 2
        smith = lambda w: 0.5 * (np.sqrt(1 + tan2(w)) - 1)
        near, far = smith(wo), smith(wi)
        weight = np.where(up, (1 + near) / (1 + near + far), 0)
        table.append((1 - weight.mean(), (weight * (1 - cosine) ** 5).mean()))
    table = np.array(table).reshape(len(azimuths), len(cosines), 2)
    # Even in the azimuth, by the trapezoidal rule.
    rows = (table[1:] + table[:-1]).mean(axis=0) / 2
    fine = (np.arange(4096) + 0.5) / 4096
    mean = [np.mean(2 * fine * np.interp(fine, cosines, column)) for column in rows.T]
    return table, mean


def define_gltf(mi):
    import drjit as dr

    class Gltf(mi.BSDF):
        """glTF's metallic-roughness surface with energy-conserving facets and an optional smooth coat."""

        def __init__(self, props):
            mi.BSDF.__init__(self, props)
            self.base = mi.Color3f([props[k] for k in ("red", "green", "blue")])
            self.across = props["roughness"] ** 2
            self.along = self.across + (1 - self.across) * props["brushed"] ** 2
            self.metal, self.coated = props["metal"], props["coated"]
            table, (self.lost, self.grazing) = reflectances(self.along, self.across)
            self.azimuths = table.shape[0]
            self.table = [mi.Float(table[..., k].astype(np.float32).ravel()) for k in range(2)]
            flags = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide
            smooth = mi.BSDFFlags.DeltaReflection | mi.BSDFFlags.FrontSide
            self.m_components = [flags, smooth] if self.coated else [flags]
            self.m_flags = flags | smooth if self.coated else flags
            # The Schlick term of the dielectric, of the whole, and their further bounces.
            white = mi.Color3f(1.0)
            self.f0 = self.base if self.metal else 0.04 * white
            average = self.f0 * (20 / 21) + 1 / 21
            self.strength = average**2 * (1 - self.lost) / (1 - average * self.lost)

        def at(self, w):
            place = dr.clip(w.z, 0, 1) * 64
            low = mi.UInt32(dr.minimum(place, 63))
            share = place - mi.Float(low)
            turn = dr.atan2(dr.abs(w.y), dr.abs(w.x)) * (2 / dr.pi * (self.azimuths - 1))
            row = mi.UInt32(dr.clip(turn, 0, self.azimuths - 2))
            turned = turn - mi.Float(row)
            look = lambda t, i: dr.lerp(dr.gather(mi.Float, t, i), dr.gather(mi.Float, t, i + 1), share)
            both = lambda t: dr.lerp(look(t, row * 65 + low), look(t, row * 65 + 65 + low), turned)
            return both(self.table[0]), both(self.table[1])

        def share(self, lost, grazing):
            return self.f0 * (1 - lost - grazing) + grazing + self.strength * lost

        def coat(self, z):
            return 0.04 + 0.96 * (1 - z) ** 5 if self.coated else mi.Float(0)

        def value(self, wo, wi):
            half = dr.normalize(wo + wi)
            tan2 = lambda w: ((self.along * w.x) ** 2 + (self.across * w.y) ** 2) / w.z**2
            smith = lambda w: 0.5 * (dr.sqrt(1 + tan2(w)) - 1)
            stretch = half.z**2 + (half.x / self.along) ** 2 + (half.y / self.across) ** 2
            density = 1 / (dr.pi * self.along * self.across * stretch**2)
            facets = density / (4 * wo.z * (1 + smith(wo) + smith(wi)))
            fresnel = self.f0 + (1 - self.f0) * (1 - dr.dot(wo, half)) ** 5
            (near, near_g), (far, far_g) = self.at(wo), self.at(wi)
            value = self.strength * near * far / self.lost * wi.z / dr.pi
            if not self.metal:
                mean = 1 - self.share(self.lost, self.grazing)
                passed = (1 - self.share(near, near_g)) * (1 - self.share(far, far_g)) / mean
                value += self.base * passed * wi.z / dr.pi
            if not self.coated:
                return value + fresnel * facets
            # The coat passes the lesser share towards both directions of what facets mirror. Of what is scattered it
            # passes both shares over their mean, 1.3 % more than its own since both layers pass light from above.
            there, back = 1 - self.coat(wo.z), 1 - self.coat(wi.z)
            mean = 0.96 * 20 / 21 + 0.013
            return value * there * back / mean + fresnel * facets * dr.minimum(there, back)

        def chance(self, wo):
            return mi.Float(0.5) if self.coated else mi.Float(0)

        def density(self, wo, wi):
            return (1 - self.chance(wo)) * mi.warp.square_to_cosine_hemisphere_pdf(wi)

        def sample(self, ctx, si, sample1, sample2, active):
            wo = si.wi
            active &= wo.z > 0
            mirrored = (sample1 < self.chance(wo)) & active
            wi = dr.select(mirrored, mi.Vector3f(-wo.x, -wo.y, wo.z), mi.warp.square_to_cosine_hemisphere(sample2))
            bs = mi.BSDFSample3f(wi)
            pdf = self.density(wo, wi)
            bs.pdf = dr.select(mirrored, self.chance(wo), pdf)
            bs.eta = 1.0
            delta, glossy = mi.BSDFFlags.DeltaReflection, mi.BSDFFlags.GlossyReflection
            bs.sampled_type = dr.select(mirrored, mi.UInt32(+delta), mi.UInt32(+glossy))
            bs.sampled_component = dr.select(mirrored, mi.UInt32(1), mi.UInt32(0))
            coat = mi.Color3f(self.coat(wo.z) / dr.maximum(self.chance(wo), 1e-6))
            weight = dr.select(mirrored, coat, self.value(wo, wi) / pdf)
            active &= bs.pdf > 0
            return bs, dr.select(active, weight, mi.Color3f(0))

        def eval(self, ctx, si, wo, active):
            active &= (si.wi.z > 0) & (wo.z > 0)
            return dr.select(active, self.value(si.wi, wo), mi.Color3f(0))

        def pdf(self, ctx, si, wo, active):
            active &= (si.wi.z > 0) & (wo.z > 0)
            return dr.select(active, self.density(si.wi, wo), 0)

        def eval_pdf(self, ctx, si, wo, active):
            return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

        def to_string(self):
            return "Gltf[]"

    mi.register_bsdf("gltf", Gltf)


def bsdf(material):
    rgb = lambda c: {"type": "rgb", "value": list(c)}
    if "glass" in material:
        return {"type": "dielectric", "int_ior": material["glass"], "ext_ior": 1.0}
    if "frosted" in material:
        rough = {"distribution": "ggx", "alpha": material["roughness"] ** 2}
        return {"type": "roughdielectric", "int_ior": material["frosted"], "ext_ior": 1.0, **rough}
    if "mirror" in material:
        return {"type": "conductor", "material": "none", "specular_reflectance": rgb(material["mirror"])}
    if "ink" in material:
        return {"type": "null"}
    if "mix" in material:
        first, second = map(bsdf, material["mix"])
        return {"type": "blendbsdf", "weight": material["share"], "first": first, "second": second}
    for kind in ("metal", "coat", "gloss"):
        if kind in material:
            red, green, blue = map(float, material[kind])
            flags = {"metal": kind == "metal", "coated": kind == "coat", "brushed": material.get("brushed", 0.0)}
            colour = {"red": red, "green": green, "blue": blue}
            return {"type": "gltf", **colour, "roughness": material["roughness"], **flags}
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": rgb(material["matte"])}}


def write_ply(path, points, faces, normals=None, uvs=None):
    rows = np.empty(len(faces), dtype=[("n", "u1"), ("i", "<u4", 3)])
    rows["n"], rows["i"] = 3, faces
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    columns = {"xyz": points, "uv": points[:, [0, 2]] if uvs is None else uvs}
    columns |= {("nx", "ny", "nz"): normals} if normals is not None else {}
    header += "".join(f"property float {name}\n" for names in columns for name in names)
    header += f"element face {len(faces)}\nproperty list uchar uint vertex_indices\nend_header\n"
    vertices = np.hstack(list(columns.values())).astype("<f4")
    path.write_bytes(header.encode() + vertices.tobytes() + rows.tobytes())
    return str(path)


def theirs(mi, args, folder, scene):
    rgb = lambda c: {"type": "rgb", "value": list(c)}
    film = {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "box"}}
    view = mi.ScalarTransform4f().look_at(origin=list(EYE), target=list(TARGET), up=[0, 1, 0])
    sensor = {"type": "perspective", "fov": FOV, "fov_axis": "y", "to_world": view, "film": film}
    if "aperture" in scene:
        sensor |= {"type": "thinlens", "aperture_radius": scene["aperture"], "focus_distance": scene["focus"]}
    if "height" in scene:
        # Mitsuba's picture is two units wide before it is scaled.
        scaled = view @ mi.ScalarTransform4f().scale([scene["height"] / 2, scene["height"] / 2, 1])
        sensor = {"type": "orthographic", "to_world": scaled, "film": film}
    integrator = {"type": "path", "max_depth": scene["bounces"] + 2, "rr_depth": 10_000}
    if any("ink" in material for _, material in scene["parts"]):
        integrator["type"] = "volpath"
    whole = {"type": "scene", "integrator": integrator, "sensor": sensor}
    lit = False
    for i, ((points, faces), material) in enumerate(scene["parts"]):
        ply = write_ply(folder / f"{i}.ply", points, faces)
        part = {"type": "ply", "filename": ply, "face_normals": True, "bsdf": bsdf(material)}
        if "ink" in material:
            absorption = -np.log(material["ink"])
            scale = float(absorption.max())
            medium = {"type": "homogeneous", "albedo": 0.0, "sigma_t": rgb(absorption / scale), "scale": scale}
            part["interior"] = medium
        if "lamp" in material:
            lit = True
            # Mitsuba's lamps shine on their front alone: another lies on the back of each, a little above.
            part["emitter"] = {"type": "area", "radiance": rgb(material["lamp"])}
            back = write_ply(folder / f"{i}b.ply", points + [0, 1e-3, 0], faces[:, ::-1])
            whole[f"back{i}"] = {**part, "filename": back}
        whole[f"part{i}"] = part
    if "sky" in scene:
        whole["sky"] = {"type": "constant", "radiance": rgb(scene["sky"])}
    elif not lit:
        whole["sky"] = {"type": "envmap", "filename": str(folder / "nodes.exr")}
    scene = mi.load_dict(whole)
    for seed in range(args.renders):
        yield np.array(mi.render(scene, spp=args.spp, seed=seed + 1))


def blocks(image):
    n = SIZE // BLOCK
    return image[..., :3].reshape(n, BLOCK, n, BLOCK, 3).mean(axis=(1, 3), dtype=np.float64)


def compare(mi, args, name):
    """Prints how far the programs' pictures are apart; returns whether that is chance."""
    with tempfile.TemporaryDirectory() as folder:
        folder, scene = pathlib.Path(folder), SCENES[name]
        write_skies(mi, folder)
        pictures = [list(ours(args, folder, scene)), list(theirs(mi, args, folder, scene))]
    if args.pictures:
        for program, images in zip(["raystream", "mitsuba"], pictures):
            mean = mi.Bitmap(np.mean(images, axis=0).astype(np.float32)[..., :3])
            mi.util.write_bitmap(str(pathlib.Path(args.pictures) / f"{name}-{program}.png"), mean)
    a, b = (np.array([blocks(image) for image in images]) for images in pictures)
    noise = np.sqrt((a.var(axis=0, ddof=1) + b.var(axis=0, ddof=1)) / args.renders)
    # What has no noise, the sky itself, is interpolated by both.
    noise = np.maximum(noise, 1e-4 * b.mean(axis=0))
    sigma = np.abs(a.mean(axis=0) - b.mean(axis=0)) / noise
    off = a.mean(axis=(0, 1, 2)) / b.mean(axis=(0, 1, 2)) - 1
    worst = np.unravel_index(sigma.argmax(), sigma.shape)
    agree = sigma.max() <= MAX_SIGMA and np.abs(off).max() <= MEAN_TOLERANCE
    means = " ".join(f"{100 * x:+.3f} %" for x in off)
    print(f"{name:<8}{means}   worst block {worst[1]},{worst[0]} off by {sigma.max():.2f} sigma, "
          f"rms {np.sqrt((sigma**2).mean()):.2f}   {'agrees' if agree else 'DIFFERS'}", flush=True)
    return agree


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=list(SCENES), help=f"of {', '.join(SCENES)}")
    parser.add_argument("--raystream", default="target/release/raystream")
    parser.add_argument("--renders", type=int, default=16)
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--variant", default="llvm_ad_rgb")
    parser.add_argument("--pictures", help="a folder to write both programs' pictures to")
    args = parser.parse_args()
    args.raystream = str(pathlib.Path(args.raystream).resolve())

    import mitsuba

    mitsuba.set_variant(args.variant)
    define_gltf(mitsuba)
    if not all([compare(mitsuba, args, name) for name in args.scenes]):
        sys.exit(1)


if __name__ == "__main__":
    main()
