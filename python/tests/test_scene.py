"""Scenes of several objects: the same as a recipe's, textures, instances, mistakes, copies."""

import copy
import json
import pickle
import tempfile
import threading
import unittest
from pathlib import Path

import numpy as np
import raystream as rs
from shapes import CORNERS, FACES, icosphere

SQUARE = [[-1, -1, 0], [1, -1, 0], [-1, 1, 0], [1, 1, 0]]
HALVES = [[0, 1, 3], [0, 3, 2]]
UVS = [[0, 1], [1, 1], [0, 0], [1, 0]]
FRONT = {"size": (40, 30), "spp": 4, "max_bounces": 2, "env": "1,1,1", "eye": (0, 0, 3), "target": (0, 0, 0)}

# Materials by name, as a recipe and as Python has them.
MATERIALS = {
    "brass": {"colour": [0.9, 0.7, 0.3], "metallic": 1, "roughness": 0.25, "anisotropy": 0.5},
    "candy": {"colour": [0.8, 0.2, 0.1], "roughness": 0.4, "coats": [{"weight": 0.8, "ior": 1.6}], "clearcoat": 0.3},
    "chalk": {"colour": [0.5, 0.6, 0.4]},
    "glass": {"ior": 1.5, "absorption": {"colour": [0.5, 1, 1], "distance": 2}},
    "lamp": {"colour": [0, 0, 0], "emission": [6, 5, 4]},
    "mirror": {"colour": [0.9, 0.9, 0.9], "mirror": True},
    "veil": {"colour": [0.2, 0.3, 0.9], "alpha": 0.5, "sheen": {"colour": [1, 1, 1], "roughness": 0.5}, "roughness": 1},
}


def quad(index):
    """The corner, u and v of a square."""
    corner = [index % 3 - 1.5, index // 3 - 1.5, -0.2 * index]
    return np.array(corner), np.array([0.9, 0, 0.1]), np.array([0, 0.9, 0.05])


def square(**keywords):
    """A scene of a square with texture coordinates."""
    return rs.Scene(SQUARE, HALVES, **{"uvs": UVS, **keywords})


def hash_of(scene):
    """The hash of all that pictures can depend on."""
    return rs.open(scene, size=(8, 8), env="1,1,1", eye=(0, 0, 3)).scene_hash


class Objects(unittest.TestCase):
    def test_objects_and_materials_are_those_of_a_recipe(self):
        scene, shapes = rs.Scene(), []
        for index, (name, values) in enumerate(MATERIALS.items()):
            corner, u, v = quad(index)
            shapes.append({"shape": "quad", "corner": [*corner], "u": [*u], "v": [*v], "material": name})
            f32 = np.float32
            vertices = [(f32(corner) + f32(u) * f32(x)) + f32(v) * f32(y) for y in (0, 1) for x in (0, 1)]
            normal = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
            scene.add(
                vertices, HALVES, name=f"shape {index}", material=rs.Material(name, **values), uvs=UVS,
                normals=[normal] * 4,
            )  # fmt: skip
        spec = {**FRONT, "spp": 16, "max_bounces": 4, "aov": ["object", "material", "uv", "emission", "albedo"]}
        with tempfile.TemporaryDirectory() as folder:
            recipe = Path(folder) / "scene.json"
            recipe.write_text(json.dumps({"materials": MATERIALS, "shapes": shapes}))
            theirs = rs.render(recipe, **spec)
        ours = rs.render(scene, **spec)
        self.assertEqual(ours.names["object"], [f"shape {index}" for index in range(len(MATERIALS))])
        self.assertEqual(ours.names["material"], list(MATERIALS))
        self.assertEqual(ours.layer_hashes(), theirs.layer_hashes())
        # Normals of arrays are normalised once more.
        self.assertLess(np.abs(ours.image - theirs.image).mean(), 1e-3 * theirs.image.mean())
        self.assertEqual((len(scene), scene.materials), (len(MATERIALS), list(MATERIALS)))
        self.assertEqual(repr(scene), "Scene(7 objects, 14 triangles)")

    def test_materials_are_shared_and_changed_by_their_names(self):
        scene, red = rs.Scene(), rs.Material("red", colour=[0.8, 0.1, 0.1])
        scene.add(SQUARE, HALVES, material=red)
        scene.add(rs.Mesh(*icosphere(1)), material=red, transform=[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, -1]])
        scene.add(np.array(SQUARE)[HALVES] - [0, 0, 9], name="wall", material={"colour": [0, 1, 0]})
        self.assertEqual(scene.objects, ["object 0", "object 1", "wall"])
        self.assertEqual(scene.materials, ["red", "wall"])
        np.testing.assert_allclose(scene.bounds, [[-1, -1, -9], [1, 1, 0]])
        for given, albedo in (({}, [0.8, 0.1, 0.1]), ({"material": "red,base-colour=0,0,1"}, [0, 0, 1])):
            picture = rs.render(scene, aov="albedo", **FRONT, **given)
            np.testing.assert_allclose(picture["albedo"][15, 20], albedo, atol=1e-6)

    def test_colours_multiply_materials(self):
        colours = np.tile([1, 0.5, 0, 1], (4, 1))
        scene = square(colours=colours, material={"colour": [0.5, 0.5, 0.5]})
        np.testing.assert_allclose(rs.render(scene, aov="albedo", **FRONT)["albedo"][15, 20], [0.5, 0.25, 0])

    def test_instances_are_the_objects_that_they_write_out(self):
        vertices, faces = icosphere(2)
        transforms = np.tile(np.eye(4), (5, 1, 1))
        transforms[:, 0, 3] = np.linspace(-1, 1, 5)
        transforms[:, 0, 0] = [0.3, 0.3, -0.3, 0.2, -0.2]
        together, alone, brass = rs.Scene(), rs.Scene(), rs.Material("brass", **MATERIALS["brass"])
        for scene in (together, alone):
            scene.add(SQUARE, HALVES, name="wall", transform=np.eye(4)[:3])
        together.add(vertices, faces, normals=vertices, name="balls", transform=transforms, material=brass)
        for number, transform in enumerate(transforms):
            alone.add(vertices, faces, normals=vertices, name=f"ball {number}", transform=transform, material=brass)
        pictures = [rs.render(scene, aov="instance,object", **FRONT) for scene in (together, alone)]
        self.assertEqual(pictures[0].hash(), pictures[1].hash())
        self.assertEqual(together.triangle_count, 2 + 5 * len(faces))
        seen = set(np.unique(pictures[0]["instance"])) - {4294967295}
        self.assertEqual(seen, {0, 1, 2, 3, 4})
        self.assertEqual(pictures[0].names["object"], ["wall", *(f"balls/{number}" for number in range(5))])

    def test_threads_add_to_one_scene(self):
        scene, refused = rs.Scene(), []

        def add(first):
            for number in range(first, first + 20):
                while True:
                    try:
                        scene.add(SQUARE, HALVES, name=str(number), material={"roughness": 0.5})
                        break
                    except RuntimeError as error:  # another thread is at it
                        refused.append(error)

        threads = [threading.Thread(target=add, args=(100 * index,)) for index in range(8)]
        [thread.start() for thread in threads]
        [thread.join() for thread in threads]
        self.assertEqual((len(scene), scene.triangle_count), (160, 320))
        self.assertEqual(sorted(scene.objects), sorted(scene.materials))


class Textures(unittest.TestCase):
    def albedo(self, scene, **more):
        """The mean albedo of quarters: at the top left, at the top right, below."""
        albedo = rs.render(scene, aov="albedo", **{**FRONT, "size": (40, 40), "eye": (0, 0, 2), **more})["albedo"]
        return albedo[8:14, 8:14].mean((0, 1)), albedo[8:14, 26:32].mean((0, 1)), albedo[26:32, 8:14].mean((0, 1))

    def test_bytes_of_colours_are_srgb_and_floats_are_linear(self):
        for pixels in (np.full((4, 4, 3), 188, np.uint8), np.full((4, 4), 0.5), np.full((4, 4, 4), [0.5] * 3 + [1])):
            found = self.albedo(square(material={"texture": pixels}))[0]
            np.testing.assert_allclose(found, [0.5029] * 3, atol=1e-3)

    def test_images_lie_with_their_first_row_on_top(self):
        pixels = np.zeros((2, 2, 3), np.uint8)
        pixels[0, 0], pixels[0, 1], pixels[1, 0] = [255, 0, 0], [0, 255, 0], [0, 0, 255]
        found = self.albedo(square(material={"texture": rs.Texture(pixels, wrap="clamp")}))
        for colour, expected in zip(found, np.eye(3)):
            self.assertEqual(np.argmax(colour), np.argmax(expected), found)
        mirrored = rs.Texture(pixels, wrap=("clamp", "mirror"), scale=(-1, 1), offset=(1, 0))
        found = self.albedo(square(material={"texture": mirrored}))[:2]
        self.assertEqual([np.argmax(colour) for colour in found], [1, 0])

    def test_textures_read_their_set_of_coordinates(self):
        pixels = np.zeros((2, 2, 3), np.float32)
        pixels[0, 0], pixels[1, 1] = [1, 0, 0], [0, 1, 0]
        image = rs.Texture(pixels, wrap="clamp")
        turned = 1 - np.array(UVS)
        for texture, expected in ((image, 0), (rs.Texture(image, wrap="clamp", uv=1), 1)):
            scene = square(uvs=[UVS, turned], material={"texture": texture})
            self.assertEqual(np.argmax(self.albedo(scene)[0]), expected)

    def test_numbers_multiply_what_they_are_of(self):
        def shown(**values):
            return rs.render(square(material=values), **{**FRONT, "spp": 64}).image[15, 20]

        grey, half = np.full((2, 2), 128, np.uint8), 128 / 255
        rough, metal = {"colour": [0.9, 0.5, 0.1], "roughness": 0.8}, {"metallic": 1}
        for textured, plain in (
            ({**rough, "roughness_texture": grey}, {**rough, "roughness": 0.8 * half}),
            ({**rough, **metal, "metallic_texture": grey}, {**rough, "metallic": half}),
            ({"emission": [2, 1, 1], "emission_texture": np.full((2, 2), 0.5)}, {"emission": [1, 0.5, 0.5]}),
        ):
            np.testing.assert_allclose(shown(**textured), shown(**plain), rtol=0.02)

    def test_normal_maps_tilt_normals(self):
        def normal(map, **more):
            picture = rs.render(square(material={"normal_texture": map, **more}), aov="shading-normal", **FRONT)
            return picture["shading-normal"][15, 20]

        pixels = np.full((2, 2, 3), [0.5, 0.5, 1], np.float32)
        np.testing.assert_allclose(normal(pixels), [0, 0, 1], atol=0.01)
        pixels[:] = np.array([0.6, 0, 0.8]) / 2 + 0.5
        np.testing.assert_allclose(normal(pixels), [0.6, 0, 0.8], atol=0.02)
        flatter = normal(pixels, normal_scale=0.5)
        np.testing.assert_allclose(flatter, np.array([0.3, 0, 0.8]) / np.hypot(0.3, 0.8), atol=0.02)

    def test_alpha_is_seen_through(self):
        spec = {**FRONT, "transparent": True, "spp": 64}
        pixels = np.full((2, 2, 4), [1, 1, 1, 0.25])
        for values, least, most in (
            ({"texture": pixels}, 0.15, 0.35),
            ({"texture": pixels, "alpha_cutoff": 0.2}, 1, 1),
            ({"texture": pixels, "alpha_cutoff": 0.3}, 0, 0),
            ({"alpha": 0.5}, 0.4, 0.6),
        ):
            seen = rs.render(square(material=values), **spec)["alpha"][12:18, 15:25].mean()
            self.assertTrue(least <= seen <= most, (values, seen))

    def test_images_are_shared(self):
        image = rs.Texture(np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8))
        self.assertEqual((image.size, image.pixels.shape, image.pixels[0, 0, 3]), ((64, 64), (64, 64, 4), 255))
        self.assertEqual(rs.Texture(image, uv=1).pixels.tolist(), image.pixels.tolist())


class Mistakes(unittest.TestCase):
    def test_bad_pixels_are_refused(self):
        wrong = np.full((3, 4, 3), 0.5)
        wrong[1, 2, 0] = 1.5
        for pixels, kind, told in (
            (wrong, ValueError, "row 1, column 2, channel 0 is 1.5"),
            (wrong * np.nan, ValueError, "row 0, column 0, channel 0 is NaN"),
            (np.zeros((3, 4, 2), np.uint8), ValueError, r"the shape \[3, 4, 2\]"),
            (np.zeros((0, 4, 3), np.uint8), ValueError, "image of 4x0"),
            (np.zeros((3, 4, 3), np.int64), TypeError, "int64"),
        ):
            with self.subTest(told):
                with self.assertRaisesRegex(kind, told):
                    rs.Texture(pixels)
                with self.assertRaisesRegex(kind, "normal_texture: .*" + told):
                    rs.Material("m", normal_texture=pixels)
        grey = np.zeros((2, 2), np.uint8)
        for keywords, told in (
            ({"wrap": "tile"}, "tile"),
            ({"scale": (np.inf, 1)}, "finite"),
            ({"rotation_degrees": np.nan}, "finite"),
        ):
            with self.subTest(told), self.assertRaisesRegex(ValueError, told):
                rs.Texture(grey, **keywords)

    def test_bad_materials_are_refused(self):
        for values, told in (
            ({"roughnes": 0.5}, "unknown field `roughnes`"),
            ({"roughness": 1.5}, 'material "m": roughness is 1.5; it must be from 0 to 1'),
            ({"colour": [2, 0, 0]}, "largest channel of colour is 2"),
            ({"colour": [1, 0]}, "material"),
            ({"emission": [-1, 0, 0]}, "emission"),
            ({"coats": [{}], "mirror": True}, "cannot have coats"),
            ({"metallic_texture": np.zeros((2, 2), np.uint8)}, "multiplies metallic"),
            ({"roughness": np.nan}, "roughness: NaN is not finite"),
        ):
            with self.subTest(told), self.assertRaisesRegex(ValueError, told):
                rs.Material("m", **values)
        with self.assertRaisesRegex(TypeError, "no name"):
            rs.Material("m", texture="bricks.png")
        with self.assertRaisesRegex(ValueError, "needs a name"):
            square(material=rs.Material(""))

    def test_bad_objects_are_refused_and_leave_the_scene(self):
        scene, red = square(name="wall", material=rs.Material("red")), rs.Material("red")
        before = hash_of(scene)
        normal = rs.Texture(np.zeros((2, 2, 3), np.uint8), uv=1)
        broken = np.array(SQUARE, float)
        broken[2, 1] = np.inf
        flat = np.stack([np.eye(4), np.diag([1, 0, 1, 1])])
        for vertices, keywords, told in (
            (SQUARE, {"name": "wall"}, 'object "wall": another object, or an instance, has this name'),
            (SQUARE, {"name": ""}, "needs a name"),
            (broken, {"name": "b"}, 'object "b": vertex 2 is at'),
            (SQUARE, {"name": "b", "faces": [[0, 1, 4]]}, "triangle 0 names vertex 4"),
            (SQUARE, {"colours": np.full((4, 3), 7)}, 'object "object 1": colours: vertex 0 has 7'),
            (SQUARE, {"material": red}, 'material "red": another material has this name'),
            (SQUARE, {"name": "default", "material": {}}, 'material "default"'),
            (SQUARE, {"material": {"normal_texture": normal}}, "reads texture coordinates 1, but the mesh has 1"),
            (SQUARE, {"material": {"texture": normal}, "uvs": None}, "the mesh has 0"),
            (SQUARE, {"uvs": np.zeros((2, 3, 2))}, r"uvs \[2, 3\] for 4 vertices"),
            (SQUARE, {"transform": flat}, "instance 1: the transform is singular"),
            (SQUARE, {"transform": np.diag([1, 1, 1, 2])}, "perspective"),
            (SQUARE, {"transform": np.zeros((0, 4, 4))}, "no transforms"),
            (SQUARE, {"transform": np.eye(3)}, "the shape"),
            (rs.Mesh(SQUARE, HALVES), {}, "has its own faces"),
        ):
            with self.subTest(told), self.assertRaisesRegex(ValueError, told):
                scene.add(vertices, **{"faces": HALVES, "uvs": UVS, **keywords})
        self.assertEqual((hash_of(scene), scene.objects, scene.materials), (before, ["wall"], ["red"]))
        with self.assertRaisesRegex(TypeError, "material is a Material"):
            scene.add(SQUARE, HALVES, material="red")
        with self.assertRaisesRegex(ValueError, "no triangles"):
            rs.render(rs.Scene(), size=(8, 8))
        with self.assertRaisesRegex(ValueError, "needs vertices"):
            rs.Scene(colours=[[1, 1, 1]])

    def test_what_does_not_fit_is_told_before_work(self):
        vertices, faces = icosphere(6)
        scene = rs.Scene()
        with self.assertRaisesRegex(ValueError, "at most 268435455"):
            scene.add(vertices, faces, transform=np.tile(np.eye(4), (4000, 1, 1)))
        self.assertEqual(len(scene), 0)


class Copies(unittest.TestCase):
    def scene(self):
        """A scene of all that there is."""
        steel = rs.Material("steel", metallic=1, roughness=0.5, roughness_texture=np.full((4, 4), 200, np.uint8))
        image = rs.Texture(np.linspace(0, 1, 48).reshape(4, 4, 3), wrap=("clamp", "mirror"), uv=1, rotation_degrees=30)
        scene = square(uvs=[UVS, UVS], name="wall", material={"texture": image, "coats": [{"weight": 0.5}]})
        vertices, faces = icosphere(1)
        twice = np.stack([np.diag([2, 2, 2, 1]), np.eye(4)])
        uvs = vertices[:, :2]
        scene.add(vertices, faces, normals=vertices, name="a", material=steel, uvs=uvs, transform=twice)
        scene.add(CORNERS, FACES, name="b", material=steel, uvs=CORNERS[:, :2])
        scene.add(CORNERS, FACES, name="c", colours=np.c_[CORNERS, CORNERS[:, 0]])
        return scene

    def test_scenes_pickle_and_copy(self):
        scene = self.scene()
        expected = hash_of(scene)
        for other in (pickle.loads(pickle.dumps(scene)), copy.copy(scene), copy.deepcopy(scene)):
            self.assertEqual((other.objects, other.materials), (scene.objects, scene.materials))
            self.assertEqual(hash_of(other), expected)
            other.add(CORNERS, FACES, name="d")
            self.assertEqual((len(other), len(scene), hash_of(scene)), (5, 4, expected))

    def test_shaders_read_vertex_attributes_by_their_names(self):
        wetness, flow = np.array([0.1, 0.9, 0.4, 0.6]), np.array([[0, 1], [0.5, 0.5], [1, 0], [0.2, 0.3]])
        attributes = {"wetness": wetness, "flow": flow}
        scene = square(uvs=[UVS, flow], material={"colour": [1, 1, 1]}, name="wall", attributes=attributes)
        head = "struct Attributes { wetness: f32, flow: vec2f }\nvar<private> attributes: Attributes;\n"
        text = "fn pattern(at: Point) -> Finish { var f = matte(at); f.colour = vec3f(VALUES, 0.5); return f; }"
        with tempfile.TemporaryDirectory() as folder:
            def picture(of, values):
                file = Path(folder, "pattern.wgsl")
                file.write_text(head + text.replace("VALUES", values))
                return rs.render(of, surface=f"wall={file}", **FRONT).image

            expected = picture(scene, "at.uv1")
            for other in (scene, pickle.loads(pickle.dumps(scene)), copy.deepcopy(scene)):
                np.testing.assert_array_equal(picture(other, "attributes.flow"), expected)
            self.assertTrue((picture(scene, "attributes.wetness, 0.5") != expected).any())
            with self.assertRaisesRegex(ValueError, 'vertex attribute "wetness", which the mesh does not have'):
                picture(square(name="wall", material={}), "attributes.wetness, 0.5")
        wrong_ones = [(np.zeros(3), "wetness"), (np.zeros((4, 5)), "n from 1 to 4"), ([0, 1, 2, np.nan], "vertex 3")]
        for wrong, told in wrong_ones:
            with self.assertRaisesRegex(ValueError, told):
                square(attributes={"wetness": wrong})

    def test_materials_and_textures_pickle_and_copy(self):
        texture = rs.Texture(np.linspace(0, 1, 12).reshape(2, 2, 3), wrap="mirror", scale=(2, 3))
        material = rs.Material("m", colour=(1, 0.5, 0), roughness=np.float32(0.25), texture=texture)
        for other in (pickle.loads(pickle.dumps(material)), copy.copy(material), copy.deepcopy(material)):
            values = other.values
            self.assertEqual((other.name, values["colour"], values["roughness"]), ("m", [1, 0.5, 0], 0.25))
            np.testing.assert_array_equal(values["texture"].pixels, texture.pixels)
            self.assertEqual(hash_of(square(material=other)), hash_of(square(material=material)))


if __name__ == "__main__":
    unittest.main()
