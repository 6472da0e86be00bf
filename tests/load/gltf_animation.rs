//! Animated nodes, skins and morph targets at a time, beside an evaluation written for these tests alone.

use crate::document::Document;
use crate::folder::{Folder, assert_holds, warns};
use raystream::scene::Scene;
use raystream::scene::load::{LoadOptions, load_with};
use serde_json::json;

/// A matrix by its columns.
type Matrix = [[f64; 4]; 4];

const IDENTITY: Matrix =
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];

fn times(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|column| {
        std::array::from_fn(|row| (0..4).map(|inner| a[inner][row] * b[column][inner]).sum())
    })
}

fn moved(matrix: &Matrix, [x, y, z]: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|row| matrix[0][row] * x + matrix[1][row] * y + matrix[2][row] * z + matrix[3][row])
}

fn translation(by: [f64; 3]) -> Matrix {
    let mut matrix = IDENTITY;
    matrix[3][..3].copy_from_slice(&by);
    matrix
}

/// A rotation about z by an angle in radians.
fn turn(angle: f64) -> Matrix {
    let mut matrix = IDENTITY;
    (matrix[0][0], matrix[0][1]) = (angle.cos(), angle.sin());
    (matrix[1][0], matrix[1][1]) = (-angle.sin(), angle.cos());
    matrix
}

/// The same as a quaternion.
fn quaternion(angle: f64) -> [f32; 4] {
    [0.0, 0.0, (angle / 2.0).sin() as f32, (angle / 2.0).cos() as f32]
}

fn at(document: &Document, options: &LoadOptions) -> Result<Scene, String> {
    let folder = Folder::new();
    folder.write("a.glb", document.glb());
    load_with(folder.path("a.glb"), options).map_err(|error| error.to_string())
}

fn at_time(document: &Document, seconds: f64) -> Scene {
    document.at_time(seconds).expect("a scene")
}

#[track_caller]
fn assert_positions(scene: &Scene, expected: &[[f64; 3]], what: &str) {
    assert_eq!(scene.mesh.positions.len(), expected.len(), "{what}");
    for (found, expected) in scene.mesh.positions.iter().zip(expected) {
        let found = found.to_array().map(f64::from);
        let far = (0..3).map(|axis| (found[axis] - expected[axis]).abs()).fold(0.0, f64::max);
        assert!(far < 1e-5, "{what}: {found:?} is not {expected:?}");
    }
}

impl Document {
    /// Adds a channel of a node to the animation.
    fn animate(&mut self, node: usize, path: &str, interpolation: &str, keys: (&[f32], &str, &[f32])) {
        self.channel(json!({ "node": node, "path": path }), interpolation, keys);
    }
}

const CORNERS: [[f64; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

#[test]
fn nodes_move_with_those_above_them() {
    let mut document = Document::triangle();
    document.json["nodes"][0]["translation"] = json!([1.0, 0.0, 0.0]);
    document.node(json!({ "children": [0] }));
    document.json["scenes"] = json!([{ "nodes": [1] }]);
    let angles = [0.0, 2.0, 1.0].map(quaternion).concat();
    document.animate(1, "rotation", "LINEAR", (&[1.0, 2.0, 4.0], "VEC4", &angles));
    let heights = [0.0, 0.0, 0.0, 0.0, 0.0, 3.0];
    document.animate(0, "translation", "STEP", (&[0.0, 2.0], "VEC3", &heights));
    let tangents = [[0.0; 3], [1.0; 3], [0.5; 3], [-0.25; 3], [2.0; 3], [0.0; 3]].concat();
    document.animate(0, "scale", "CUBICSPLINE", (&[0.0, 4.0], "VEC3", &tangents));
    for seconds in [-1.0, 0.5, 1.75, 2.5, 3.25, 9.0] {
        let angle = match seconds {
            s if s < 1.0 => 0.0,
            s if s < 2.0 => 2.0 * (s - 1.0),
            s if s < 4.0 => 2.0 - (s - 2.0) / 2.0,
            _ => 1.0,
        };
        let height = if seconds < 2.0 { 0.0 } else { 3.0 };
        let t = (seconds / 4.0_f64).clamp(0.0, 1.0);
        let scale = (2.0 * t.powi(3) - 3.0 * t * t + 1.0)
            + 4.0 * (t.powi(3) - 2.0 * t * t + t) * 0.5
            + (3.0 * t * t - 2.0 * t.powi(3)) * 2.0
            + 4.0 * (t.powi(3) - t * t) * -0.25;
        let scaled = CORNERS.map(|corner| corner.map(|x| x * scale));
        let placed = times(&turn(angle), &translation([0.0, 0.0, height]));
        let expected = scaled.map(|corner| moved(&placed, corner));
        assert_positions(&at_time(&document, seconds), &expected, &format!("{seconds} s"));
    }
    // At rest, as the nodes say.
    assert_positions(&document.scene(), &CORNERS.map(|[x, y, z]| [x + 1.0, y, z]), "at rest");
}

/// A strip of rings along y, whose vertices follow eight joints in two sets by weights.
struct Strip {
    document: Document,
    positions: Vec<[f64; 3]>,
    weights: Vec<[f64; 8]>,
}

const RINGS: usize = 9;

fn strip() -> Strip {
    let mut document = Document::new();
    let ring = |ring: usize| [-0.5, 0.5].map(|x| [x, ring as f64, 0.25 * x]);
    let positions: Vec<[f64; 3]> = (0..RINGS).flat_map(ring).collect();
    let weight = |vertex: usize| {
        let of: [f64; 8] = std::array::from_fn(|joint| {
            (1.5 - ((vertex / 2) as f64 - joint as f64).abs()).max(0.0) * (1.0 + 0.1 * (vertex % 2) as f64)
        });
        let sum: f64 = of.iter().sum();
        // Files need not have weights of the sum 1.
        if sum > 0.0 { of.map(|weight| weight / sum * 0.75) } else { of }
    };
    let weights: Vec<[f64; 8]> = (0..positions.len()).map(weight).collect();
    let floats = |values: &[f64]| values.iter().map(|value| *value as f32).collect::<Vec<f32>>();
    let half = |set: usize| {
        let of = |weights: &[f64; 8]| floats(&weights[4 * set..][..4]);
        weights.iter().flat_map(of).collect::<Vec<f32>>()
    };
    let position = document.floats("VEC3", &floats(positions.as_flattened()));
    let normals: Vec<f32> = (0..positions.len()).flat_map(|_| [0.0, 0.0, 1.0]).collect();
    let normal = document.floats("VEC3", &normals);
    let sets = [half(0), half(1)].map(|weights| document.floats("VEC4", &weights));
    let bytes =
        |first: u8| (0..positions.len()).flat_map(|_| [0, 1, 2, 3].map(|i| first + i)).collect::<Vec<u8>>();
    let words: Vec<u8> = bytes(4).into_iter().flat_map(|joint| [joint, 0]).collect();
    let joints = [
        document.accessor("VEC4", 5121, positions.len(), &bytes(0)),
        document.accessor("VEC4", 5123, positions.len(), &words),
    ];
    let corners = |ring: usize| {
        let a = 2 * ring as u16;
        [a, a + 1, a + 2, a + 1, a + 3, a + 2].into_iter().flat_map(u16::to_le_bytes)
    };
    let indices: Vec<u8> = (0..RINGS - 1).flat_map(corners).collect();
    let indices = document.accessor("SCALAR", 5123, 6 * (RINGS - 1), &indices);
    document.mesh(json!({ "indices": indices, "attributes": {
        "POSITION": position, "NORMAL": normal, "JOINTS_0": joints[0], "WEIGHTS_0": sets[0],
        "JOINTS_1": joints[1], "WEIGHTS_1": sets[1]
    } }));
    // Joints 1 to 8 form a chain up the strip; the mesh's own node stands elsewhere.
    document.node(json!({ "mesh": 0, "skin": 0, "translation": [100.0, 0.0, 0.0] }));
    for joint in 0..8 {
        let children = if joint < 7 { json!([joint + 2]) } else { json!([]) };
        let mut node = json!({ "translation": [0.0, if joint == 0 { 0.0 } else { 1.0 }, 0.0] });
        if joint < 7 {
            node["children"] = children;
        }
        document.node(node);
    }
    let rest: Vec<f32> = (0..8)
        .flat_map(|joint| translation([0.0, -f64::from(joint), 0.0]).as_flattened().to_vec())
        .map(|value| value as f32)
        .collect();
    let bytes: Vec<u8> = rest.iter().flat_map(|value| value.to_le_bytes()).collect();
    let rest = document.accessor("MAT4", 5126, 8, &bytes);
    document.json["skins"] = json!([{ "joints": [1, 2, 3, 4, 5, 6, 7, 8], "inverseBindMatrices": rest }]);
    document.json["scenes"] = json!([{ "nodes": [0, 1] }]);
    for joint in 1..8 {
        let angles = [quaternion(0.0), quaternion(0.2 * joint as f64)].concat();
        document.animate(joint + 1, "rotation", "LINEAR", (&[0.0, 2.0], "VEC4", &angles));
    }
    Strip { document, positions, weights }
}

impl Strip {
    fn expected(&self, seconds: f64) -> Vec<[f64; 3]> {
        let share = (seconds / 2.0).clamp(0.0, 1.0);
        let mut world = IDENTITY;
        let joints: Vec<Matrix> = (0..8)
            .map(|joint| {
                let step = if joint == 0 { 0.0 } else { 1.0 };
                let own = times(&translation([0.0, step, 0.0]), &turn(0.2 * f64::from(joint) * share));
                world = times(&world, &own);
                times(&world, &translation([0.0, -f64::from(joint), 0.0]))
            })
            .collect();
        let vertex = |(position, weights): (&[f64; 3], &[f64; 8])| {
            let sum: f64 = weights.iter().sum();
            // Without weights it follows the first joint.
            if sum == 0.0 {
                return moved(&joints[0], *position);
            }
            let parts = joints
                .iter()
                .zip(weights)
                .map(|(joint, weight)| moved(joint, *position).map(|coordinate| coordinate * weight / sum));
            parts.fold([0.0; 3], |sum, part| std::array::from_fn(|axis| sum[axis] + part[axis]))
        };
        self.positions.iter().zip(&self.weights).map(vertex).collect()
    }
}

#[test]
fn skins_bend_with_their_joints() {
    let strip = strip();
    for seconds in [0.0, 0.4, 1.0, 1.7, 2.0] {
        let scene = at_time(&strip.document, seconds);
        assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
        assert_positions(&scene, &strip.expected(seconds), &format!("{seconds} s"));
        assert!(scene.mesh.normals.iter().all(|normal| (normal.length() - 1.0).abs() < 1e-6));
    }
    // Joints need not be in the scene.
    let mut outside = strip.document.clone();
    outside.json["scenes"] = json!([{ "nodes": [0] }]);
    assert_positions(&at_time(&outside, 1.7), &strip.expected(1.7), "joints outside the scene");
    // At rest, where the joints are, and not where the mesh's own node is.
    assert_positions(&strip.document.scene(), &strip.expected(0.0), "at rest");
    assert!(warns(&strip.document.scene(), &["animation 0", "rest pose"]));
}

#[test]
fn a_bent_mesh_has_the_same_bits_on_any_number_of_threads() {
    let strip = strip();
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| at_time(&strip.document, 1.3).mesh.positions.clone())
    };
    let bits = |positions: Vec<glam::Vec3>| {
        positions.iter().map(|p| p.to_array().map(f32::to_bits)).collect::<Vec<_>>()
    };
    assert_eq!(bits(on(1)), bits(on(4)));
}

#[test]
fn morph_targets_displace_vertices_by_their_weights() {
    let mut document = Document::triangle();
    let normals = document.floats("VEC3", &[0.0, 0.0, 1.0].repeat(3));
    document.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(normals);
    let up = document.floats("VEC3", &[0.0, 0.0, 1.0].repeat(3));
    let out = document.floats("VEC3", &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0]);
    document.json["meshes"][0]["primitives"][0]["targets"] =
        json!([{ "POSITION": up, "NORMAL": out }, { "POSITION": out }]);
    let expected = |a: f64, b: f64| [[b, 0.0, a], [1.0, 0.0, a], [0.0, 1.0 + 2.0 * b, a]];
    assert_positions(&document.scene(), &expected(0.0, 0.0), "no weights");
    document.json["meshes"][0]["weights"] = json!([0.5, 0.25]);
    let scene = document.scene();
    assert_positions(&scene, &expected(0.5, 0.25), "the mesh's weights");
    let tilted = 0.5_f32 / 1.25_f32.sqrt();
    assert!((scene.mesh.normals[0].x - tilted).abs() < 1e-6, "{}", scene.mesh.normals[0]);
    document.json["nodes"][0]["weights"] = json!([-1.0, 2.0]);
    assert_positions(&document.scene(), &expected(-1.0, 2.0), "the node's weights");
    // Two targets, and of each key the tangents before, the values, the tangents after.
    let keys = [[[0.0, 0.0], [0.0, 1.0], [1.0, 0.0]], [[0.5, 0.0], [2.0, 3.0], [0.0, 0.0]]];
    let keys: Vec<f32> = keys.as_flattened().as_flattened().to_vec();
    document.animate(0, "weights", "CUBICSPLINE", (&[0.0, 2.0], "SCALAR", &keys));
    for seconds in [0.0, 0.5, 1.0, 1.5, 2.0] {
        let t = seconds / 2.0_f64;
        let (start, leave) = (2.0 * t.powi(3) - 3.0 * t * t + 1.0, 2.0 * (t.powi(3) - 2.0 * t * t + t));
        let (end, arrive) = (3.0 * t * t - 2.0 * t.powi(3), 2.0 * (t.powi(3) - t * t));
        let a = leave * 1.0 + end * 2.0 + arrive * 0.5;
        let b = start * 1.0 + end * 3.0;
        assert_positions(&at_time(&document, seconds), &expected(a, b), &format!("{seconds} s"));
    }
}

#[test]
fn morph_targets_displace_texture_coordinates_and_colours() {
    let mut document = Document::triangle();
    let uvs = document.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    let second = document.floats("VEC2", &[0.5; 6]);
    let colours = document.floats("VEC4", &[0.5, 0.25, 1.0, 0.75].repeat(3));
    let texture = document.texture(1, &[[255; 4]]);
    document.material(
        json!({ "emissiveFactor": [1, 1, 1], "emissiveTexture": { "index": texture, "texCoord": 1 },
        "pbrMetallicRoughness": { "baseColorTexture": { "index": texture } } }),
    );
    let shift = document.floats("VEC2", &[0.0, 0.0, 0.5, 0.25, -1.0, 2.0]);
    let moved = document.accessor("VEC2", 5120, 3, &[127, 0, 0, 129, 0, 0]);
    document.json["accessors"][moved]["normalized"] = json!(true);
    let tint = document.floats("VEC3", &[0.25, -0.5, 1.0].repeat(3));
    let fade = document.floats("VEC4", &[0.0, 0.25, 0.0, -0.5].repeat(3));
    let primitive = &mut document.json["meshes"][0]["primitives"][0];
    let attributes = &mut primitive["attributes"];
    (attributes["TEXCOORD_0"], attributes["TEXCOORD_1"], attributes["COLOR_0"]) =
        (json!(uvs), json!(second), json!(colours));
    primitive["targets"] =
        json!([{ "TEXCOORD_0": shift, "COLOR_0": tint }, { "TEXCOORD_1": moved, "COLOR_0": fade }]);
    let keys = [0.0, 0.0, 1.0, 0.5];
    document.animate(0, "weights", "LINEAR", (&[0.0, 2.0], "SCALAR", &keys));
    for share in [0.0, 0.25, 1.0_f32] {
        let scene = at_time(&document, 2.0 * f64::from(share));
        assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
        let mesh = &scene.mesh;
        let first = [[0.0, 0.0], [1.0 + 0.5 * share, 0.25 * share], [-share, 1.0 + 2.0 * share]];
        let second = [[0.5 + 0.5 * share, 0.5], [0.5, 0.5 - 0.5 * share], [0.5, 0.5]];
        assert_eq!(mesh.uvs.iter().map(|uv| uv.to_array()).collect::<Vec<_>>(), first, "{share}");
        assert_eq!(mesh.more_uvs[0].iter().map(|uv| uv.to_array()).collect::<Vec<_>>(), second, "{share}");
        let colour =
            [0.5 + 0.25 * share, (0.25 - 0.5 * share + 0.125 * share).max(0.0), 1.0, 0.75 - 0.25 * share];
        assert!(mesh.colours.iter().all(|found| found.to_array() == colour), "{share}: {:?}", mesh.colours);
    }
    // So are attributes of the file's own.
    let rest = document.floats("SCALAR", &[1.0, 2.0, 3.0]);
    let rise = document.floats("SCALAR", &[0.5, 0.0, -4.0]);
    let primitive = &mut document.json["meshes"][0]["primitives"][0];
    primitive["attributes"]["_WETNESS"] = json!(rest);
    primitive["targets"][0]["_WETNESS"] = json!(rise);
    let wetness = |scene: &Scene| scene.mesh.attribute("wetness").expect("an attribute").values.clone();
    assert_eq!(wetness(&at_time(&document, 0.0)), [1.0, 2.0, 3.0]);
    assert_eq!(wetness(&at_time(&document, 2.0)), [1.5, 2.0, -1.0]);
    // At rest the weights are 0, and a mesh without the attributes is not displaced into having them.
    assert_eq!(document.scene().mesh.uvs[1].to_array(), [1.0, 0.0]);
    let mut bare = document.clone();
    bare.json["meshes"][0]["primitives"][0]["attributes"] = json!({ "POSITION": 0 });
    assert!(at_time(&bare, 2.0).mesh.colours.is_empty());
    let target = &mut document.json["meshes"][0]["primitives"][0]["targets"][0];
    target["TEXCOORD_0"] = json!(99);
    let error = at(&document, &LoadOptions::default().with_time(1.0)).expect_err("no accessor");
    assert_holds(&error, &["primitives[0]", "targets[0].TEXCOORD_0 names accessor 99"]);
    document.json["meshes"][0]["primitives"][0]["targets"][0] = json!({ "COLOR_0": uvs });
    let error = at(&document, &LoadOptions::default().with_time(1.0)).expect_err("wrong");
    assert_holds(&error, &["targets[0].COLOR_0", "Vec2", "Vec4 is required"]);
}

#[test]
fn animations_are_chosen_by_name_or_the_first_is_shown() {
    let mut document = Document::triangle();
    document.animate(0, "translation", "STEP", (&[0.0], "VEC3", &[1.0, 0.0, 0.0]));
    let mut second = document.json["animations"][0].clone();
    let output = document.floats("VEC3", &[0.0, 5.0, 0.0]);
    second["samplers"][0]["output"] = json!(output);
    second["name"] = json!("jump");
    document.json["animations"].as_array_mut().expect("a list").push(second);
    let scene = at_time(&document, 0.0);
    assert_eq!(scene.mesh.positions[0].to_array(), [1.0, 0.0, 0.0]);
    assert!(warns(&scene, &["2 animations (animation 0, jump)", "first"]));
    let named = at(&document, &LoadOptions::default().with_animation("jump")).expect("a scene");
    assert_eq!(named.mesh.positions[0].to_array(), [0.0, 5.0, 0.0]);
    assert!(named.warnings.is_empty(), "{:?}", named.warnings);
    let error = at(&document, &LoadOptions::default().with_animation("run")).expect_err("no such one");
    assert_holds(&error, &["a.glb", "no animation \"run\"", "\"animation 0\", \"jump\""]);
    let still = Document::triangle();
    let error = at(&still, &LoadOptions::default().with_animation("run")).expect_err("none");
    assert_holds(&error, &["it has no animations"]);
    assert!(warns(&at_time(&still, 1.0), &["no animation", "any time"]));
}

#[test]
fn meshes_that_move_apart_stay_instances_and_bent_ones_do_not() {
    let mut document = Document::triangle();
    document.node(json!({ "mesh": 0, "translation": [0.0, 0.0, 5.0] }));
    document.animate(1, "translation", "LINEAR", (&[0.0, 1.0], "VEC3", &[0.0, 0.0, 5.0, 0.0, 0.0, 9.0]));
    let scene = at_time(&document, 0.5);
    assert_eq!(scene.shapes.len(), 1);
    assert_eq!(scene.mesh.positions[3].z, 7.0);
    let up = document.floats("VEC3", &[0.0, 0.0, 1.0].repeat(3));
    document.json["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": up }]);
    document.json["nodes"][1]["weights"] = json!([1.0]);
    let scene = at_time(&document, 0.5);
    assert_eq!(scene.shapes.len(), 0);
    assert_eq!([0, 3].map(|vertex| scene.mesh.positions[vertex].z), [0.0, 8.0]);
}

#[test]
fn wrong_skins_targets_and_keys_are_named() {
    let skin = |change: fn(&mut Document)| {
        let mut document = strip().document;
        change(&mut document);
        at(&document, &LoadOptions::default().with_time(1.0)).expect_err("wrong")
    };
    let error = skin(|document| {
        document.json["skins"][0]["joints"] = json!([1, 2]);
    });
    assert_holds(&error, &["meshes[0].primitives[0]", "follows joint", "there are 2"]);
    let error = skin(|document| {
        document.json["scenes"] = json!([{ "nodes": [0] }]);
        document.json["nodes"][8]["children"] = json!([1]);
    });
    assert_holds(&error, &["skins[0]", "nodes[1] is in no tree of nodes"]);
    let error = skin(|document| {
        let weights = document.floats("VEC4", &[-1.0; 4 * 2 * RINGS]);
        document.json["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"] = json!(weights);
    });
    assert_holds(&error, &["vertex 0", "by -1", "not negative"]);
    let error = skin(|document| {
        let weights = document.floats("VEC4", &[1.0; 4]);
        document.json["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"] = json!(weights);
    });
    assert_holds(&error, &["1 elements of WEIGHTS_0", "18 of POSITION"]);
    let error = skin(|document| {
        let joints = document.floats("VEC4", &[0.0; 4 * 2 * RINGS]);
        document.json["meshes"][0]["primitives"][0]["attributes"]["JOINTS_0"] = json!(joints);
    });
    assert_holds(&error, &["JOINTS_0", "unsigned integers"]);
    let error = skin(|document| {
        let rest = document.floats("VEC4", &[0.0; 16]);
        document.json["skins"][0]["inverseBindMatrices"] = json!(rest);
    });
    assert_holds(&error, &["skins[0]", "4 x 4 floats"]);
    let error = skin(|document| {
        document.animate(1, "translation", "LINEAR", (&[f32::NAN, 1.0], "VEC3", &[0.0; 6]));
    });
    assert_holds(&error, &["animations[0].channels[7]", "times must increase"]);
    let mut document = Document::triangle();
    let short = document.floats("VEC3", &[0.0; 6]);
    document.json["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": short }]);
    document.json["meshes"][0]["weights"] = json!([1.0]);
    assert_holds(&document.message(), &["targets[0].POSITION has 2 elements for 3 vertices"]);
    document.json["meshes"][0]["weights"] = json!([0.0]);
    document.animate(0, "weights", "LINEAR", (&[0.0, 1.0], "SCALAR", &[0.0; 3]));
    let error = at(&document, &LoadOptions::default().with_time(1.0)).expect_err("wrong");
    assert_holds(&error, &["2 times and 3 values", "1 finite values for each time"]);
}

#[test]
fn a_small_file_cannot_displace_vertices_for_hours() {
    let mut document = Document::new();
    let zeros = document.add("accessors", json!({ "componentType": 5126, "type": "VEC3", "count": 1 << 16 }));
    document.mesh(
        json!({ "attributes": { "POSITION": zeros }, "targets": vec![json!({ "POSITION": zeros }); 20_000] }),
    );
    document.json["meshes"][0]["weights"] = json!(vec![1.0; 20_000]);
    document.node(json!({ "mesh": 0 }));
    document.view(&[0; 4]);
    assert_holds(&document.message(), &["20000 morph targets of 65536 vertices", "at most"]);
}
