//! Scenes from streams, whose content tells what they are.

use crate::document::Document;
use crate::folder::assert_holds;
use crate::stl;
use raystream::scene::Scene;
use raystream::scene::load::{LoadError, LoadOptions, load_from};

fn load(bytes: &[u8]) -> Result<Scene, LoadError> {
    load_from(bytes, "standard input".as_ref(), &LoadOptions::default())
}

const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
    element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
const STL: &str = "solid\nfacet normal 0 0 1 outer loop vertex 0 0 0 vertex 1 0 0 vertex 0 1 0 endloop endfacet\n\
    endsolid\n";
const RECIPE: &str = r#"{ "materials": { "asset": { "colour": [1, 1, 1] } }, "shapes": [
    { "shape": "quad", "corner": [0, 0, 0], "u": [1, 0, 0], "v": [0, 1, 0], "material": "asset" }] }"#;

#[test]
fn the_content_tells_the_format() {
    let document = Document::triangle();
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    for (name, bytes, triangles) in [
        ("glb", document.glb(), 1),
        ("ply", PLY.into(), 1),
        ("ply of Windows", PLY.replace('\n', "\r\n").into(), 1),
        ("stl", STL.into(), 1),
        ("binary stl", stl::binary("", &[corners; 3]), 3),
        ("off", b"# \nOFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n".to_vec(), 1),
        ("recipe", RECIPE.into(), 2),
    ] {
        let scene = load(&bytes).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(scene.mesh.triangles.len(), triangles, "{name}");
    }
}

#[test]
fn errors_name_the_stream() {
    for (bytes, parts) in [
        (&b"v 0 0 0\nv 1 0 0\n"[..], &["standard input", "none of GLB", "OBJ file must be named"][..]),
        (b"", &["standard input", "none of GLB"]),
        (b"glTF\x02\0\0\0", &["standard input", "truncated"]),
        (b"{ \"asset\": { \"version\": \"1.0\" } }", &["standard input", "glTF version \"1.0\""]),
        (b"{ \"materials\": 3 }", &["standard input", "line 1"]),
        (b"solid\nfacet", &["standard input, line 2"]),
    ] {
        assert_holds(&load(bytes).expect_err("broken").to_string(), parts);
    }
}

#[test]
fn files_that_a_stream_names_are_looked_for_beside_its_path() {
    let folder = crate::folder::Folder::new();
    let document = Document::triangle();
    folder.write("a.bin", &document.bytes);
    let json = document.beside("a.bin");
    let path = folder.path("no such file");
    let scene = load_from(json.as_bytes(), &path, &LoadOptions::default()).expect("found");
    assert_eq!(scene.files, [folder.path("a.bin")]);
    assert_holds(&load(json.as_bytes()).expect_err("elsewhere").to_string(), &["cannot read a.bin"]);
}
