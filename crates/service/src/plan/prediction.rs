//! What is predicted.

use serde::Serialize;

/// The load of a part of the farm.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Load {
    /// The part's name.
    pub name: &'static str,
    /// The share of the time, or of what it can carry, from 0 to 1.
    pub share: f64,
}

/// The predicted time, bytes and loads of a job on a farm.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Prediction {
    /// The job.
    pub job: String,
    /// Machines that render.
    pub machines: u32,
    /// The power that renders, in machines: the coordinator renders rows of live views, too.
    pub power: f64,
    /// From the start of the machines, when the job is submitted, until its last picture is written. Of a live view:
    /// the time in which its moving frames have as many pixels as all its frames would have in full size.
    pub seconds: f64,
    /// The part of it before the first unit is rendered.
    pub first_s: f64,
    /// Frames a second, those of a live view as large as they were.
    pub frames_per_second: f64,
    /// Units that are rendered, or tiles of a live view.
    pub units: u64,
    /// The mean of the seconds that a unit, or a tile of a live view, takes.
    pub unit_s: f64,
    /// The share of the machines' time in which they do nothing, from 0 to 1.
    pub idle_share: f64,
    /// Bytes that the coordinator sends and gets.
    pub bytes: f64,
    /// Units that came to a worker from another, or tiles of a live view that came too late.
    pub redeliveries: u64,
    /// The load of each part.
    pub loads: Vec<Load>,
    /// The reason why the job fails, if it does.
    pub failed: Option<String>,
}

impl Prediction {
    /// The prediction of a job that goes on after this part of it: what was added between two times is added so many
    /// times more.
    pub(super) fn extended(self, between: [&Self; 2], times: f64, frames: u32) -> Self {
        let [from, to] = between;
        let more = |of: fn(&Self) -> f64| of(&self) + times * (of(to) - of(from));
        let seconds = more(|part| part.seconds);
        let load = |load: &Load| {
            let busy = |part: &Self| part.load(load.name) * part.seconds;
            let share = (busy(&self) + times * (busy(to) - busy(from))) / seconds;
            Load { name: load.name, share: share.max(0.0) }
        };
        let units = more(|part| part.units as f64).max(1.0);
        Self {
            seconds,
            frames_per_second: f64::from(frames) / seconds,
            units: units as u64,
            unit_s: more(|part| part.unit_s * part.units as f64) / units,
            idle_share: more(|part| part.idle_share * part.seconds) / seconds,
            bytes: more(|part| part.bytes),
            redeliveries: more(|part| part.redeliveries as f64).max(0.0) as u64,
            loads: self.loads.iter().map(load).collect(),
            ..self.clone()
        }
    }

    /// The share of the time or of what it can carry that a part is busy, from 0 to 1; 0 if there is no such part.
    pub fn load(&self, name: &str) -> f64 {
        self.loads.iter().find(|load| load.name == name).map_or(0.0, |load| load.share)
    }

    /// The busiest part besides the machines.
    pub fn busiest(&self) -> Option<&Load> {
        let others = self.loads.iter().filter(|load| load.name != "machines");
        others.max_by(|a, b| a.share.total_cmp(&b.share))
    }

    /// The load of the busier direction of the coordinator's link, from 0 to 1.
    pub fn network_share(&self) -> f64 {
        let links = self.loads.iter().filter(|load| load.name.starts_with("link"));
        links.map(|load| load.share).fold(0.0, f64::max)
    }
}
