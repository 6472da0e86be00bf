//! `raystream bench tail`: how long threads wait for work while a frame ends, with each measure against it.

use super::Spread;
use super::frame::FrameError;
use crate::engine::PreparedScene;
use crate::render::{Integrator, Path, ROULETTE_BOUNCES, Sequence, Settings};
use crate::scene::Camera;
use crate::schedule::{JobOptions, JobReport, Policy, Service, ThreadKind};
use serde::Serialize;
use std::sync::Arc;

/// What is rendered, and how often.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Size, samples, depth and seed of the frame.
    pub settings: Settings,
    /// From where.
    pub camera: Camera,
    /// Frames of those in flight together.
    pub frames_in_flight: usize,
    /// Rounds.
    pub rounds: usize,
    /// How the scheduler shares out work.
    pub policy: Option<Policy>,
}

/// One measure's idle time.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Which measure.
    pub configuration: String,
    /// Host threads.
    pub threads: usize,
    /// Of a frame.
    pub seconds: Spread,
    /// Seconds of a frame that host threads had nothing to do, added up over them.
    pub idle_s: Spread,
    /// Of these, seconds after the last camera rays had been spawned; absent for frames in flight together, whose
    /// tails others fill.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tail_idle_s: Option<Spread>,
    /// Share of the host threads' time that they had a task.
    pub busy_share: Spread,
}

/// A scene with who may render it.
#[derive(Clone, Copy)]
pub struct Bench<'a> {
    /// The scene, its tree, its tracers.
    pub prepared: &'a PreparedScene,
    /// The threads, for as many jobs at a time as there are frames in flight.
    pub service: &'a Service,
    /// The frame.
    pub options: Options,
}

/// What is tried.
struct Plan {
    name: String,
    frames: usize,
    shrink_streams: bool,
}

/// Seconds of one frame, on average over those rendered together.
#[derive(Clone, Copy)]
struct Times {
    wall_s: f64,
    busy_s: f64,
    tail_idle_s: f64,
}

impl Bench<'_> {
    /// Measures a frame by itself without and with streams that shrink, and several such frames together.
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
                // The first round warms caches and makes streams.
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

    /// Renders the plan's frames, all of them in flight at once, and as many again after them, as in an animation.
    fn frames(&self, plan: &Plan) -> Result<Times, FrameError> {
        let Options { settings, camera, policy, .. } = self.options;
        let options = JobOptions { policy, shrink_streams: plan.shrink_streams, ..JobOptions::default() };
        let path = Path::new(self.prepared.scene.clone(), &camera, settings, Some(ROULETTE_BOUNCES))?;
        let mut sequence = Sequence::new(plan.frames);
        let mut todo = if plan.frames == 1 { 1 } else { 4 * plan.frames };
        let count = todo as f64;
        let mut reports: Vec<JobReport> = Vec::new();
        loop {
            while sequence.has_room() && todo > 0 {
                let frame = Arc::new(path.seen_by(&camera).map_err(crate::render::SettingsError::from)?);
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
