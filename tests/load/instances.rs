//! Geometry that nodes show several times stays known as such, and the mesh has moved copies of it to the bit.

use crate::document::Document;
use raystream::bvh::{Bvh, TreeInstance};
use raystream::engine::{MIN_SAVED_TRIANGLES, PreparedScene, Units, build_tree};
use raystream::film::Image;
use raystream::render::{PathTracer, Settings};
use raystream::scene::{Camera, Environment};
use raystream::schedule::{JobOptions, Service, ServiceOptions};
use serde_json::json;
use std::sync::Arc;

/// Two triangles in mesh 0, shared by mesh 1, which has another material; a third mesh of its own.
fn document() -> Document {
    let mut document = Document::new();
    let corners = [0.1, 0.0, 0.3, 1.0, 0.7, 0.0, 0.0, 1.0, 0.2, 1.3, 1.0, 0.9];
    let positions = document.floats("VEC3", &corners);
    let indices = document.accessor("SCALAR", 5121, 6, &[0, 1, 2, 2, 1, 3]);
    let other = document.floats("VEC3", &corners[..9]);
    for alpha in ["OPAQUE", "OPAQUE", "BLEND"] {
        let colour = json!({ "baseColorFactor": [1.0, 1.0, 1.0, 0.5] });
        document.add("materials", json!({ "alphaMode": alpha, "pbrMetallicRoughness": colour }));
    }
    for material in 0..3 {
        document.mesh(
            json!({ "attributes": { "POSITION": positions }, "indices": indices, "material": material }),
        );
    }
    document.mesh(json!({ "attributes": { "POSITION": other }, "material": 0 }));
    let turn = [0.3, 0.1, -0.5, 0.8];
    document.node(json!({ "mesh": 0, "translation": [3.3, 0.1, -7.7], "rotation": turn }));
    document.node(json!({ "mesh": 3, "scale": [0.3, 0.7, 1.1] }));
    document.node(json!({ "mesh": 1, "scale": [3.0, 0.1, 1.7], "rotation": turn }));
    document.node(json!({ "mesh": 0, "scale": [-1.0, 1.0, 1.0] }));
    document.node(json!({ "mesh": 1, "scale": [1.0, -2.0, 1.0], "translation": [100.1, 0.0, 0.0] }));
    document.node(json!({ "mesh": 2 }));
    document
}

#[test]
fn shapes_are_geometry_shown_alike_and_the_mesh_has_them_to_the_bit() {
    let scene = document().scene();
    assert_eq!(scene.mesh.triangles.len(), 11);
    // Mirrored ones are another shape, and so are those whose alpha counts.
    let firsts: Vec<Vec<u32>> =
        scene.shapes.iter().map(|shape| shape.instances.iter().map(|at| at.first).collect()).collect();
    assert_eq!(firsts, [[0, 3], [5, 7]]);
    for shape in scene.shapes.iter() {
        for instance in &shape.instances {
            for (primitive, triangle) in (instance.first..).zip(&shape.triangles) {
                let moved = triangle.map(|i| instance.placement.point(shape.positions[i as usize]));
                assert_eq!(moved, scene.mesh.corners(primitive));
            }
        }
    }
    let mut single = document();
    single.json["nodes"].as_array_mut().expect("a list").truncate(2);
    assert!(single.scene().shapes.is_empty());
}

#[test]
fn a_scene_s_tree_has_its_triangles_whatever_stays_shared() {
    let scene = document().scene();
    let flat = Bvh::build(&scene.mesh.positions, &scene.mesh.triangles, |p| scene.is_masked(p));
    for (worth_saving, members) in [(usize::MAX, 0), (3, 0), (2, 5), (0, 5)] {
        let tree = build_tree(&scene, worth_saving);
        assert_eq!(tree.instances().len(), members);
        assert_eq!(tree.validate(), Ok(()));
        assert_eq!((tree.len(), tree.bounds()), (flat.len(), flat.bounds()));
        assert_eq!(
            tree.instances().iter().filter(|m: &&TreeInstance| m.placement.is_some()).count(),
            members & 4
        );
        for primitive in 0..tree.len() as u32 {
            assert_eq!(tree.corners(primitive), flat.corners(primitive));
            assert_eq!(tree.is_masked(primitive), flat.is_masked(primitive));
        }
    }
}

/// Hills of `2 cells²` triangles, shown by three nodes.
fn hills(cells: u32) -> Document {
    let mut document = Document::new();
    let at = |i: u32| [(i % (cells + 1)) as f32, (i * 7 % 5) as f32, (i / (cells + 1)) as f32];
    let positions: Vec<f32> = (0..(cells + 1) * (cells + 1)).flat_map(at).collect();
    let positions = document.floats("VEC3", &positions);
    let quad = |i: u32| {
        let corner = i / cells * (cells + 1) + i % cells;
        [corner, corner + cells + 1, corner + 1, corner + 1, corner + cells + 1, corner + cells + 2]
    };
    let indices: Vec<u8> = (0..cells * cells).flat_map(quad).flat_map(u32::to_le_bytes).collect();
    let indices = document.accessor("SCALAR", 5125, indices.len() / 4, &indices);
    document.mesh(json!({ "attributes": { "POSITION": positions }, "indices": indices }));
    for turn in [0.0, 0.3, -0.6] {
        let rotation = [0.1, turn, 0.0, 0.7];
        document.node(json!({ "mesh": 0, "rotation": rotation, "translation": [100.0 * turn, 1.1, 0.0] }));
    }
    document
}

#[test]
fn a_picture_does_not_depend_on_what_is_shared() {
    let mut scene = hills(200).scene();
    scene.environment = Environment::Constant([1.0, 0.8, 0.6].into());
    assert!(scene.shapes[0].triangles.len() * 2 >= MIN_SAVED_TRIANGLES);
    let mut written_out = scene.clone();
    written_out.shapes = Vec::new().into();
    let service = Service::new(ServiceOptions::default().with_host_threads(2)).expect("threads");
    let [shared, alone] = [scene, written_out].map(|scene| {
        let camera = Camera::framing(&scene.bounds(), 1.0);
        let prepared = PreparedScene::new(Arc::new(scene), &Units::cpu()).expect("a valid scene");
        let settings = Settings::new(32, 32).with_spp(4).with_max_bounces(3).with_seed(1);
        let path =
            Arc::new(PathTracer::new(prepared.scene.clone(), &camera, settings, None).expect("settings"));
        let job = service.submit(path.clone(), prepared.tracers.clone(), JobOptions::default()).expect("job");
        job.wait().expect("frame");
        let image = Image::new(32, 32, path.film().resolve());
        (image.hash(), prepared.bvh.instances().len(), prepared.bvh.bytes())
    });
    assert_eq!((shared.1, alone.1), (3, 0));
    assert!(shared.2 * 2 < alone.2);
    assert_eq!(shared.0, alone.0);
}

/// The hash of a picture.
fn picture(prepared: &PreparedScene) -> String {
    let camera = Camera::new([60.0, 300.0, 420.0].into(), [60.0, 0.0, 60.0].into());
    let settings = Settings::new(32, 32).with_spp(2).with_max_bounces(2).with_seed(1);
    let path = prepared.path(&camera, settings).expect("valid settings");
    let service = Service::new(ServiceOptions::default().with_host_threads(2)).expect("threads");
    prepared.submit(&service, path.clone(), JobOptions::default()).expect("a job").wait().expect("a frame");
    path.film().image().hash()
}

#[test]
fn instances_that_move_keep_their_trees() {
    // Beside a triangle of its own that moves, stands still, or is not there.
    for [has_triangle, triangle_moves] in [[true, true], [true, false], [false, false]] {
        let mut document = hills(200);
        if has_triangle {
            let corners = document.floats("VEC3", &[0.0, 90.0, 0.0, 90.0, 90.0, 0.0, 0.0, 90.0, 90.0]);
            let mesh = document.mesh(json!({ "attributes": { "POSITION": corners } }));
            document.node(json!({ "mesh": mesh }));
        }
        let scene = |document: &Document| {
            let mut scene = document.scene();
            scene.environment = Environment::Constant([1.0, 0.8, 0.6].into());
            scene
        };
        let old = PreparedScene::new(scene(&document), &Units::cpu()).expect("a valid scene");
        document.json["nodes"][1]["translation"] = json!([-70.0, 40.0, 20.0]);
        if triangle_moves {
            document.json["nodes"][3]["translation"] = json!([9.0, 0.0, 9.0]);
        }
        let new = old.with_scene(scene(&document)).expect("a valid scene");
        let fresh = PreparedScene::new(scene(&document), &Units::cpu()).expect("a valid scene");
        assert_eq!(new.bvh.validate(), Ok(()));
        assert_eq!(new.bvh.scene_max_abs(), fresh.bvh.scene_max_abs());
        let kept: Vec<bool> = (old.bvh.instances().iter().zip(new.bvh.instances()))
            .map(|(old, new)| Arc::ptr_eq(&old.tree, &new.tree))
            .collect();
        let own: &[bool] = if has_triangle { &[!triangle_moves] } else { &[] };
        assert_eq!(kept, [own, &[true; 3]].concat());
        assert_eq!(picture(&new), picture(&fresh));
        assert_ne!(picture(&new), picture(&old));
    }
}

#[test]
fn each_node_is_an_object_and_copies_are_numbered() {
    let mut document = document();
    document.json["nodes"][1]["children"] = json!([2]);
    document.json["nodes"][1]["name"] = json!("lid");
    document.json["nodes"][4]["name"] = json!("knob");
    let mesh = |index: usize| format!("/meshes/{index}/name");
    assert!(document.json.pointer(&mesh(0)).is_none());
    document.json["meshes"][0]["name"] = json!("screw");
    document.json["scenes"] = json!([{ "nodes": [0, 1, 3, 4, 5] }]);
    let scene = document.scene();
    let owners: Vec<String> = (0..scene.mesh.triangles.len() as u32)
        .map(|primitive| scene.objects.path(scene.objects.of(primitive).expect("an object")))
        .collect();
    let [screw, knob, last] = ["screw", "knob", "node 5"];
    assert_eq!(
        owners,
        [screw, screw, "lid", "lid/node 2", "lid/node 2", screw, screw, knob, knob, last, last]
    );
    let instances: Vec<_> = scene.objects.iter().map(|object| object.instance).collect();
    assert_eq!(instances, [Some(0), None, Some(0), Some(1), Some(1), None]);
}
