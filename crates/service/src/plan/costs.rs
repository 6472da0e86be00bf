//! What a farm has, what things cost, and what is to be done.

use raystream::schedule::Priority;
use serde::{Deserialize, Serialize};

/// A farm: equal machines and a network.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Farm {
    /// Machines that render.
    pub machines: u32,
    /// Bits a second of each link, in each direction: that of the coordinator, with the NATS server beside it, and
    /// those of the machines.
    pub network_bits: f64,
    /// Mean time between two failures of a machine, in seconds. It comes back after [`Costs::startup_s`].
    pub failure_s: Option<f64>,
    /// The share of units that two workers render.
    pub compared: f64,
}

/// The costs of a farm's work, in seconds and bytes. The defaults are those of a small machine without a GPU: two cores
/// of a 2023 server as coordinator, a scene of 50 MB, pictures without layers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Costs {
    /// Pixels × samples a second of a machine, all of its slots together.
    pub samples_per_second: f64,
    /// Units that a machine renders at the same time.
    pub slots: u32,
    /// Time of a machine that a unit takes besides its samples.
    pub unit_s: f64,
    /// From the start of a machine until it asks for units.
    pub startup_s: f64,
    /// Bytes of the scene, which each machine fetches once.
    pub scene_bytes: f64,
    /// Time of a machine to read the scene and build its tree.
    pub read_s: f64,
    /// Bytes of the sums of a pixel.
    pub pixel_bytes: f64,
    /// A message and its answer.
    pub round_trip_s: f64,
    /// Threads of the coordinator.
    pub coordinator_threads: f64,
    /// Pixels × samples a second of all of them together, where the coordinator renders rows of a live view.
    pub coordinator_samples_per_second: f64,
    /// Time of a thread of the coordinator that a question takes.
    pub question_s: f64,
    /// The same for the sums of a unit: to check them, write them to the disk and add them up.
    pub keep_s: f64,
    /// The same for each byte of them.
    pub keep_byte_s: f64,
    /// A transaction of the ledger. It has one at a time.
    pub commit_s: f64,
    /// Looking for what is to be done next.
    pub look_s: f64,
    /// Offering a unit. Offers are made one after another.
    pub offer_s: f64,
    /// Planning a job, which reads its scene.
    pub plan_s: f64,
    /// Opening a frame.
    pub open_s: f64,
    /// Writing the pictures of a frame.
    pub finish_s: f64,
    /// Time for which a worker may be silent about a unit before another one gets it.
    pub lease_s: f64,
}

impl Default for Costs {
    fn default() -> Self {
        Self {
            samples_per_second: 1e6,
            slots: 2,
            unit_s: 0.005,
            startup_s: 1.0,
            scene_bytes: 50e6,
            read_s: 1.0,
            pixel_bytes: 28.0,
            round_trip_s: 0.3e-3,
            coordinator_threads: 2.0,
            coordinator_samples_per_second: 1e6,
            question_s: 0.1e-3,
            keep_s: 1.0e-3,
            keep_byte_s: 4.0e-9,
            commit_s: 0.4e-3,
            look_s: 1.0e-3,
            offer_s: 0.3e-3,
            plan_s: 1.0,
            open_s: 0.05,
            finish_s: 1.0,
            lease_s: 15.0,
        }
    }
}

impl Costs {
    /// Returns what is wrong with them, if anything: the name of a field and what it must be.
    pub fn problem(&self) -> Option<String> {
        let positive = [
            ("samples_per_second", self.samples_per_second),
            ("coordinator_threads", self.coordinator_threads),
            ("coordinator_samples_per_second", self.coordinator_samples_per_second),
            ("lease_s", self.lease_s),
            ("pixel_bytes", self.pixel_bytes),
        ];
        let others = [
            ("unit_s", self.unit_s),
            ("startup_s", self.startup_s),
            ("scene_bytes", self.scene_bytes),
            ("read_s", self.read_s),
            ("round_trip_s", self.round_trip_s),
            ("question_s", self.question_s),
            ("keep_s", self.keep_s),
            ("keep_byte_s", self.keep_byte_s),
            ("commit_s", self.commit_s),
            ("look_s", self.look_s),
            ("offer_s", self.offer_s),
            ("plan_s", self.plan_s),
            ("open_s", self.open_s),
            ("finish_s", self.finish_s),
        ];
        let is_usable = |value: f64| value.is_finite() && (0.0..1e15).contains(&value);
        let named = |name: &str, value: f64, least: &str| format!("{name} is {value}; it must be {least}");
        if !(1..=64).contains(&self.slots) {
            return Some(named("slots", f64::from(self.slots), "1 to 64"));
        }
        let wrong = positive.iter().find(|(_, value)| !is_usable(*value) || *value <= 0.0);
        let wrong = wrong.map(|(name, value)| named(name, *value, "more than 0"));
        let other = others.iter().find(|(_, value)| !is_usable(*value));
        wrong.or_else(|| other.map(|(name, value)| named(name, *value, "0 or more")))
    }
}

/// A job of pictures with the same number of samples in each pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct FramesJob {
    /// Its name.
    pub name: String,
    /// Width and height in pixels.
    pub size: (u32, u32),
    /// Samples of each pixel.
    pub spp: u32,
    /// Pictures.
    pub frames: u32,
    /// Its priority.
    pub priority: Priority,
}

/// A live view: the frames of a camera that moves all the time. Machines render rows of each.
#[derive(Clone, Debug, PartialEq)]
pub struct LiveJob {
    /// Its name.
    pub name: String,
    /// Width and height in pixels.
    pub size: (u32, u32),
    /// Samples of each pixel of a frame.
    pub spp: u32,
    /// Frames that are shown.
    pub frames: u32,
    /// Bytes of a pixel, ready to be shown.
    pub pixel_bytes: f64,
}

/// A job to plan for.
#[derive(Clone, Debug, PartialEq)]
pub enum PlannedJob {
    /// Pictures.
    Frames(FramesJob),
    /// A live view.
    Live(LiveJob),
}

impl PlannedJob {
    /// A still of 1920 × 1080 pixels with 4096 samples in each.
    pub fn still() -> Self {
        let (name, size, priority) = ("still".into(), (1920, 1080), Priority::Normal);
        Self::Frames(FramesJob { name, size, spp: 4096, frames: 1, priority })
    }

    /// 1000 frames of 1920 × 1080 pixels with 256 samples in each.
    pub fn animation() -> Self {
        let (name, size, priority) = ("animation".into(), (1920, 1080), Priority::Normal);
        Self::Frames(FramesJob { name, size, spp: 256, frames: 1000, priority })
    }

    /// 100 frames of 1280 × 720 pixels with one sample in each, as JPEG.
    pub fn live() -> Self {
        let (name, size) = ("live".into(), (1280, 720));
        Self::Live(LiveJob { name, size, spp: 1, frames: 100, pixel_bytes: 0.3 })
    }

    /// The job, if it is one of pictures.
    pub fn frames(&self) -> Option<&FramesJob> {
        match self {
            Self::Frames(job) => Some(job),
            Self::Live(_) => None,
        }
    }

    /// Its name.
    pub fn name(&self) -> &str {
        match self {
            Self::Frames(job) => &job.name,
            Self::Live(job) => &job.name,
        }
    }
}
