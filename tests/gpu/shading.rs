//! Patterns and BSDFs in WGSL on the GPU: the CPU's bytes, and what reports tell, whatever fails.

use raystream::engine::{PreparedScene, Shading, UnitChoice, Units};
use raystream::film::Image;
use raystream::program::SurfaceShader;
use raystream::program::gpu::ShadingReport;
use raystream::render::Settings;
use raystream::scene::{Camera, load};
use raystream::schedule::{JobOptions, JobReport, Service, ServiceOptions, Unit};
use raystream::trace::gpu::Fault;
use std::path::Path;

/// What is known of a picture.
struct Rendered {
    hash: String,
    /// What the GPU computed.
    reports: Vec<ShadingReport>,
    /// Why it was not given more.
    unshaded: Vec<String>,
    job: JobReport,
}

/// Surfaces of the box: a pattern, BSDFs, or both.
type Surfaces = &'static [(&'static str, &'static str)];
const WOOD: Surfaces = &[("white", "wood.wgsl")];
const CLOTH: Surfaces = &[("white", "velvet.wgsl"), ("red", "dust.wgsl")];
const BOTH: Surfaces = &[("white", "velvet.wgsl"), ("green", "wood.wgsl"), ("red", "dust.wgsl")];

fn render(surfaces: Surfaces, unit: Unit, shading: Shading, fault: Option<Fault>) -> Rendered {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut scene = load::load(root.join("scenes/cornell.json")).expect("scene");
    for (material, file) in surfaces {
        let text = std::fs::read_to_string(root.join("scenes/shaders").join(file)).expect("a shader");
        let shader = SurfaceShader::load(file, &text, []).expect("valid");
        scene.replace_surface(material, shader).expect("the box has such walls");
    }
    let mut choice = UnitChoice::auto().with_unit(unit).with_shading(shading);
    if let Some(fault) = fault {
        choice = choice.with_fault(fault);
    }
    let prepared = PreparedScene::new(scene, &Units::open(&choice).expect("units")).expect("a valid scene");
    assert_eq!(prepared.adapter.is_none(), unit == Unit::Cpu, "{:?}", prepared.degraded);
    let camera = prepared.scene.camera.unwrap_or_else(|| Camera::framing(&prepared.scene.bounds(), 1.0));
    let path =
        prepared.path(&camera, Settings::new(40, 40).with_spp(4).with_max_bounces(2)).expect("settings");
    let service = Service::new(ServiceOptions::default().with_host_threads(2)).expect("threads");
    let options = JobOptions::default().with_threshold(1024);
    let job = prepared.submit(&service, path.clone(), options).expect("job").wait().expect("frame");
    let hash = Image::new(40, 40, path.film().resolve()).hash();
    Rendered { hash, reports: prepared.shading_reports(), unshaded: prepared.unshaded.clone(), job }
}

#[test]
fn patterns_on_the_gpu_have_the_bytes_of_the_cpu_whatever_fails() {
    has_the_bytes_of_the_cpu_whatever_fails(WOOD);
}

#[test]
fn bsdfs_on_the_gpu_have_the_bytes_of_the_cpu_whatever_fails() {
    has_the_bytes_of_the_cpu_whatever_fails(CLOTH);
}

fn has_the_bytes_of_the_cpu_whatever_fails(surfaces: Surfaces) {
    let file = surfaces[0].1;
    let Rendered { hash: expected, reports, unshaded, job } = render(surfaces, Unit::Cpu, Shading::Cpu, None);
    assert_eq!((reports.len(), unshaded.len(), job.shading.staging.rays), (0, 0, 0));
    for unit in [Unit::Cpu, Unit::Gpu, Unit::Hybrid] {
        let Rendered { hash, reports, unshaded, job } = render(surfaces, unit, Shading::Gpu, None);
        assert_eq!((&hash, unshaded.len(), job.events.len()), (&expected, 0, 0), "{unit:?}");
        assert_eq!(reports.len(), surfaces.len(), "{reports:?}");
        for report in &reports {
            assert!(report.eligible > 5 && report.shaded * 10 > report.eligible * 9, "{unit:?} {report:?}");
            assert!(report.refused.is_none() && report.points > 500 && report.checked * 64 >= report.points);
            assert!(report.is_bsdf != (file == "wood.wgsl") && report.undecided * 20 < report.points);
        }
        // The others are shadow rays of streams that have no rays to stage.
        assert!(job.shading.staged.rays * 10 > job.rays.total() * 8, "{:?}", job.shading);
    }
    for (fault, says) in [
        (Fault::ShadeLost(1), "lost"),
        (Fault::ShadeLost(3), "lost"),
        (Fault::ShadeHang(2), "did not return within"),
        (Fault::ShadeCorrupt(2), "points differ"),
        (Fault::ShadeOutOfMemory, "no memory"),
    ] {
        let Rendered { hash, reports, unshaded, job } =
            render(surfaces, Unit::Cpu, Shading::Gpu, Some(fault));
        assert_eq!((&hash, unshaded.len()), (&expected, 0), "{fault}");
        let failed: Vec<&ShadingReport> = reports.iter().filter(|report| report.refused.is_some()).collect();
        let refused =
            failed.iter().any(|report| report.refused.as_deref().unwrap_or_default().contains(says));
        assert!(refused && failed[0].shaded < failed[0].eligible, "{fault}: {reports:?}");
        let event = &job.events[0];
        assert!(event.starts_with("a GPU failed to shade (") && event.contains(says), "{event}");
        assert!(surfaces.iter().any(|(_, file)| event.contains(file)), "{event}");
        assert_eq!(job.events.len(), 1, "{fault}: {:?}", job.events);
    }
    for (fault, says) in [(Fault::ShadeRefused, "no kernel"), (Fault::ShadeInexact, "\"a * b\"")] {
        let Rendered { hash, reports, unshaded, job } =
            render(surfaces, Unit::Cpu, Shading::Gpu, Some(fault));
        assert_eq!((&hash, reports.len(), job.events.len()), (&expected, 0, 0), "{fault}");
        assert!(unshaded.len() == surfaces.len() && unshaded[0].contains(says), "{fault}: {unshaded:?}");
        assert!(unshaded[0].starts_with(&format!("{file} is shaded on the CPU")), "{unshaded:?}");
    }
}

/// Rows of a stream hold results of both kinds, and of neither.
#[test]
fn patterns_and_bsdfs_of_one_scene_share_the_gpu() {
    let expected = render(BOTH, Unit::Cpu, Shading::Cpu, None).hash;
    for fault in [None, Some(Fault::ShadeCorrupt(4)), Some(Fault::ShadeLost(5))] {
        let Rendered { hash, reports, .. } = render(BOTH, Unit::Cpu, Shading::Gpu, fault);
        assert_eq!((&hash, reports.len()), (&expected, 3), "{fault:?}");
        let shaded = |report: &ShadingReport| report.shaded * 10 > report.eligible * 9;
        assert_eq!(reports.iter().all(shaded), fault.is_none(), "{fault:?}: {reports:?}");
    }
}

#[test]
fn a_gpu_that_is_lost_while_it_shades_is_lost_for_tracing_too() {
    for surfaces in [WOOD, CLOTH] {
        let expected = render(surfaces, Unit::Cpu, Shading::Cpu, None).hash;
        // Beside it, processors could trace so much that it is not asked often enough to fail.
        for fault in [Fault::ShadeLost(2), Fault::Lost(3), Fault::ShadeCorrupt(2)] {
            let Rendered { hash, job, .. } = render(surfaces, Unit::Gpu, Shading::Gpu, Some(fault));
            assert_eq!(hash, expected, "{fault}");
            assert!((1..=2).contains(&job.events.len()), "{fault}: {:?}", job.events);
        }
    }
}
