//! STL files.

use crate::folder::{Folder, assert_holds, warns};
use glam::Vec3;
use raystream::scene::Scene;

const FACETS: &str = "facet normal 0 0 1\n outer loop\n  vertex 0 0 0\n  vertex 1 0 0\n  vertex 0 1e0 0.5\n endloop\n\
    endfacet\nfacet normal 0 0 0 outer loop vertex 1 0 0 vertex 1 1 0 vertex 0 1 0 endloop endfacet\n";

/// A binary file of these triangles. `header` are its first bytes.
pub fn binary(header: &str, triangles: &[[[f32; 3]; 3]]) -> Vec<u8> {
    let mut bytes = header.as_bytes().to_vec();
    bytes.resize(80, b' ');
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for corners in triangles {
        // A normal that no triangle has, and an attribute of some program.
        bytes.extend([7.0_f32; 3].iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend(corners.as_flattened().iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend([0xff, 0x7f]);
    }
    bytes
}

const TWO: [[[f32; 3]; 3]; 2] = [
    [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.5]],
    [[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]],
];

fn scene(bytes: impl AsRef<[u8]>) -> Scene {
    let folder = Folder::new();
    folder.write("part.stl", bytes);
    folder.scene("part.stl")
}

fn message(bytes: impl AsRef<[u8]>) -> String {
    let folder = Folder::new();
    folder.write("part.stl", bytes);
    folder.message("part.stl")
}

#[test]
fn both_encodings_give_the_same_scene() {
    let text = scene(format!("solid wing left\n{FACETS}endsolid wing left\n"));
    assert_eq!(text.mesh.triangles, [[0, 1, 2], [3, 4, 5]]);
    assert_eq!(text.mesh.positions[2], Vec3::new(0.0, 1.0, 0.5));
    assert!(text.mesh.normals.is_empty() && text.warnings.is_empty(), "{:?}", text.warnings);
    // Many programs write this word into the header of binary files too.
    for header in ["", "solid from some program"] {
        let bytes = scene(binary(header, &TWO));
        assert_eq!(
            (&bytes.mesh.triangles, &bytes.mesh.positions),
            (&text.mesh.triangles, &text.mesh.positions)
        );
        assert!(bytes.warnings.is_empty(), "{:?}", bytes.warnings);
        assert_eq!(bytes.objects.path(0), "part");
    }
    let shouted =
        format!("SOLID wing left\n{FACETS}ENDSOLID").replace("facet", "FACET").replace('\n', "\r\n");
    assert_eq!(scene(shouted).mesh.positions, text.mesh.positions);
}

#[test]
fn each_solid_is_an_object() {
    let both = scene(format!("solid wing left\n{FACETS}endsolid\nsolid\n{FACETS}endsolid tail"));
    let names: Vec<_> = both.objects.iter().map(|object| object.name.as_str()).collect();
    assert_eq!(names, ["wing left", "part"]);
    assert_eq!((both.objects.of(1), both.objects.of(2)), (Some(0), Some(1)));
}

#[test]
fn triangles_without_area_stay_and_infinite_ones_are_dropped() {
    let nan = [[f32::NAN, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let odd = scene(binary("", &[TWO[0], [[1.0; 3]; 3], nan, TWO[1]]));
    assert_eq!(odd.mesh.triangles, [[0, 1, 2], [3, 4, 5], [9, 10, 11]]);
    assert!(warns(&odd, &["corner 0 of triangle 2", "1 faces"]), "{:?}", odd.warnings);
    let text = scene(format!("solid\n{}{FACETS}endsolid", FACETS.replace("0.5", "nan")));
    assert_eq!(text.mesh.triangles.len(), 3);
    assert!(warns(&text, &["corner 2 of the facet in line 2"]), "{:?}", text.warnings);
}

#[test]
fn sizes_that_do_not_fit_are_told_with_both_numbers() {
    let whole = binary("", &TWO);
    assert_holds(&message(&whole[..183]), &["truncated", "2 triangles", "184 bytes", "has 183"]);
    assert_holds(&message(&binary("solid", &TWO)[..150]), &["truncated", "184 bytes", "has 150"]);
    assert_holds(&message(&whole[..83]), &["not an STL file", "84 bytes", "has 83"]);
    assert_holds(&message(""), &["not an STL file", "has 0"]);
    assert_holds(&message("<html>"), &["not an STL file"]);
    assert_holds(&message(binary("", &[])), &["no triangles"]);
    let longer = scene([whole, vec![0; 7]].concat());
    assert_eq!(longer.mesh.triangles.len(), 2);
    assert!(warns(&longer, &["7 bytes after the 2 triangles"]), "{:?}", longer.warnings);
}

#[test]
fn errors_name_the_line() {
    for (text, parts) in [
        ("solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 x\n", &["line 4", "\"x\" is not a number"][..]),
        ("solid a\nfacet normal 0 0\nouter loop\n", &["line 3", "\"loop\" where \"outer\" should be"]),
        ("solid a\nface normal 0 0 1\n", &["line 2", "\"face\" where \"facet\" or \"endsolid\""]),
        ("solid a\n\nfacet normal 0 0 1 outer loop\nvertex 0 0", &["line 4", "truncated", "a coordinate"]),
        ("solid a\nendsolid a\nfacet", &["line 3", "where \"solid\" should be"]),
        ("solid a\n", &["truncated", "\"facet\" or \"endsolid\""]),
        ("solid a\nendsolid a\n", &["no triangles"]),
    ] {
        assert_holds(&message(text), parts);
    }
    let four = FACETS.replacen(" endloop", " vertex 1 1 1\n endloop", 1);
    assert_holds(&message(format!("solid\n{four}")), &["line 7", "\"vertex\" where \"endloop\" should be"]);
}
