//! Another appearance of a prepared scene keeps the tree on the GPU and has the bytes of a fresh scene on the CPU.

use raystream::engine::{PreparedScene, UnitChoice, Units};
use raystream::film::Image;
use raystream::render::Settings;
use raystream::scene::generate;
use raystream::scene::{AlphaMode, Material, Scene};
use raystream::schedule::{JobOptions, Service, ServiceOptions, Unit};
use std::path::Path;
use std::sync::Arc;

fn render(service: &Service, prepared: &PreparedScene) -> String {
    let settings = Settings::new(32, 32).with_spp(4).with_max_bounces(3).with_seed(7);
    let camera = prepared.scene.camera.expect("generated scenes have a camera");
    let path = prepared.path(&camera, settings).expect("settings");
    let job = prepared.submit(service, path.clone(), JobOptions::default()).expect("job");
    let report = job.wait().expect("frame");
    assert_eq!(report.events, [""; 0]);
    Image::new(32, 32, path.film().resolve()).hash()
}

#[test]
fn appearances_have_the_bytes_of_fresh_scenes() {
    let service = Service::new(ServiceOptions::default().with_host_threads(2));
    let service = service.expect("threads");
    let units = Units::open(&UnitChoice::auto().with_unit(Unit::Gpu)).expect("units");
    let scene = generate::scene(Path::new("leaves:300")).expect("a generated scene");
    let prepared = PreparedScene::new(scene, &units).expect("a valid scene");
    assert!(prepared.adapter.is_some(), "{:?}", prepared.degraded);
    let changes: [fn(&mut Scene); 4] = [
        |_| (),
        |s| s.materials[0] = Material::matte("red", glam::Vec3::X),
        |s| masked(s).mode = AlphaMode::Blend,
        |s| masked(s).value.texture = None,
    ];
    for change in changes {
        let mut scene = Scene::clone(&prepared.scene);
        change(&mut scene);
        let fresh = PreparedScene::new(scene.clone(), &Units::cpu()).expect("a valid scene");
        let new = prepared.with_scene(scene).expect("a valid scene");
        assert!(Arc::ptr_eq(&new.bvh, &prepared.bvh));
        assert_eq!(render(&service, &new), render(&service, &fresh));
    }
}

/// The alpha of the leaves.
fn masked(scene: &mut Scene) -> &mut raystream::scene::Alpha {
    let leaf = scene.materials.iter_mut().find(|material| material.alpha.mode.is_masked());
    &mut leaf.expect("the leaves are masked").alpha
}
