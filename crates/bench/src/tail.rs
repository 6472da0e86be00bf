//! `raystream bench tail`: how long threads wait for work while a frame ends, with each remedy.

use super::Spread;
use super::frame::FrameError;
use raystream::engine::PreparedScene;
use raystream::render::{Integrator, PathTracer, ROULETTE_BOUNCES, Sequence, Settings};
use raystream::scene::Camera;
use raystream::schedule::{JobOptions, JobReport, Policy, Service, ThreadKind};
use serde::Serialize;
use std::sync::Arc;

/// The frame, and how often it is rendered.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Size, samples, depth and seed of the frame.
    pub settings: Settings,
    /// The camera.
    pub camera: Camera,
    /// Number of frames in flight together.
    pub frames_in_flight: usize,
    /// Rounds.
    pub rounds: usize,
    /// The scheduling policy; by default the one for the units in use.
    pub policy: Option<Policy>,
}

/// Idle time with one remedy.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The remedy.
    pub configuration: String,
    /// Host threads.
    pub threads: usize,
    /// Seconds of a frame.
    pub seconds: Spread,
    /// Seconds of a frame in which host threads had no task, summed over the threads.
    pub idle_s: Spread,
    /// The part of `idle_s` after the last camera rays were spawned. Absent for frames in flight together: their tails
    /// are filled by other frames.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tail_idle_s: Option<Spread>,
    /// Share of the host threads' time in which they had a task.
    pub busy_share: Spread,
}

/// A prepared scene and the service that renders it.
#[derive(Debug, Clone, Copy)]
pub struct Bench<'a> {
    /// The scene with its tree and tracers.
    pub prepared: &'a PreparedScene,
    /// The service; it must take as many jobs at a time as there are frames in flight.
    pub service: &'a Service,
    /// The frame.
    pub options: Options,
}

/// A remedy to measure.
struct Plan {
    name: String,
    frames: usize,
    shrink_streams: bool,
}

/// Seconds of one frame: the mean over frames rendered together.
#[derive(Clone, Copy)]
struct Times {
    wall_s: f64,
    busy_s: f64,
    tail_idle_s: f64,
}

impl Bench<'_> {
    /// Measures a frame alone, without and with streams that shrink, and several such frames together.
    ///
    /// # Errors
    /// When a frame cannot be rendered.
    pub fn run(&self) -> Result<Vec<Row>, FrameError> {
        let in_flight = self.options.frames_in_flight;
        let plan = |name: String, frames, shrink_streams| Plan { name, frames, shrink_streams };
        let plans = [
            plan("streams large to the end".into(), 1, false),
            plan("streams that shrink".into(), 1, true),
            plan(format!("and {in_flight} frames in flight"), in_flight, true),
        ];
        let mut times = plans.each_ref().map(|_| Vec::new());
        for round in 0..=self.options.rounds {
            for (plan, times) in plans.iter().zip(&mut times) {
                let measured = self.frames(plan)?;
                // The first round warms caches and allocates streams.
                if round > 0 {
                    times.push(measured);
                }
            }
        }
        let threads = self.service.host_threads();
        let idle = |times: &Times| (threads as f64 * times.wall_s - times.busy_s).max(0.0);
        let row = |(plan, times): (&Plan, Vec<Times>)| {
            let spread = |of: &dyn Fn(&Times) -> f64| Spread::of_times(times.iter().map(of).collect());
            let busy = |times: &Times| times.busy_s / (threads as f64 * times.wall_s);
            Row {
                configuration: plan.name.clone(),
                threads,
                seconds: spread(&|times| times.wall_s),
                idle_s: spread(&idle),
                tail_idle_s: (plan.frames == 1).then(|| spread(&|times| times.tail_idle_s)),
                busy_share: Spread::of_rates(times.iter().map(busy).collect()),
            }
        };
        Ok(plans.iter().zip(times).map(row).collect())
    }

    /// Renders the plan's frames, four times as many as are in flight at once, as an animation does.
    fn frames(&self, plan: &Plan) -> Result<Times, FrameError> {
        let Options { settings, camera, policy, .. } = self.options;
        let options = JobOptions::default().with_policy(policy).with_shrink_streams(plan.shrink_streams);
        let path = PathTracer::new(self.prepared.scene.clone(), &camera, settings, Some(ROULETTE_BOUNCES))?;
        let mut sequence = Sequence::new(plan.frames);
        let mut todo = if plan.frames == 1 { 1 } else { 4 * plan.frames };
        let count = todo as f64;
        let mut reports: Vec<JobReport> = Vec::new();
        loop {
            while sequence.has_room() && todo > 0 {
                let frame = Arc::new(path.seen_by(&camera).map_err(raystream::render::SettingsError::from)?);
                let job =
                    self.service.submit(Arc::clone(&frame), self.prepared.tracers.clone(), options.clone());
                sequence.push(job?, frame);
                todo -= 1;
            }
            let Some((_, report)) = sequence.pop() else { break };
            reports.push(report.map_err(|error| FrameError::Job { configuration: "a frame", error })?);
        }
        let begin_ns = reports.iter().map(|report| report.begin_ns).min().unwrap_or(0);
        let end_s = |report: &JobReport| (report.begin_ns - begin_ns) as f64 * 1e-9 + report.wall_s;
        let wall_s = reports.iter().map(end_s).fold(0.0, f64::max);
        let hosts = || {
            let threads = reports.iter().flat_map(|report| &report.threads);
            threads.filter(|thread| thread.kind == ThreadKind::Host)
        };
        Ok(Times {
            wall_s: wall_s / count,
            busy_s: hosts().map(|thread| thread.busy_s).sum::<f64>() / count,
            tail_idle_s: hosts().map(|thread| thread.tail_idle_s).sum::<f64>() / count,
        })
    }
}
