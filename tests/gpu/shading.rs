//! Patterns in WGSL on the GPU: the CPU's bytes, and what reports tell, whatever fails.

use raystream::engine::{PreparedScene, Shading, UnitChoice, Units};
use raystream::film::Image;
use raystream::program::PatternShader;
use raystream::program::gpu::ShadingReport;
use raystream::render::Settings;
use raystream::scene::{Camera, ProceduralSurface, load};
use raystream::schedule::{JobOptions, Service, ServiceOptions, Unit};
use raystream::trace::gpu::Fault;
use std::path::Path;

/// A picture's hash, what the GPU computed, and why it did not compute more.
fn render(shading: Shading, fault: Option<Fault>) -> (String, Vec<ShadingReport>, Vec<String>) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut scene = load::load(root.join("scenes/cornell.json")).expect("scene");
    let text = std::fs::read_to_string(root.join("scenes/shaders/wood.wgsl")).expect("a shader");
    let shader = PatternShader::load("wood.wgsl", &text, []).expect("valid");
    scene.replace_surface("white", ProceduralSurface::new(shader)).expect("the box has white walls");
    let mut choice = UnitChoice::auto().with_unit(Unit::Cpu).with_shading(shading);
    if let Some(fault) = fault {
        choice = choice.with_fault(fault);
    }
    let prepared = PreparedScene::new(scene, &Units::open(&choice).expect("units")).expect("a valid scene");
    assert!(prepared.adapter.is_none(), "the CPU alone traces");
    let camera = prepared.scene.camera.unwrap_or_else(|| Camera::framing(&prepared.scene.bounds(), 1.0));
    let path =
        prepared.path(&camera, Settings::new(40, 40).with_spp(4).with_max_bounces(2)).expect("settings");
    let service = Service::new(ServiceOptions::default().with_host_threads(2)).expect("threads");
    let report = prepared.submit(&service, path.clone(), JobOptions::default()).expect("job").wait();
    assert_eq!(report.expect("frame").events, [""; 0]);
    let hash = Image::new(40, 40, path.film().resolve()).hash();
    (hash, prepared.shading_reports(), prepared.unshaded.clone())
}

#[test]
fn patterns_on_the_gpu_have_the_bytes_of_the_cpu_whatever_fails() {
    let (expected, reports, unshaded) = render(Shading::Cpu, None);
    assert_eq!((reports.len(), unshaded.len()), (0, 0));
    let (hash, reports, unshaded) = render(Shading::Gpu, None);
    assert_eq!((&hash, unshaded.len()), (&expected, 0));
    let [report] = reports.as_slice() else { panic!("one pattern: {reports:?}") };
    assert!(report.eligible > 5 && report.shaded * 10 > report.eligible * 9, "{report:?}");
    assert!(report.refused.is_none() && report.points > 1000 && report.checked * 64 >= report.points);
    for (fault, says) in [
        (Fault::ShadeLost(1), "lost"),
        (Fault::ShadeLost(3), "lost"),
        (Fault::ShadeHang(2), "did not return within"),
        (Fault::ShadeCorrupt(2), "points differ"),
    ] {
        let (hash, reports, unshaded) = render(Shading::Gpu, Some(fault));
        assert_eq!((&hash, unshaded.len()), (&expected, 0), "{fault}");
        let refused = reports[0].refused.as_deref().unwrap_or_default();
        assert!(refused.contains(says) && reports[0].shaded < reports[0].eligible, "{fault}: {reports:?}");
    }
    for (fault, says) in [(Fault::ShadeRefused, "no kernel"), (Fault::ShadeInexact, "\"a * b\"")] {
        let (hash, reports, unshaded) = render(Shading::Gpu, Some(fault));
        assert_eq!((&hash, reports.len()), (&expected, 0), "{fault}");
        assert!(unshaded.len() == 1 && unshaded[0].contains(says), "{fault}: {unshaded:?}");
        assert!(unshaded[0].starts_with("wood.wgsl is shaded on the CPU"), "{unshaded:?}");
    }
}
