//! The measured cost of workers and their units, from which follows how many of them help
//! ([`decisions::most_workers`]).

use super::decisions::{self, Fetch, Load};
use crate::contract::{Answer, Granted, REPORT, ResultReply};
use std::time::{Duration, Instant};

/// Units that are measured before their costs are believed.
const BELIEVED: u64 = 32;

/// The weight of the last value in a mean.
const WEIGHT: f64 = 1.0 / 64.0;

/// Parts of scenes that come closer after each other than this are one stretch of time in which the link was busy.
const STRETCH: Duration = Duration::from_millis(250);

/// Bytes of scenes after which a rate is believed, and those after which what came before counts half.
const BELIEVED_BYTES: f64 = (4 << 20) as f64;
const HALF_BYTES: f64 = (256 << 20) as f64;

/// A mean in which the last values count most.
#[derive(Clone, Copy, Debug, Default)]
struct Mean {
    value: f64,
    count: u64,
}

impl Mean {
    fn add(&mut self, value: f64) {
        self.count += 1;
        self.value += (value - self.value) * WEIGHT.max(1.0 / self.count as f64);
    }
}

/// What has been measured.
#[derive(Debug, Default)]
pub(super) struct Measured {
    report_s: Mean,
    question_s: Mean,
    result_s: Mean,
    frame_s: Mean,
    rendering_s: Mean,
    link: Link,
}

/// Bytes of scenes that went out, and the time in which they did.
#[derive(Debug, Default)]
struct Link {
    bytes: f64,
    busy_s: f64,
    last: Option<Instant>,
}

impl Measured {
    /// Takes note of the time of a thread that an answer took, if it is one that each report or each unit gets.
    pub fn answered(&mut self, answer: &Answer, seconds: f64) {
        match answer {
            Answer::Reported(_) => self.report_s.add(seconds),
            Answer::Granted(Granted::Unit(_)) => self.question_s.add(seconds),
            Answer::Result(ResultReply::Kept) => self.result_s.add(seconds),
            _ => {}
        }
    }

    /// Takes note of a unit: the seconds for which its frame was locked for its sums, and those of its worker's slot.
    pub fn kept(&mut self, frame_s: f64, rendering_s: f64) {
        self.frame_s.add(frame_s);
        self.rendering_s.add(rendering_s);
    }

    /// Takes note of bytes of a scene that a worker fetches.
    pub fn sent(&mut self, bytes: usize, now: Instant) {
        let Link { bytes: all, busy_s, last } = &mut self.link;
        let since = last.replace(now).map(|last| now.saturating_duration_since(last));
        // The first part of a stretch says nothing: when it was asked for is not known.
        let Some(since) = since.filter(|since| *since < STRETCH) else { return };
        let kept = (-(bytes as f64) / HALF_BYTES).exp2();
        *all = *all * kept + bytes as f64;
        *busy_s = *busy_s * kept + since.as_secs_f64();
    }

    /// The time of the link that so many bytes take, if it is known.
    fn link_s(&self, bytes: u64) -> Option<f64> {
        let Link { bytes: all, busy_s, .. } = self.link;
        (all >= BELIEVED_BYTES && busy_s > 0.0).then(|| bytes as f64 * busy_s / all)
    }

    /// The number of workers that help, with so many slots each and so many frames.
    pub fn most_workers(&self, threads: f64, slots: f64, frames: usize) -> usize {
        if self.rendering_s.count < BELIEVED || self.report_s.count == 0 {
            return decisions::FIRST_WORKERS;
        }
        let load = Load {
            threads,
            worker_s: self.report_s.value / REPORT.as_secs_f64(),
            unit_s: self.question_s.value + self.result_s.value,
            frame_s: self.frame_s.value,
            frames,
            rendering_s: self.rendering_s.value,
            slots,
        };
        decisions::most_workers(&load)
    }

    /// True if a worker is to fetch a scene of so many bytes for the rest of a job, which takes `rest_s` of a slot.
    pub fn is_to_fetch(&self, bytes: u64, rest_s: f64, fetching: usize, slots: usize) -> bool {
        decisions::is_to_fetch(&Fetch { scene_s: self.link_s(bytes), fetching, rest_s, slots })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contract::ReportReply;

    #[test]
    fn few_units_say_nothing_and_costly_ones_need_few_workers() {
        let mut measured = Measured::default();
        measured.answered(&Answer::Reported(ReportReply::default()), 1e-4);
        for count in 0..100_u64 {
            measured.answered(&Answer::Result(ResultReply::Kept), 20e-3);
            measured.answered(&Answer::Result(ResultReply::Later), 5.0);
            let most = measured.most_workers(2.0, 2.0, 4);
            assert_eq!(most, if count < BELIEVED { decisions::FIRST_WORKERS } else { 50 });
            measured.kept(1e-4, 1.0);
        }
    }

    #[test]
    fn the_link_is_measured_while_it_is_busy() {
        let (mut measured, mut now) = (Measured::default(), Instant::now());
        for part in 0..200 {
            // A pause in which no one fetches.
            now += Duration::from_millis(if part % 50 == 0 { 60_000 } else { 5 });
            measured.sent(512 << 10, now);
        }
        let seconds = measured.link_s(50 << 20).expect("enough");
        assert!((seconds / 0.5 - 1.0).abs() < 0.05, "{seconds}");
        assert!(Measured::default().link_s(1).is_none());
    }
}
