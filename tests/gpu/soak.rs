//! A long run in miniature: small frames, one after the other, while devices fail at random points. Every picture is
//! the CPU's, lost devices are replaced, memory stays flat, nothing hangs.

use raystream::device::Fault;
use raystream::engine::{PreparedScene, UnitChoice, Units};
use raystream::film::Image;
use raystream::render::{PathTracer, Settings};
use raystream::scene::{Camera, Scene, load};
use raystream::schedule::{JobOptions, Policy, Service, ServiceOptions, Unit};
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Frames that are rendered in all.
const FRAMES: usize = 60;

/// Frames that are rendered with the same stage; after them the machine is opened anew.
const FRAMES_A_STAGE: usize = 5;

/// Devices that are open at the same time before memory is measured: more than ever are later, lost ones included.
const AT_ONCE: usize = 8;

/// What a run has seen.
#[derive(Debug, Default)]
struct Seen {
    frames: usize,
    losses: usize,
    /// Frames to which a device contributed after a loss of an earlier one.
    with_a_replacement: usize,
}

fn cornell() -> Arc<Scene> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell.json");
    Arc::new(load::load(&file).expect("scene"))
}

/// Opens devices at the same time, each with a scene. What they take, the allocator keeps.
fn open_at_once() {
    let scene = cornell();
    let open = |_| {
        let units = Units::open(&UnitChoice::auto().with_unit(Unit::Gpu)).expect("units");
        PreparedScene::new(scene.clone(), &units).expect("a valid scene")
    };
    let open: Vec<_> = (0..AT_ONCE).map(open).collect();
    assert!(open.iter().all(|prepared| prepared.tracers.device.is_some()));
}

/// Renders `frames` frames with a device that fails somewhere among each few.
fn soak(frames: usize, seed: u32) -> Seen {
    let scene = cornell();
    let camera = scene.camera.unwrap_or_else(|| Camera::framing(&scene.bounds(), 1.0));
    let options = ServiceOptions::default().with_host_threads(2);
    let service = Service::new(options).expect("threads");
    let mut random = crate::meshes::Random::new(u64::from(seed));
    let render = |prepared: &PreparedScene, policy: Policy| {
        let settings = Settings::new(24, 24).with_spp(4).with_max_bounces(3).with_seed(5);
        let path = Arc::new(PathTracer::new(scene.clone(), &camera, settings, None).expect("settings"));
        let options = JobOptions::default().with_policy(policy);
        let job = service.submit(path.clone(), prepared.tracers.clone(), options).expect("job");
        let report = job.wait().expect("frame");
        let image = Image::new(24, 24, path.film().resolve());
        (image.hash(), report)
    };
    let prepared = |units: &Units| PreparedScene::new(scene.clone(), units).expect("a valid scene");
    let (expected, _) = render(&prepared(&Units::cpu()), Policy::ShadeFirst);

    let mut seen = Seen::default();
    while seen.frames < frames {
        let at = 1 + u64::from(random.below(4));
        let fault = match random.below(8) {
            0 => Fault::Corrupt(at),
            1 => Fault::OutOfMemory,
            _ => Fault::Lost(at),
        };
        let unit = if random.below(2) == 0 { Unit::Gpu } else { Unit::Hybrid };
        let choice = UnitChoice::auto().with_unit(unit).with_fault(fault);
        let prepared = prepared(&Units::open(&choice).expect("units"));
        let mut lost = false;
        for _ in 0..FRAMES_A_STAGE {
            let policy = Policy::ALL[random.below(Policy::ALL.len() as u32) as usize];
            let (hash, report) = render(&prepared, policy);
            assert_eq!(hash, expected, "frame {}, {fault:?}", seen.frames);
            seen.frames += 1;
            let failed = !report.events.is_empty();
            seen.losses += usize::from(failed && !lost);
            seen.with_a_replacement += usize::from(lost && !failed && prepared.tracers.device.is_some());
            lost |= failed;
            if failed && random.below(2) == 0 {
                // Sometimes the next frame waits for the other device, sometimes it has to do without.
                std::thread::sleep(Duration::from_millis(800));
            }
        }
    }
    seen
}

/// Set in the environment of the process that renders the frames.
const ALONE: &str = "RAYSTREAM_SOAK_ALONE";

/// Memory in use, where the system tells.
fn resident_bytes() -> Option<usize> {
    let pages = std::fs::read_to_string("/proc/self/statm").ok()?;
    Some(pages.split(' ').nth(1)?.parse::<usize>().ok()? * 4096)
}

/// `cargo test --release --test gpu soak -- --nocapture` tells what it saw; `RAYSTREAM_DEVICE_FRAMES` asks for another
/// number of frames. What an allocator keeps is not what a device loses, so the process has one of glibc's arenas,
/// where it may have eight a core, and has had as many devices at the same time as it ever will.
#[test]
fn frames_with_failing_devices_are_right_and_memory_stays_flat() {
    // Other tests of this program take memory meanwhile, so frames are rendered in a process of their own.
    if std::env::var_os(ALONE).is_none() {
        let name = "soak::frames_with_failing_devices_are_right_and_memory_stays_flat";
        let mut alone = Command::new(std::env::current_exe().expect("this program"));
        alone.args(["--exact", name, "--nocapture"]).env(ALONE, "1").env("MALLOC_ARENA_MAX", "1");
        let status = alone.status().expect("it starts");
        assert!(status.success(), "the process ended with {status}");
        return;
    }
    let start = Instant::now();
    let frames = std::env::var("RAYSTREAM_DEVICE_FRAMES").map_or(FRAMES, |n| n.parse().expect("a number"));
    open_at_once();
    let warm = soak(frames / 3, 2);
    let before = resident_bytes();
    let seen = soak(frames - frames / 3, 3);
    let after = resident_bytes();
    println!("{warm:?}, then {seen:?}, {:.0} s; {before:?} → {after:?} bytes", start.elapsed().as_secs_f32());
    assert!(seen.losses >= frames / 25 && seen.with_a_replacement >= frames / 100, "{seen:?}");
    if let (Some(before), Some(after)) = (before, after) {
        assert!(after < before + (16 << 20), "{before} bytes before, {after} after");
    }
}
