//! PLY files.

use crate::folder::{Folder, assert_holds, warns};
use glam::{Vec2, Vec3};
use raystream::scene::Scene;

const HEADER: &str = "ply\nformat ascii 1.0\ncomment by hand\nelement vertex 4\nproperty float x\n\
    property float y\nproperty float z\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n";
const ROWS: &str = "0 0 0\n1 0 0\n1 1 0\n0 1 0.5\n3 0 1 2\n4 0 1 2 3\n";

fn ascii(text: &str) -> Scene {
    let folder = Folder::new();
    folder.write("a.ply", text);
    folder.scene("a.ply")
}

fn message(bytes: impl AsRef<[u8]>) -> String {
    let folder = Folder::new();
    folder.write("a.ply", bytes);
    folder.message("a.ply")
}

/// The scene of `HEADER` and `ROWS` in a binary form.
fn binary(big: bool) -> Vec<u8> {
    let form = if big { "binary_big_endian" } else { "binary_little_endian" };
    let mut bytes = HEADER.replace("ascii", form).into_bytes();
    let vertices: [f32; 12] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.5];
    for v in vertices {
        bytes.extend(if big { v.to_be_bytes() } else { v.to_le_bytes() });
    }
    for face in [&[0_i32, 1, 2][..], &[0, 1, 2, 3]] {
        bytes.push(face.len() as u8);
        for &v in face {
            bytes.extend(if big { v.to_be_bytes() } else { v.to_le_bytes() });
        }
    }
    bytes
}

#[test]
fn all_three_encodings_give_the_same_scene() {
    let scene = ascii(&format!("{HEADER}{ROWS}"));
    assert_eq!(scene.mesh.triangles, [[0, 1, 2], [0, 1, 2], [0, 2, 3]], "polygons become fans");
    assert_eq!(scene.mesh.positions[3], Vec3::new(0.0, 1.0, 0.5));
    assert_eq!((scene.materials.len(), &scene.mesh.materials[..]), (1, &[0; 3][..]));
    assert!(scene.mesh.normals.is_empty() && scene.mesh.uvs.is_empty() && scene.warnings.is_empty());
    for big in [false, true] {
        let folder = Folder::new();
        folder.write("a.ply", binary(big));
        let other = folder.scene("a.ply");
        assert_eq!(
            (&other.mesh.triangles, &other.mesh.positions),
            (&scene.mesh.triangles, &scene.mesh.positions)
        );
    }
    let windows = format!("{HEADER}{ROWS}").replace('\n', "\r\n");
    assert_eq!(ascii(&windows).mesh.triangles, scene.mesh.triangles);
}

#[test]
fn normals_and_texture_coordinates_in_any_order_and_type() {
    let scene = ascii(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty uchar red\nproperty double s\nproperty float nz\n\
         property float ny\nproperty float nx\nproperty list uchar float weights\nproperty short z\n\
         property double y\nproperty float x\nproperty float t\nelement face 1\nproperty uchar flags\n\
         property list uint8 uint32 vertex_index\nproperty float quality\nend_header\n\
         255 0.25 2 0 0 2 7 8 3 2. .1e1 0.75\n0 1 nan 0 1 0 0 1 1 1\n0 0 0 0 0 1 5 0 0 +1 0\n9 3 0 1 2 0.5\n",
    );
    assert_eq!(scene.mesh.positions, [Vec3::new(1.0, 2.0, 3.0), Vec3::new(1.0, 1.0, 0.0), Vec3::X]);
    assert_eq!(scene.mesh.normals, [Vec3::Z, Vec3::ZERO, Vec3::ZERO], "NaN and zero normals are none");
    assert_eq!(scene.mesh.uvs[0], Vec2::new(0.25, 0.25), "v points down in the mesh");
    assert!(warns(&scene, &["colours"]));
    assert_eq!(scene.warnings.len(), 1);
}

#[test]
fn other_numbers_of_vertices_are_attributes() {
    let header = HEADER.replace(
        "property float z\n",
        "property float z\nproperty uchar intensity\nproperty list uchar int seen_by\nproperty double scalar_age\n",
    );
    let rows = "0 0 0 255 2 7 8 1.5\n1 0 0 0 0 nan\n1 1 0 3 1 9 1e300\n0 1 0.5 4 0 -2\n3 0 1 2\n4 0 1 2 3\n";
    let scene = ascii(&format!("{header}{rows}"));
    let mesh = &scene.mesh;
    let names: Vec<&str> = mesh.attributes.iter().map(|attribute| &*attribute.name).collect();
    assert_eq!(names, ["intensity", "scalar_age"]);
    assert_eq!(mesh.attributes[0].values, [255.0, 0.0, 3.0, 4.0], "integers as they are");
    assert_eq!(mesh.attributes[1].values, [1.5, 0.0, 0.0, -2.0], "what is not finite is 0");
    assert!(mesh.attributes.iter().all(|attribute| attribute.width == 1));
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    let many: String = (0..18).map(|i| format!("property float f_{i}\n")).collect();
    let header =
        HEADER.replace("property float z\n", &format!("property float z\n{many}property float f_1\n"));
    let rows: String = ROWS.replace("0 0 0\n1 0 0\n1 1 0\n0 1 0.5\n", "");
    let zeros = " 0.25".repeat(19);
    let vertices: String = ["0 0 0", "1 0 0", "1 1 0", "0 1 0"].map(|v| format!("{v}{zeros}\n")).concat();
    let scene = ascii(&format!("{header}{vertices}{rows}"));
    assert_eq!(scene.mesh.attributes.len(), 16, "the second of a name is none");
    assert_eq!(scene.mesh.attributes[15].values, [0.25; 4]);
    assert!(warns(&scene, &["16 numbers", "\"f_16\""]));
}

#[test]
fn strips_edges_and_elements_that_mean_nothing() {
    let scene = ascii(
        "ply\nformat ascii 1.0\nelement camera 1\nproperty float view\nelement vertex 5\nproperty float x\n\
         property float y\nproperty float z\nelement edge 1\nproperty int a\nproperty int b\n\
         element tristrips 1\nproperty list int int vertex_indices\nend_header\n\
         1\n0 0 0\n1 0 0\n2 0 0\n3 1 0\n4 0 1\n0 1\n8 0 1 2 3 -1 2 3 4\n",
    );
    assert_eq!(scene.mesh.triangles, [[0, 1, 2], [2, 1, 3], [2, 3, 4]]);
    assert!(scene.warnings.len() == 1 && warns(&scene, &["\"camera\""]));
}

#[test]
fn faces_without_area_are_kept_and_those_without_corners_are_not() {
    let rows = ROWS.replace("3 0 1 2", "2 0 1").replace("4 0 1 2 3", "3 1 1 1");
    let scene = ascii(&format!("{HEADER}{rows}"));
    assert_eq!(scene.mesh.triangles, [[1, 1, 1]]);
    assert!(warns(&scene, &["fewer than 3"]));
}

#[test]
fn truncated_files_say_so_wherever_they_end() {
    for whole in [format!("{HEADER}{ROWS}").into_bytes(), binary(false), binary(true)] {
        let last = if whole.ends_with(b"\n") { whole.len() - 2 } else { whole.len() };
        for length in 4..last {
            let message = message(&whole[..length]);
            assert!(message.contains("truncated") || message.contains("end_header"), "{length}: {message}");
        }
    }
    assert_holds(&message(""), &["not a PLY file"]);
    assert_holds(&message("solid stl\n"), &["not a PLY file"]);
}

#[test]
fn wrong_rows_are_named() {
    for (from, to, parts) in [
        ("3 0 1 2", "3 0 1 4", &["line 15", "face 0", "vertex 4", "4 are defined"][..]),
        ("3 0 1 2", "3 0 1 -1", &["face 0", "vertex -1"]),
        ("3 0 1 2", "3 0 1 0.5", &["face 0", "0.5"]),
        ("3 0 1 2", "-3 0 1 2", &["face 0", "a list of -3"]),
        ("1 1 0\n", "1 one 0\n", &["line 13", "vertex 2", "\"one\""]),
    ] {
        let text = format!("{HEADER}{ROWS}").replacen(from, to, 1);
        assert_holds(&message(text), parts);
    }
}

#[test]
fn wrong_headers_are_named() {
    for (from, to, parts) in [
        ("ascii 1.0", "ascii 2.0", &["line 2", "2.0"][..]),
        ("ascii 1.0", "base64 1.0", &["line 2", "base64"]),
        ("format ascii 1.0\n", "", &["no line \"format\""]),
        ("float y", "float32x y", &["line 6", "float32x"]),
        ("float y", "list float int y", &["line 6", "integer"]),
        ("element vertex 4\n", "", &["line 4", "before the first element"]),
        ("element vertex 4", "element vertex four", &["line 4", "four"]),
        ("float z", "float w", &["no property z"]),
        ("element face", "element vertex 1\nproperty float x\nelement face", &["element vertex before it"]),
        ("vertex_indices", "corners", &["no list vertex_indices"]),
        ("list uchar int", "int", &["not a list"]),
        ("comment", "remark", &["line 3", "remark"]),
        ("vertex 4", "vertex 0", &["no triangles"]),
        (
            "vertex 4",
            "vertex 18446744073709551615",
            &["element vertex", "18446744073709551615 rows", "truncated"],
        ),
        ("vertex 4", "vertex 99999999999", &["element vertex", "99999999999 rows of at least 6 bytes"]),
        (
            "end_header",
            "element nothing 99999999999\nend_header",
            &["element nothing", "without any property"],
        ),
    ] {
        let text = format!("{HEADER}{ROWS}").replacen(from, to, 1);
        assert_holds(&message(text), parts);
    }
}

#[test]
fn a_file_is_one_object_of_its_name() {
    let folder = Folder::new();
    folder.write(
        "bunny.ply",
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    );
    let objects = folder.scene("bunny.ply").objects;
    assert_eq!((objects.len(), objects.path(0), objects.of(0)), (1, "bunny".into(), Some(0)));
}
