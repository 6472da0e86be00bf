//! `raystream bench live`: how soon a live view shows a new pose, how many frames a second it has while the camera
//! moves, and how long it takes to the full picture after it stops.
//!
//! The client is in the same process. Times include the view transform and JPEG, and neither a network nor a browser.

use super::{Frame, LiveView, Request, ViewScene};
use crate::contract::Pose;
use glam::Quat;
use raystream::meters::Spread;
use serde::Serialize;
use std::io;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

/// Time between two moves: that of a display with 60 frames a second.
const MOVE_EVERY: Duration = Duration::from_micros(16_667);

/// Angle of a move around the target in radians: 30 degrees a second.
const MOVE_BY: f32 = 0.008_727;

/// Angle between the poses whose first frames are timed.
const STEP_BY: f32 = 0.35;

/// The longest time to wait for a picture.
const PATIENCE: Duration = Duration::from_secs(600);

/// Settings of the measurement.
#[derive(Clone, Debug)]
pub struct Options {
    /// Poses whose first frames and full pictures are timed.
    pub poses: usize,
    /// Time for which the camera moves.
    pub moving: Duration,
}

/// A live view's speed.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Size of the full picture in pixels.
    pub size: [u32; 2],
    /// Milliseconds from a new pose to the first frame that shows it, when the picture before was complete.
    pub first_ms: Spread,
    /// Frames a second while the camera moves.
    pub frames_per_s: f64,
    /// Mean share of the full width and height of these frames.
    pub share: f64,
    /// Samples a pixel of the full picture.
    pub spp: u32,
    /// Seconds from the last move to the full picture.
    pub full_s: Spread,
}

/// A view and its client.
struct Client {
    view: LiveView,
    woken: Receiver<()>,
    pose: Pose,
    generation: u32,
}

/// Measures a live view of a stage that is seen from a pose first.
///
/// # Errors
/// If the system gives no threads, or the view refuses a picture.
pub fn run(mut stage: ViewScene, pose: Pose, options: &Options) -> io::Result<Row> {
    pose.write(stage.prepared.scene.camera.as_ref(), &mut stage.spec);
    let size = <[u32; 2]>::from(stage.spec.size);
    let spp = stage.spec.stop.samples();
    let (wake, woken) = channel();
    let view = LiveView::new(stage, move || {
        wake.send(()).ok();
    })?;
    let mut client = Client { view, woken, pose, generation: 0 };
    client.wait(|frame| frame.flags.last)?;
    let (mut first_ms, mut full_s) = (Vec::new(), Vec::new());
    for _ in 0..options.poses {
        let began = Instant::now();
        let generation = client.turn(STEP_BY);
        client.wait(|frame| frame.generation == generation)?;
        first_ms.push(began.elapsed().as_secs_f64() * 1e3);
        client.wait(|frame| frame.generation == generation && frame.flags.last)?;
        full_s.push(began.elapsed().as_secs_f64());
    }
    let (frames_per_s, share) = client.walk(options.moving, size)?;
    let (first_ms, full_s) = (Spread::of_times(first_ms), Spread::of_times(full_s));
    Ok(Row { size, first_ms, frames_per_s, share, spp, full_s })
}

impl Client {
    /// Turns the camera around its target. Returns the generation.
    fn turn(&mut self, angle: f32) -> u32 {
        let turn = Quat::from_axis_angle(self.pose.up.normalize(), angle);
        self.pose.eye = self.pose.target + turn * (self.pose.eye - self.pose.target);
        self.generation += 1;
        self.view.ask(Request::Camera { generation: self.generation, pose: self.pose });
        self.generation
    }

    fn wait(&mut self, is_it: impl Fn(&Frame) -> bool) -> io::Result<Frame> {
        loop {
            if let Some(frame) = self.view.take_frame().filter(&is_it) {
                return Ok(frame);
            }
            let lost = || io::Error::other("the view shows nothing");
            self.woken.recv_timeout(PATIENCE).map_err(|_| lost())?;
        }
    }

    /// Moves for some time. Returns frames a second and the mean share of the full width.
    fn walk(&mut self, time: Duration, size: [u32; 2]) -> io::Result<(f64, f64)> {
        let began = Instant::now();
        // The resolution adapts during the first half.
        let measured_from = began + time / 2;
        let (mut next, mut frames, mut share) = (began, Vec::new(), 0.0);
        while began.elapsed() < time {
            let now = Instant::now();
            if now >= next {
                self.turn(MOVE_BY);
                next += MOVE_EVERY;
                continue;
            }
            self.woken.recv_timeout(next - now).ok();
            if let Some(frame) = self.view.take_frame()
                && Instant::now() >= measured_from
            {
                frames.push(Instant::now());
                share += f64::from(frame.size[0]) / f64::from(size[0]);
            }
        }
        match (frames.first(), frames.last()) {
            (Some(&first), Some(&last)) if last > first => {
                let intervals = (frames.len() - 1) as f64;
                Ok((intervals / (last - first).as_secs_f64(), share / frames.len() as f64))
            }
            _ => {
                Err(io::Error::other("fewer than two frames came while the camera moved; let it move longer"))
            }
        }
    }
}
