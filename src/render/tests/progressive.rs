//! Passes, noise and checkpoints: the same picture whatever happens in between.

use super::harness::{render, tracer};
use super::scenes::{camera, room};
use crate::film::{Film, Layer};
use crate::render::{
    Aov, AovSet, CheckpointError, Identity, Integrator, PASSES_IN_FLIGHT, PICTURE_VERSION, Pass, PassOptions,
    PassPicture, PathTracer, Progressive, Settings,
};
use crate::scene::Camera;
use crate::schedule::{JobHandle, JobOptions, LimitsError, Service, ServiceOptions, Sharing, Tracers};
use std::sync::Arc;
use std::time::Duration;

/// A few threads and a scene for them.
struct Studio {
    service: Service,
    tracers: Tracers,
    scene: Arc<crate::scene::Scene>,
    camera: Camera,
}

impl Studio {
    fn new(host_threads: usize) -> Self {
        let scene = Arc::new(room());
        let options = ServiceOptions {
            host_threads,
            device_thread: false,
            max_jobs: PASSES_IN_FLIGHT,
            sharing: Sharing::FirstIn,
            ..Default::default()
        };
        Self {
            service: Service::new(options).expect("threads"),
            tracers: Tracers::cpu(Arc::new(tracer(&scene))),
            camera: camera(),
            scene,
        }
    }

    fn path(&self, spp: u32) -> PathTracer {
        let settings = Settings::new(100, 70).with_spp(spp).with_max_bounces(3).with_seed(1);
        let path =
            PathTracer::new(Arc::clone(&self.scene), &self.camera, settings, Some(3)).expect("settings");
        let aovs = Aov::ALL.iter().fold(AovSet::default(), |set, aov| set.with(*aov));
        path.with_aovs(&aovs).expect("layers")
    }

    /// The layers of a film.
    fn layers(&self, film: &Film) -> Vec<Layer> {
        self.path(2).frame().develop(film).layers
    }

    fn submit(&self, pass: &Arc<PathTracer>) -> Result<JobHandle, LimitsError> {
        self.service.submit(Arc::clone(pass), self.tracers.clone(), JobOptions::default())
    }

    /// One more pass; false when there is none.
    fn step(&self, frame: &mut Progressive<PathTracer>) -> bool {
        frame.begin(|pass| self.submit(pass)).expect("limits");
        frame.finish_pass().expect("no panic").is_some()
    }

    fn finish(&self, mut frame: Progressive<PathTracer>) -> (Arc<Film>, u64) {
        while self.step(&mut frame) {}
        (frame.picture(), frame.passes())
    }
}

fn identity(seed: u64) -> Identity {
    Identity::new([("seed".to_owned(), seed.to_string()), ("scene".to_owned(), "a room".to_owned())])
}

const NOISY: PassOptions = PassOptions { noise: Some(0.04), pass_time: None };
const SLOW: PassOptions = PassOptions { noise: None, pass_time: Some(Duration::from_millis(3)) };

#[test]
fn passes_make_the_same_picture_as_one_job() {
    let studio = Studio::new(2);
    let (whole, one) = studio.finish(Progressive::new(studio.path(12), PassOptions::default()));
    let (sum, several) = studio.finish(Progressive::new(studio.path(12), SLOW));
    assert!(one == 1 && several > 1, "{several} passes");
    assert_eq!(whole.resolve(), sum.resolve());
    assert_eq!(whole.sample_counts(), vec![12; 7000]);
    assert!(studio.layers(&whole) == studio.layers(&sum));
}

#[test]
fn samples_go_where_noise_is_whatever_the_threads() {
    let pictures = [1, 2, 5].map(|threads| {
        let studio = Studio::new(threads);
        let mut frame = Progressive::new(studio.path(200), NOISY);
        while studio.step(&mut frame) {}
        let noise = frame.noise().expect("asked for");
        assert!(noise.resting > 0 && noise.mean < noise.worst, "{noise:?}");
        let film = frame.picture();
        (film.resolve(), film.sample_counts(), studio.layers(&film))
    });
    assert!(pictures[0] == pictures[1] && pictures[0] == pictures[2]);
    let counts = &pictures[0].1;
    let (least, most) = (counts.iter().min(), counts.iter().max());
    assert!(least >= Some(&32) && least < most, "{least:?} to {most:?} samples");
}

#[test]
fn a_resumed_frame_ends_as_if_nothing_had_happened() {
    let studio = Studio::new(2);
    for (options, spp) in [(NOISY, 128), (SLOW, 40)] {
        let (expected, passes) = studio.finish(Progressive::new(studio.path(spp), options));
        for interrupted_after in 0..passes.min(9) {
            let mut frame = Progressive::new(studio.path(spp), options);
            let mut saved = Vec::new();
            for _ in 0..interrupted_after {
                studio.step(&mut frame);
            }
            frame.save(&identity(1), &mut saved).expect("memory");
            drop(frame);
            let frame = Progressive::resume(studio.path(spp), options, &identity(1), &saved).expect("whole");
            // Saved again before anything has begun.
            saved.clear();
            frame.save(&identity(1), &mut saved).expect("memory");
            let frame = Progressive::resume(studio.path(spp), options, &identity(1), &saved).expect("whole");
            let (film, _) = studio.finish(frame);
            assert_eq!(film.resolve(), expected.resolve(), "after {interrupted_after} passes");
            assert_eq!(film.sample_counts(), expected.sample_counts());
            assert!(studio.layers(&film) == studio.layers(&expected));
        }
    }
}

#[test]
fn a_stopped_frame_keeps_all_that_it_shows_and_ends_as_if_it_had_not_stopped() {
    let studio = Studio::new(2);
    for (options, spp) in [(NOISY, 128), (SLOW, 60), (PassOptions::default(), 60)] {
        let (expected, _) = studio.finish(Progressive::new(studio.path(spp), options));
        let mut frame = Progressive::new(studio.path(spp), options);
        let (mut stops, mut shown) = (0, vec![0; 7000]);
        loop {
            // Each run takes a little more time than the one before, so there is an end.
            for _ in 0..stops / 4 {
                studio.step(&mut frame);
            }
            frame.begin(|pass| studio.submit(pass)).expect("limits");
            frame.wait_for(Duration::from_millis(stops));
            frame.stop();
            while frame.finish_pass().expect("no panic").is_some() {}
            let more = frame.picture().sample_counts();
            assert!(shown.iter().zip(&more).all(|(before, now)| before <= now), "it never goes back");
            shown = more;
            if frame.is_complete() {
                break;
            }
            stops += 1;
            let mut saved = Vec::new();
            frame.save(&identity(1), &mut saved).expect("memory");
            frame = Progressive::resume(studio.path(spp), options, &identity(1), &saved).expect("whole");
            assert_eq!(frame.picture().sample_counts(), shown, "all is kept");
        }
        assert!(stops > 2, "{stops} stops");
        assert_eq!(frame.picture().resolve(), expected.resolve(), "{options:?}, stopped {stops} times");
        assert_eq!(frame.picture().sample_counts(), expected.sample_counts());
        assert!(frame.develop().layers == studio.layers(&expected));
    }
}

#[test]
fn any_thread_sees_whole_passes_while_another_drives_them() {
    let studio = Studio::new(2);
    let options = PassOptions { noise: None, pass_time: Some(Duration::from_micros(100)) };
    let mut frame = Progressive::new(studio.path(120), options);
    let preview = frame.preview();
    assert!(preview.picture().is_none(), "no pass is complete");
    let (looking, waiting) = std::thread::scope(|scope| {
        let looking = scope.spawn(|| {
            let mut seen: Vec<PassPicture> = Vec::new();
            while seen.last().is_none_or(|last| last.mean_samples < 120.0) {
                seen.extend(preview.picture());
            }
            seen
        });
        let waiting = scope.spawn(|| {
            let mut seen: Vec<PassPicture> = Vec::new();
            while let Some(picture) = preview.wait_beyond(seen.last().map_or(0, |last| last.passes)) {
                seen.push(picture);
            }
            seen
        });
        while studio.step(&mut frame) {}
        drop(frame);
        (looking.join().expect("no panic"), waiting.join().expect("no panic"))
    });
    assert!(waiting.windows(2).all(|pair| pair[0].passes < pair[1].passes), "each picture is a later one");
    let last = waiting.last().expect("a picture");
    assert_eq!((preview.passes(), last.mean_samples), (last.passes, 120.0));
    let mut pictures: Vec<_> = looking.iter().chain(&waiting).collect();
    pictures.sort_by_key(|picture| picture.passes);
    pictures.dedup_by_key(|picture| picture.passes);
    assert!(pictures.len() > 3, "{} pictures", pictures.len());
    // The same as a frame of so many samples: as bright, and without a part of a pass.
    let whole = studio.path(120);
    let tracer = tracer(&studio.scene);
    for picture in pictures.iter().step_by(pictures.len().div_ceil(6)).chain([&last]) {
        let samples = picture.mean_samples as u32;
        let expected = whole.with_pass(Pass::new(whole.frame().blocks().in_order(), 0..samples));
        render(&expected, 8192, &tracer);
        assert_eq!(picture.image.pixels, expected.film().resolve(), "{samples} samples");
        assert!(picture.layers == studio.layers(expected.film()), "{samples} samples");
    }
    // All pictures of one pass are equal.
    for picture in looking.iter().step_by(looking.len().div_ceil(200)) {
        let same = pictures.iter().find(|other| other.passes == picture.passes).expect("listed");
        assert!(same.image == picture.image, "{} passes", picture.passes);
    }
}

#[test]
fn any_thread_may_stop_a_frame() {
    let studio = Studio::new(2);
    let slow = PassOptions { noise: None, pass_time: Some(Duration::from_millis(20)) };
    let mut frame = Progressive::new(studio.path(1 << 16), slow);
    let preview = frame.preview();
    std::thread::scope(|scope| {
        scope.spawn(|| {
            preview.wait_beyond(1);
            preview.stop();
        });
        while studio.step(&mut frame) {}
    });
    assert!(!frame.is_complete() && frame.passes() >= 2, "{} passes", frame.passes());
    frame.begin(|_| panic!("no more passes")).expect("nothing is submitted");
}

#[test]
fn pictures_of_another_version_are_not_continued() {
    let text = serde_json::to_string(&identity(1)).expect("text");
    let now = format!("\"the version of the pictures\":\"{PICTURE_VERSION}\"");
    assert!(text.contains(&now), "{text}");
    let other = text.replace(&now, "\"the version of the pictures\":\"0\"");
    let other: Identity = serde_json::from_str(&other).expect("an identity");
    // Of all that differs, the version is named.
    let other = other.with("a scene", "of another encoding");
    let refused = other.compare(&identity(1)).expect_err("another version").to_string();
    let expected = format!("the version of the pictures was 0, now it is {PICTURE_VERSION}");
    assert!(refused.contains(&expected), "{refused}");
}

#[test]
fn what_is_no_checkpoint_of_the_frame_is_refused() {
    let studio = Studio::new(1);
    let mut frame = Progressive::new(studio.path(64), NOISY);
    studio.step(&mut frame);
    let mut saved = Vec::new();
    frame.save(&identity(1), &mut saved).expect("memory");
    let resume =
        |saved: &[u8], seed: u64| Progressive::resume(studio.path(64), NOISY, &identity(seed), saved).err();
    assert_eq!(resume(&saved, 1), None);
    let mismatch = resume(&saved, 2).expect("another seed").to_string();
    assert!(mismatch.contains("seed was 1, now it is 2"), "{mismatch}");
    for length in (0..saved.len()).step_by(997) {
        assert!(resume(&saved[..length], 1).is_some(), "cut after {length} bytes");
    }
    for place in (0..saved.len()).step_by(1009) {
        let mut damaged = saved.clone();
        damaged[place] ^= 4;
        assert!(resume(&damaged, 1).is_some(), "byte {place} changed");
    }
    let path = studio.path(64);
    let plain = path.with_aovs(&AovSet::default()).expect("no layers");
    let other =
        Progressive::resume(plain, NOISY, &identity(1), &saved).expect_err("other layers").to_string();
    assert!(
        other.contains("the list of layers was depth,z,") && other.ends_with("now it is empty"),
        "{other}"
    );
    assert_eq!(resume(b"PNG", 1), Some(CheckpointError::Foreign));
    let mut old = saved.clone();
    old[20..24].copy_from_slice(&2u32.to_le_bytes());
    let refused = resume(&old, 1).expect("version 2").to_string();
    assert!(refused.contains("version 2, and this raystream reads version 5"), "{refused}");
    // A right sum over wrong contents: no panic.
    saved.truncate(saved.len() - 8 - 100);
    saved.extend(xxhash_rust::xxh3::xxh3_64(&saved).to_le_bytes());
    assert_eq!(resume(&saved, 1), Some(CheckpointError::Damaged));
}
