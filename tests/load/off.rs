//! OFF files.

use crate::folder::{Folder, assert_holds, warns};
use glam::{Vec2, Vec3};
use raystream::scene::Scene;

const SQUARE: &str = "4 2 0\n0 0 0\n1 0 0\n1 1 0 # a comment\n\n0 1 0.5\n3 0 1 2\n4  0 1 2 3\n";

fn scene(text: &str) -> Scene {
    let folder = Folder::new();
    folder.write("a.off", text);
    folder.scene("a.off")
}

fn message(text: &str) -> String {
    let folder = Folder::new();
    folder.write("a.off", text);
    folder.message("a.off")
}

#[test]
fn polygons_become_fans_wherever_the_counts_are() {
    // Some files lack the line break after the first word.
    for head in ["OFF\n", "# by hand\n\nOFF\n", "OFF ", "OFF"] {
        let square = scene(&format!("{head}{SQUARE}"));
        assert_eq!(square.mesh.triangles, [[0, 1, 2], [0, 1, 2], [0, 2, 3]], "{head:?}");
        assert_eq!(square.mesh.positions[3], Vec3::new(0.0, 1.0, 0.5));
        assert_eq!((square.objects.path(0).as_str(), square.materials.len()), ("a", 1));
        assert!(square.mesh.normals.is_empty() && square.warnings.is_empty(), "{:?}", square.warnings);
    }
    assert_eq!(scene(&format!("OFF\n{SQUARE}").replace('\n', "\r\n")).mesh.triangles.len(), 3);
}

#[test]
fn prefixes_name_what_vertices_have() {
    let all = scene(
        "STCNOFF\n3 1\n0 0 0  0 0 2  255 0 0 255  0.25 0.25\n1 0 0  0 0 0  0 255 0 255  1 0\n\
         0 1 0  0 nan 1  0 0 255 255  0 1\n3 0 1 2 9 9 9\n",
    );
    assert_eq!(all.mesh.normals, [Vec3::Z, Vec3::ZERO, Vec3::ZERO], "NaN and zero normals are none");
    assert_eq!(all.mesh.uvs, [Vec2::new(0.25, 0.75), Vec2::new(1.0, 1.0), Vec2::new(0.0, 0.0)]);
    assert!(warns(&all, &["Colours of faces"]), "{:?}", all.warnings);
    let linear = |srgb: f32| ((srgb / 255.0 + 0.055) / 1.055).powf(2.4);
    assert_eq!(all.mesh.colours, [Vec3::X, Vec3::Y, Vec3::Z].map(|colour| colour.extend(1.0)));
    let shares = scene("COFF\n3 1 0\n0 0 0 1 0 0\n1 0 0 0.5 0 0 0.25\n0 1 0 nan 2e-1 0 1\n3 0 1 2\n");
    let [red, half, rest] = shares.mesh.colours[..] else { panic!("three colours") };
    assert_eq!((red.to_array(), half.w, rest.x), ([1.0, 0.0, 0.0, 1.0], 0.25, 0.0));
    assert!((half.x - linear(127.5)).abs() < 1e-5 && (rest.y - linear(51.0)).abs() < 1e-5, "{half} {rest}");
    assert!(shares.materials[0].alpha.vertex && !all.materials[0].alpha.vertex);
    let more = scene("OFF\n3 1 0\n0 0 0 255\n1 0 0\n0 1 0\n3 0 1 2\n");
    assert!(warns(&more, &["does not name"]), "{:?}", more.warnings);
}

#[test]
fn what_cannot_be_a_face_is_left_out_with_a_warning() {
    let odd = scene("OFF\n4 3 0\n0 0 0\n1 0 0\n0 1 0\n1e39 0 0\n2 0 1\n3 0 1 3\n3 0 1 2\n");
    assert_eq!(odd.mesh.triangles, [[0, 1, 2]]);
    assert!(warns(&odd, &["fewer than 3 corners"]) && warns(&odd, &["vertex 3 in line 6", "1 faces"]));
}

#[test]
fn errors_name_the_line() {
    for (text, parts) in [
        ("OF\n", &["line 1", "\"OF\" where OFF should be"][..]),
        ("", &["the file ends where the word OFF should be"]),
        ("OFF BINARY\n", &["line 1", "binary OFF file", "ASCII"]),
        ("4OFF\n", &["line 1", "\"4OFF\"", "three coordinates"]),
        ("OFF\n4\n", &["line 2", "numbers of vertices and faces"]),
        ("OFF\n-1 2 0\n", &["line 2", "\"-1\" is not a number of vertices"]),
        ("OFF\n3 1 0\n0 0 0\n1 0 zero\n0 1 0\n3 0 1 2\n", &["line 4", "\"zero\" is not a number"]),
        ("OFF\n3 1 0\n0 0 0\n1 0\n0 1 0\n3 0 1 2     \n", &["line 4", "no three coordinates"]),
        ("NOFF\n3 1 0\n0 0 0 1 1\n1 0 0 1 1 1\n0 1 0 1 1 1\n3 0 1 2\n", &["line 3", "no normal"]),
        ("COFF\n3 1 0\n0 0 0 1 1\n1 0 0 1 1 1\n0 1 0 1 1 1\n3 0 1 2\n", &["line 3", "a colour of 2 numbers"]),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", &["line 6", "names vertex 3, but there are 3"]),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n", &["line 6", "\"-1\" is not the index"]),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n4 0 1 2\n", &["line 6", "fewer than 4 corners"]),
        ("OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n#\n#\n#\n", &["truncated", "a face"]),
        ("OFF\n3000000000 9 0\n0 0 0\n", &["line 2", "3000000000 vertices and 9 faces", "6 bytes are left"]),
        ("<html>OFF", &["HTML"]),
    ] {
        assert_holds(&message(text), parts);
    }
}
