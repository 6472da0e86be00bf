//! OBJ geometry.

use crate::folder::{Folder, assert_holds, warns};
use glam::{Vec2, Vec3};
use raystream::scene::{Scene, Surface};

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

fn obj(text: &str) -> Scene {
    let folder = Folder::new();
    folder.write("a.obj", text);
    folder.scene("a.obj")
}

fn message(text: &str) -> String {
    let folder = Folder::new();
    folder.write("a.obj", text);
    folder.message("a.obj")
}

fn corners(scene: &Scene, primitive: u32) -> [[f32; 3]; 3] {
    scene.mesh.corners(primitive).map(Into::into)
}

#[test]
fn primitives_follow_the_file_across_groups_and_materials() {
    let folder = Folder::new();
    folder.write("m.mtl", "newmtl red\nKd 1 0 0\nnewmtl unused\nnewmtl blue\nKd 0 0 1\n");
    folder.write(
        "a.obj",
        "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n\
         o one\nusemtl blue\nf 1 2 3\ng two\nusemtl red\nf 1 2 4\n\
         o three\nusemtl blue\nf 2 3 4\ng one\nf 1 3 4\n",
    );
    let scene = folder.scene("a.obj");
    let names: Vec<&str> =
        scene.mesh.materials.iter().map(|&m| scene.materials[m as usize].name.as_str()).collect();
    assert_eq!(names, ["blue", "red", "blue", "blue"]);
    let [o, x, y, z] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    assert_eq!(
        (0..4).map(|i| corners(&scene, i)).collect::<Vec<_>>(),
        [[o, x, y], [o, x, z], [x, y, z], [o, y, z]]
    );
    assert_eq!(scene.materials.len(), 3, "all of the library, in its order");
    assert_eq!(scene.warnings, [""; 0]);
}

#[test]
fn corners_index_positions_texture_coordinates_and_normals_apart() {
    let scene = obj("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.25 0.75\nvt 1 0\nvn 0 0 2\nvn 0 3 0\n\
                     f 1/1/1 2/2/1 3/1/2\nf 1/2/2 3/1/2 2/2/1\n");
    let mesh = &scene.mesh;
    assert_eq!(mesh.positions.len(), 4, "one vertex for each distinct corner");
    let [a, b, c] = mesh.triangles[0].map(|i| i as usize);
    assert_eq!(mesh.uvs[a], Vec2::new(0.25, 0.25), "v points down in the mesh");
    assert_eq!(mesh.uvs[b], Vec2::new(1.0, 1.0));
    assert_eq!((mesh.normals[a], mesh.normals[c]), (Vec3::Z, Vec3::Y), "of unit length");
    assert_eq!(mesh.triangles[1][1] as usize, c);
    assert_eq!(mesh.triangles[1][2] as usize, b);
    assert_eq!(mesh.normals[mesh.triangles[1][0] as usize], Vec3::Y);
}

#[test]
fn negative_indices_count_back_from_the_face() {
    let scene = obj("v 9 9 9\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 5 5\nf -4 -3 -1\n");
    assert_eq!(corners(&scene, 0), [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    assert_eq!(corners(&scene, 1), [[0.0; 3], [1.0, 0.0, 0.0], [5.0; 3]]);
}

#[test]
fn polygons_become_fans_in_file_order() {
    let scene = obj("v 0 0 0\nv 2 0 0\nv 3 1 0\nv 2 2 0\nv 0 2 0\nf 1 2 3 4 5\nf 1 2 4\n");
    let first: Vec<[f32; 3]> = (0..4).map(|i| corners(&scene, i)[1]).collect();
    assert_eq!(first, [[2.0, 0.0, 0.0], [3.0, 1.0, 0.0], [2.0, 2.0, 0.0], [2.0, 0.0, 0.0]]);
    assert!((0..3).all(|i| corners(&scene, i)[0] == [0.0; 3]));
}

#[test]
fn faces_with_and_without_normals_and_texture_coordinates_mix() {
    let scene =
        obj("v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nvt 0.5 0.5\nf 1 2 3\nf 1//1 2//1 3//1\nf 1/1 2/1 3/1\n");
    let at = |primitive: usize| scene.mesh.triangles[primitive][0] as usize;
    assert_eq!([0, 1, 2].map(|i| scene.mesh.normals[at(i)]), [Vec3::ZERO, Vec3::Z, Vec3::ZERO]);
    assert_eq!([0, 1, 2].map(|i| scene.mesh.uvs[at(i)]), [Vec2::ZERO, Vec2::ZERO, Vec2::splat(0.5)]);
    let bare = obj(TRIANGLE);
    assert!(bare.mesh.normals.is_empty() && bare.mesh.uvs.is_empty());
}

#[test]
fn text_may_be_joined_commented_and_oddly_ended() {
    let text = "\u{feff}# made by hand \\\r\nv 0 0 0 # origin\r\n\r\n\
                \x20 v 1 0 \\\r\n 0\r\nv\t0 1 0\r\nf 1 \\\n2 \\\n3";
    assert_eq!(corners(&obj(text), 0), [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    assert_holds(&message(&format!("{text}\nf 1 2 9\n")), &["line 10", "vertex 9"]);
}

#[test]
fn names_may_hold_spaces_and_hashes() {
    let folder = Folder::new();
    folder.write("my materials.mtl", "newmtl wall #2\nKd 0.1 0.2 0.3\n");
    folder.write("a.obj", format!("mtllib my materials.mtl\nusemtl wall #2\n{TRIANGLE}"));
    let scene = folder.scene("a.obj");
    assert_eq!((scene.materials.len(), scene.warnings.len()), (1, 0));
    // Two libraries in one statement; the first definition of a name counts.
    folder.write("b.mtl", "newmtl b\nnewmtl c\nKd 0 0 0\n");
    folder.write("c.mtl", "newmtl c\nKd 1 1 1\n");
    folder.write("b.obj", format!("mtllib b.mtl c.mtl\nusemtl c\n{TRIANGLE}"));
    let scene = folder.scene("b.obj");
    let Surface::Matte { reflectance } = scene.materials[1].surface else { panic!("matte") };
    assert_eq!((scene.materials.len(), reflectance.factor), (2, Vec3::ZERO));
}

#[test]
fn what_has_no_material_is_matte_grey() {
    let plain = obj(TRIANGLE);
    assert_eq!((plain.materials[0].name.as_str(), plain.warnings.len()), ("default", 0));
    let folder = Folder::new();
    folder.write("m.mtl", "newmtl red\n");
    folder.write("a.obj", format!("mtllib m.mtl\n{TRIANGLE}usemtl red\nf 1 2 3\nusemtl gone\nf 1 2 3\n"));
    let scene = folder.scene("a.obj");
    assert_eq!(scene.mesh.materials, [1, 0, 1]);
    assert!(warns(&scene, &["\"gone\"", "not defined"]));
    let lost = obj(&format!("mtllib lost.mtl\nusemtl red\n{TRIANGLE}"));
    assert!(warns(&lost, &["\"lost.mtl\"", "missing"]) && warns(&lost, &["\"red\""]));
}

#[test]
fn what_is_not_a_surface_is_left_out_once_with_a_warning() {
    let scene = obj(&format!("{TRIANGLE}l 1 2\nl 2 3\np 1\ncurv 0 1 1 2\ns 1\nv 1 1 1 0.5 0.5 0.5\n"));
    assert_eq!(scene.mesh.triangles.len(), 1);
    assert_eq!(scene.warnings.len(), 2, "{:?}", scene.warnings);
    let scene = obj("v 0 0 0\nv 1 0 0\nv 0 1 0\nvn nan 0 1\nvt inf 0\nf 1/1/1 2/1/1 3/1/1\n");
    assert_eq!((scene.mesh.normals[0], scene.mesh.uvs[0]), (Vec3::ZERO, Vec2::ZERO));
}

#[test]
fn messages_stay_short_whatever_the_file_holds() {
    let word = "w".repeat(100_000);
    assert!(message(&format!("{TRIANGLE}v 1 2 {word}\n")).len() < 300);
    let lines: String = (0..1000).map(|i| format!("{word}{i}\nunknown{i}\n")).collect();
    let scene = obj(&format!("{TRIANGLE}{lines}"));
    assert_eq!(scene.warnings.len(), 101);
    assert!(scene.warnings.iter().all(|warning| warning.len() < 200));
    assert!(scene.warnings[100].contains("left out"));
}

#[test]
fn wrong_lines_are_named() {
    for (bad, parts) in [
        ("f 1 2 4", &["line 5", "vertex 4", "3 are defined"][..]),
        ("f 1 2 0", &["line 5", "vertex 0"]),
        ("f 1 2 -4", &["line 5", "vertex -4", "-3"]),
        ("f 1/1 2/1 3/1", &["line 5", "texture coordinate 1", "none is defined"]),
        ("f 1//7 2//7 3//7", &["line 5", "normal 7"]),
        ("f 1 2 x", &["line 5", "\"x\""]),
        ("f 1 2 3/", &[]),
        ("f 1 2 /3", &["line 5", "\"/3\""]),
        ("f 1 2 3/1/1/1", &["line 5"]),
        ("f 1 2 99999999999999999999", &["line 5", "99999999999999999999"]),
        ("v 1 2", &["line 5", "2 numbers; 3"]),
        ("v 1 2 three", &["line 5", "\"three\""]),
        ("vn 1 2", &["line 5"]),
        ("vt", &["line 5"]),
    ] {
        if parts.is_empty() {
            obj(&format!("{TRIANGLE}{bad}\n"));
        } else {
            assert_holds(&message(&format!("{TRIANGLE}{bad}\n")), parts);
        }
    }
}

#[test]
fn files_without_a_scene_are_refused() {
    let folder = Folder::new();
    assert_holds(&message("v 0 0 0\n"), &["a.obj", "no triangles"]);
    assert_holds(&message(""), &["a.obj", "no triangles"]);
    assert_holds(&folder.message("lost.obj"), &["cannot read", "lost.obj"]);
    folder.write("scene.txt", TRIANGLE);
    assert_holds(
        &folder.message("scene.txt"),
        &["scene.txt", ".obj, .gltf, .glb, .ply, .stl, .off or .json"],
    );
    folder.write("SCENE.OBJ", TRIANGLE);
    assert_eq!(folder.scene("SCENE.OBJ").mesh.triangles.len(), 1);
}

#[test]
fn objects_and_groups_own_their_faces_even_when_opened_again() {
    let scene = obj("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\no house\nf 1 2 3 4\ng empty\n\
                     g roof tiles\nf 1 2 3\no tree\nf 1 2 3\no house\ng roof tiles\nf 1 2 3\ng\nf 1 2 3\n");
    let owners: Vec<String> =
        (0..7).map(|i| scene.objects.path(scene.objects.of(i).expect("an object"))).collect();
    let roof = "house/roof tiles";
    assert_eq!(owners, ["default", "house", "house", roof, "tree", roof, "house"]);
    assert_eq!(scene.objects.len(), 4, "no object for groups without faces");
    assert!(scene.objects.iter().all(|object| object.instance.is_none()));
}

#[test]
fn faces_of_two_corners_are_left_out_and_counted() {
    let folder = Folder::new();
    folder.write("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2\nf 3\nf 3 2 1\n");
    let scene = folder.scene("a.obj");
    assert_eq!(scene.mesh.triangles.len(), 2);
    assert!(warns(&scene, &["2 faces", "left out", "line 5"]), "{:?}", scene.warnings);
    folder.write("a.obj", "v 0 0 0\nv 1 0 0\nf 1 2\n");
    let message = folder.message("a.obj");
    assert!(message.contains("no triangles") && message.contains("line 3"), "{message}");
}
