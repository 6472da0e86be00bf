//! Several pictures: a camera that moves from frame to frame.

use super::submit;
use super::tally::Tally;
use crate::cli::args::RenderArgs;
use crate::cli::progress::{BEAT, Bar};
use crate::cli::setup::Setup;
use crate::cli::stats::{self, FrameStats, FramesStats, SCHEMA, SceneStats};
use crate::cli::{Outcome, interrupt, timeline};
use crate::film::{Image, write_image};
use crate::render::{Integrator, Sequence};
use crate::scene::{Camera, CameraPath};
use anyhow::{Context, Result, bail};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Which frames there are, what they show and what they are called.
pub struct Course {
    frames: Range<u32>,
    motion: Motion,
    names: Names,
}

enum Motion {
    Turntable { degrees: f32 },
    Path(CameraPath),
}

/// File names with a number in them.
struct Names {
    before: String,
    digits: usize,
    after: String,
}

impl Course {
    /// What the flags ask for, if they ask for several frames.
    pub fn new(args: &RenderArgs) -> Result<Option<Self>> {
        let Some(frames) = args.animation.frames.clone() else { return Ok(None) };
        let names = Names::new(&args.output)?;
        let motion = match (args.animation.turntable, &args.animation.camera_path) {
            (Some(degrees), _) if !degrees.is_finite() => bail!("--turntable {degrees}: give a finite angle"),
            (Some(degrees), _) => Motion::Turntable { degrees },
            (None, Some(path)) => {
                let text = std::fs::read_to_string(path)
                    .with_context(|| format!("{}: cannot be read", path.display()))?;
                let path = CameraPath::parse(&text).with_context(|| path.display().to_string())?;
                Motion::Path(path)
            }
            (None, None) => {
                bail!("--frames: nothing would move; say how with --turntable DEG or --camera-path FILE")
            }
        };
        Ok(Some(Self { frames, motion, names }))
    }

    /// The camera of a frame, where `own` is that of a still picture.
    fn camera(&self, frame: u32, own: &Camera, setup: &Setup) -> Camera {
        match &self.motion {
            Motion::Turntable { degrees } => {
                let degrees = (f64::from(*degrees) * f64::from(frame)) % 360.0;
                own.turned(setup.stage.scene.bounds().centre(), degrees as f32)
            }
            Motion::Path(path) => path.at(f64::from(frame)),
        }
    }
}

impl Names {
    /// Of a name that holds `%d` or, for a width of three digits, `%03d`, once.
    fn new(pattern: &Path) -> Result<Self> {
        let wrong = || {
            let path = pattern.display();
            format!("{path}: the name of several frames needs one place for their number, as in out.%04d.png")
        };
        let text = pattern.to_str().with_context(wrong)?;
        let (before, rest) = text.split_once('%').with_context(wrong)?;
        let (digits, after) = rest.split_once('d').with_context(wrong)?;
        let digits = if digits.is_empty() {
            0
        } else {
            digits.parse().ok().filter(|&n| n <= 32).with_context(wrong)?
        };
        if after.contains('%') {
            bail!(wrong());
        }
        Ok(Self { before: before.into(), digits, after: after.into() })
    }

    fn of(&self, frame: u32) -> PathBuf {
        let Self { before, digits, after } = self;
        format!("{before}{frame:0digits$}{after}").into()
    }
}

/// Renders all frames; each is written as soon as it and those before it are done.
pub fn run<I: Integrator>(
    args: &RenderArgs,
    setup: &Setup,
    course: &Course,
    own: &Camera,
    integrator: &I,
) -> Result<Outcome> {
    let in_flight = args.animation.frames_in_flight as usize;
    let mut sequence = Sequence::new(in_flight);
    let mut todo = course.frames.clone();
    let (mut tally, mut done, mut dropped_splats) = (Tally::default(), Vec::new(), 0);
    tally.events.extend(setup.stage.degraded.clone());
    interrupt::listen();
    let mut bar = Bar::new(integrator.frame().tiles() * u64::from(todo.end - todo.start));
    loop {
        while sequence.has_room()
            && let Some(frame) = todo.next()
        {
            let shot = integrator.seen_by(&course.camera(frame, own, setup));
            let shot = Arc::new(shot.with_context(|| format!("frame {frame}"))?);
            sequence.push(submit(setup, args, &shot)?, (frame, shot));
        }
        while !sequence.wait_for(BEAT) && !interrupt::asked() {
            bar.show(sequence.progress());
        }
        if interrupt::asked() {
            // Frames under way would be noisier than the others; they are dropped with the sequence.
            tally.events.push(format!("stopped after {} of {} frames", done.len(), course.frames.len()));
            break;
        }
        let Some(((frame, shot), report)) = sequence.pop() else { break };
        let report = report.with_context(|| format!("frame {frame} failed"))?;
        bar.finish_job(report.tiles, report.rays.total());
        tally.add(&report);
        let film = shot.frame().film();
        dropped_splats += film.dropped_splats();
        let image = Image { width: film.width(), height: film.height(), pixels: film.resolve() };
        let path = course.names.of(frame);
        write_image(&path, &image, args.exposure)?;
        done.push(FrameStats { frame, hash: image.hash(), seconds: report.wall_s });
    }
    drop((bar, sequence));
    let settings = integrator.frame().settings();
    let micros = tally.wall_s() * 1e6;
    let scene = &setup.stage.scene;
    let stats = FramesStats {
        schema: SCHEMA,
        scene: SceneStats { triangles: scene.mesh.triangles.len(), materials: scene.materials.len() },
        width: settings.width,
        height: settings.height,
        spp: settings.spp,
        frames: done,
        frames_in_flight: in_flight,
        seconds: tally.wall_s(),
        rays: tally.rays.into(),
        mray_per_s: tally.rays.total() as f64 / micros,
        mpath_per_s: tally.rays.camera as f64 / micros,
        units: std::mem::take(&mut tally.units),
        threads: tally.thread_stats(),
        busy_share: tally.busy_share(),
        dropped_splats,
        peak_memory_bytes: stats::peak_memory_bytes(),
        peak_rays_in_flight: tally.peak_rays_in_flight as u64,
        adapter: setup.stage.adapter.clone(),
        simd: setup.simd.name().into(),
        events: std::mem::take(&mut tally.events),
    };
    if let Some(path) = &args.stats {
        stats::write(path, &stats)?;
    }
    if let Some(path) = &args.timeline {
        timeline::write(path, &tally.threads, &tally.timeline)?;
    }
    tell(course, &stats);
    Ok(if stats.events.is_empty() { Outcome::Done } else { Outcome::Degraded })
}

fn tell(course: &Course, stats: &FramesStats) {
    for frame in &stats.frames {
        println!("{}: {:.2} s, hash {}", course.names.of(frame.frame).display(), frame.seconds, frame.hash);
    }
    println!(
        "{} frames of {}x{}, {} spp, {:.1} s on the CPU ({}){}: {:.2} Mray/s, {:.2} Mpath/s, host threads busy {:.1} %",
        stats.frames.len(),
        stats.width,
        stats.height,
        stats.spp,
        stats.seconds,
        stats.simd,
        stats.adapter.as_ref().map_or_else(String::new, |adapter| format!(" and {adapter}")),
        stats.mray_per_s,
        stats.mpath_per_s,
        100.0 * stats.busy_share
    );
    for event in &stats.events {
        eprintln!("degraded: {event}");
    }
    if stats.dropped_splats > 0 {
        println!("{} splats were not finite and were dropped", stats.dropped_splats);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_numbered() {
        let name = |pattern: &str| Names::new(Path::new(pattern)).map(|names| names.of(7));
        assert_eq!(name("a/out.%04d.png").unwrap(), PathBuf::from("a/out.0007.png"));
        assert_eq!(name("%d.exr").unwrap(), PathBuf::from("7.exr"));
        for bad in ["out.png", "out.%04x.png", "%d.%d.png", "%99d.png", "%-3d.png"] {
            assert!(name(bad).is_err(), "{bad}");
        }
    }
}
