//! Files that would take all memory, never end, or hide what is wrong with them.

use crate::document::Document;
use crate::folder::{Folder, assert_holds, warns};
use raystream::memory::MemoryBudget;
use raystream::scene::load::{LoadOptions, environment, environment_with};
use serde_json::json;

const OBJ: &str = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n";

/// The message of a scene that does not fit into a number of bytes.
fn refusal(folder: &Folder, name: &str, bytes: u64) -> String {
    let options = LoadOptions::default().with_memory(MemoryBudget::of_bytes(bytes));
    folder.load_with(name, &options).err().unwrap_or_else(|| panic!("{name} loads")).to_string()
}

#[test]
fn instances_are_counted_before_memory_is_taken() {
    let mut document = Document::triangle();
    let triangles = 1000;
    let indices: Vec<u8> = (0..triangles).flat_map(|_| [0, 0, 1, 0, 2, 0]).collect();
    let indices = document.accessor("SCALAR", 5123, 3 * triangles, &indices);
    document.json["meshes"][0]["primitives"][0]["indices"] = json!(indices);
    let nodes: Vec<_> = (0..2000).map(|_| json!({ "mesh": 0 })).collect();
    document.json["nodes"] = json!(nodes);
    let folder = Folder::new();
    folder.write("a.glb", document.glb());
    let message = refusal(&folder, "a.glb", 20_000_000);
    assert_holds(&message, &["a.glb", "2000000 triangles", "32.07 MB", "20.00 MB", "--memory"]);
    assert_eq!(folder.scene("a.glb").mesh.triangles.len(), 2_000_000);
}

#[test]
fn images_are_counted_with_their_mipmaps() {
    let folder = Folder::new();
    image::GrayImage::new(1000, 1000).save(folder.path("a.png")).expect("an image");
    folder.write("a.obj", OBJ);
    folder.write("a.mtl", "newmtl m\nmap_Kd a.png\n");
    let message = refusal(&folder, "a.obj", 8_000_000);
    assert_holds(&message, &["\"m\"", "a.png", "1000 x 1000", "9.00 MB", "8.00 MB"]);
    let message = refusal(&folder, "a.obj", 20_000_000);
    assert_holds(&message, &["a.obj", "mipmaps", "20.33 MB", "20.00 MB", "--memory"]);
    image::DynamicImage::ImageRgb32F(image::Rgb32FImage::new(1000, 500))
        .save(folder.path("a.hdr"))
        .expect("a map");
    let options = LoadOptions::default().with_memory(MemoryBudget::of_bytes(9_000_000));
    let message = environment_with(&folder.path("a.hdr"), &options).unwrap_err().to_string();
    assert_holds(&message, &["a.hdr", "1000 x 500", "26.00 MB", "9.00 MB"]);
    assert!(environment(&folder.path("a.hdr")).is_ok());
}

#[test]
fn files_are_counted_before_they_are_read() {
    let folder = Folder::new();
    folder.write("a.obj", OBJ);
    assert_holds(&refusal(&folder, "a.obj", 20), &["a.obj", "the file needs 54 bytes", "20 bytes"]);
    let header = "ply\nformat ascii 1.0\nelement vertex 100\nproperty float x\nproperty float y\n\
                  property float z\nend_header\n";
    folder.write("a.ply", header.to_owned() + &"0 0 0\n".repeat(100));
    assert_holds(&refusal(&folder, "a.ply", 1000), &["a.ply", "a mesh of 100 vertices", "1200 bytes"]);
}

#[cfg(unix)]
#[test]
fn scenes_may_name_regular_files_only_and_users_pipes_too() {
    let folder = Folder::new();
    let make = |name: &str| {
        let made = std::process::Command::new("mkfifo").arg(folder.path(name)).status();
        assert!(made.expect("mkfifo runs").success());
    };
    make("pipe");
    folder.write("a.obj", OBJ);
    for named in ["/dev/zero", "pipe", "."] {
        folder.write("a.mtl", format!("newmtl m\nmap_Kd {named}\n"));
        assert_holds(&folder.message("a.obj"), &["\"m\"", "regular file"]);
        let document = Document::triangle();
        folder.write("a.gltf", document.beside(named));
        assert_holds(&folder.message("a.gltf"), &["buffers[0]", "regular file"]);
        if named != "." {
            folder.write("b.obj", OBJ.replace("a.mtl", named));
            assert_holds(&folder.message("b.obj"), &[named, "regular file"]);
        }
    }
    make("pipe.obj");
    let path = folder.path("pipe.obj");
    let writer = std::thread::spawn(move || std::fs::write(path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"));
    assert_eq!(folder.scene("pipe.obj").mesh.triangles.len(), 1);
    writer.join().expect("no panic").expect("written");
}

#[test]
fn no_more_of_a_buffer_is_read_than_the_document_says() {
    let folder = Folder::new();
    let document = Document::triangle();
    let long = std::fs::File::create(folder.path("long.bin")).expect("a file");
    std::io::Write::write_all(&mut &long, &document.bytes).expect("written");
    // A file with a hole, which takes no room on the disk.
    long.set_len(1 << 33).expect("a long file");
    folder.write("a.gltf", document.beside("long.bin"));
    let options = LoadOptions::default().with_memory(MemoryBudget::of_bytes(1 << 20));
    assert_eq!(folder.load_with("a.gltf", &options).expect("a short buffer").mesh.triangles.len(), 1);
}

#[test]
fn missing_textures_may_be_allowed() {
    let folder = Folder::new();
    let options = LoadOptions::default().with_allow_missing(true);
    folder.write("a.obj", OBJ);
    folder.write("broken.png", "not an image");
    for name in ["lost.png", "broken.png"] {
        folder.write("a.mtl", format!("newmtl m\nmap_Kd {name}\nmap_d {name}\n"));
        assert_holds(&folder.message("a.obj"), &["\"m\"", name, "--allow-missing"]);
        let scene = folder.load_with("a.obj", &options).expect("allowed");
        assert!(warns(&scene, &["\"m\"", name, "magenta", "--allow-missing"]), "{:?}", scene.warnings);
        assert!(scene.textures[0].image().contains(&[255, 0, 255, 255]));
        let mut document = Document::triangle();
        document.add("images", json!({ "uri": name }));
        document.add("textures", json!({ "source": 0 }));
        document.material(json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }));
        folder.write("a.glb", document.glb());
        let scene = folder.load_with("a.glb", &options).expect("allowed");
        assert!(warns(&scene, &["material 0", name, "magenta"]));
    }
}

#[test]
fn a_scene_without_triangles_says_why() {
    let folder = Folder::new();
    folder.write("lines.obj", "v 0 0 0\nv 1 0 0\nl 1 2\np 1\n");
    assert_holds(&folder.message("lines.obj"), &["no triangles", "Lines and points are ignored"]);
    let mut document = Document::triangle();
    // Two vertices make no triangle.
    document.json["accessors"][0]["count"] = json!(2);
    assert_holds(&document.message(), &["no triangles"]);
    let wide: Vec<u8> = OBJ.encode_utf16().flat_map(u16::to_le_bytes).collect();
    folder.write("wide.obj", [&[0xff, 0xfe], &wide[..]].concat());
    assert_holds(&folder.message("wide.obj"), &["UTF-16", "UTF-8"]);
    for name in ["page.obj", "page.gltf", "page.json"] {
        folder.write(name, "\n<!DOCTYPE html><html><body>404 Not Found</body></html>");
        assert_holds(&folder.message(name), &[name, "HTML"]);
    }
}

#[test]
fn warnings_are_kept_when_loading_fails() {
    let folder = Folder::new();
    folder.write("a.obj", "v 0 0 0\ncurv2 1\nf 1 2 3\n");
    let error = folder.load("a.obj").expect_err("a face without vertices");
    assert_holds(&error.warnings().join(" "), &["curv2"]);
}

#[test]
fn faces_with_vertices_that_are_not_finite_are_dropped() {
    let folder = Folder::new();
    for bad in ["nan", "inf", "1e39", "2e11"] {
        folder
            .write("a.obj", format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 {bad} 2\nf 1 2 4\nf 1 2 3\nf 2 3 4 1\n"));
        let scene = folder.scene("a.obj");
        assert_eq!(scene.mesh.triangles.len(), 1);
        assert!(
            warns(&scene, &["1 vertices", "vertex 4 in line 4", "2 faces", "1e11"]),
            "{:?}",
            scene.warnings
        );
    }
    let header = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 2\n\
                  property list uchar int vertex_indices\nend_header\n";
    folder.write(
        "a.ply",
        format!("ply\nformat ascii 1.0\n{header}0 0 0\n1 0 0\n0 nan 0\n0 1 0\n3 0 1 2\n3 0 1 3\n"),
    );
    let scene = folder.scene("a.ply");
    assert_eq!(scene.mesh.triangles, [[0, 1, 3]]);
    assert!(warns(&scene, &["1 vertices", "vertex 2 in line 12", "1 faces"]), "{:?}", scene.warnings);

    let mut document = Document::new();
    let corners = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, f32::NAN, 0.0, 0.0];
    let positions = document.floats("VEC3", &corners);
    let indices = document.accessor("SCALAR", 5123, 6, &[0, 0, 1, 0, 2, 0, 0, 0, 1, 0, 3, 0]);
    document.mesh(json!({ "attributes": { "POSITION": positions }, "indices": indices }));
    document.node(json!({ "mesh": 0 }));
    document.node(json!({ "mesh": 0, "translation": [3.0, 0.0, 0.0] }));
    let scene = document.scene();
    assert_eq!(scene.mesh.triangles, [[0, 1, 2], [4, 5, 6]]);
    assert!(scene.shapes.is_empty(), "instances share whole shapes only");
    assert!(
        warns(&scene, &["2 vertices", "vertex 3 of meshes[0].primitives[0]", "2 faces"]),
        "{:?}",
        scene.warnings
    );
}

#[test]
fn names_may_be_quoted_escaped_commented_or_of_another_case() {
    let folder = Folder::new();
    folder.write("My File.mtl", "newmtl m\nKd 1 0 0\nmap_Kd Tex.PNG\n");
    std::fs::create_dir(folder.path("Maps")).expect("a folder");
    folder.image("Maps/Wall.png", 1, &[[9; 4]]);
    folder.image("tex.png", 1, &[[7; 4]]);
    for named in ["My File.mtl", "My\\ File.mtl", "\"My File.mtl\"", "My File.mtl # materials", "my file.MTL"]
    {
        folder.write("a.obj", OBJ.replace("a.mtl", named));
        let scene = folder.scene("a.obj");
        assert_eq!((scene.warnings.len(), scene.textures.len()), (0, 1), "{named}: {:?}", scene.warnings);
    }
    folder.write("a.obj", OBJ);
    for named in ["maps/wall.PNG", "MAPS\\WALL.png", "\"Maps/Wall.png\"", "-colorspace sRGB Maps/Wall.png"] {
        folder.write("a.mtl", format!("newmtl m\nmap_Kd {named}\n"));
        assert_eq!(folder.scene("a.obj").textures.len(), 1, "{named}");
    }
    folder.write("a.mtl", "newmtl m\nmap_Kd -colorspace linear Maps/Wall.png\n");
    assert!(warns(&folder.scene("a.obj"), &["-colorspace"]));
    let mut document = Document::triangle();
    document.add("images", json!({ "uri": "maps/WALL.png" }));
    document.add("textures", json!({ "source": 0 }));
    document.material(json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }));
    folder.write("a.glb", document.glb());
    assert_eq!(folder.scene("a.glb").textures.len(), 1);
}

#[test]
fn versions_of_gltf_are_told_apart() {
    let version = |version: &str, least: Option<&str>| {
        let mut document = Document::triangle();
        document.json["asset"] = json!({ "version": version });
        if let Some(least) = least {
            document.json["asset"]["minVersion"] = json!(least);
        }
        document
    };
    assert_eq!(version("2.9", None).scene().mesh.triangles.len(), 1);
    assert_eq!(version("2.9", Some("2.0")).scene().mesh.triangles.len(), 1);
    assert_holds(&version("2.9", Some("2.9")).message(), &["at least", "\"2.9\"", "2.0 is supported"]);
    // In version 1 meshes are an object, not a list.
    let mut old = version("1.0", None);
    old.json["meshes"] = json!({ "mesh": { "primitives": [] } });
    assert_holds(&old.message(), &["\"1.0\"", "2.0 is supported"]);
    old.json["asset"]["version"] = json!(1);
    assert_holds(&old.message(), &["\"1\"", "2.0 is supported"]);
}

#[test]
fn accessors_without_data_are_zero() {
    let mut document = Document::triangle();
    document.json["accessors"] = json!([
        { "bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3 },
        { "componentType": 5126, "type": "VEC2", "count": 3 }
    ]);
    document.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!(1);
    let scene = document.scene();
    assert_eq!(scene.mesh.uvs, [glam::Vec2::ZERO; 3]);
}

#[test]
fn both_signatures_of_radiance_files_are_read() {
    let folder = Folder::new();
    let pixels = image::Rgb32FImage::from_pixel(4, 2, image::Rgb([1.0, 0.5, 2.0]));
    image::DynamicImage::ImageRgb32F(pixels).save(folder.path("a.hdr")).expect("a map");
    let bytes = std::fs::read(folder.path("a.hdr")).expect("just written");
    let rest = bytes.strip_prefix(b"#?RADIANCE").expect("the usual signature");
    folder.write("b.hdr", [b"#?RGBE", rest].concat());
    let map = |name: &str| environment(&folder.path(name)).expect("a map").texels;
    assert_eq!(map("a.hdr"), map("b.hdr"));
}
