//! Which machines help, and which stand by.

use super::clock::{Time, seconds};
use super::costs::Costs;
use super::machine::Slot;
use super::simulator::Simulator;
use crate::contract::{BEATS, REPORT};
use crate::coordinator::decisions::{self, Load, OPEN_FRAMES, PLANNER_PAUSE};

/// Units that are simulated before their costs are believed.
const BELIEVED: u64 = 32;

/// The least share of the coordinator's threads that is left beside reports of workers.
const LEAST_LEFT: f64 = 0.02;

/// What is known of machines that stand by.
#[derive(Debug, Default)]
pub(super) struct Standby {
    /// The number of the last machine that helps, if others do not.
    last: Option<u32>,
    /// Slots of the machines that help.
    pub slots: usize,
    /// When it is decided again.
    due: Time,
    /// Seconds of the coordinator's threads that reports have taken until now, those in a second, and since when.
    pub reports_s: f64,
    each_second: f64,
    since: Time,
}

impl Standby {
    fn report(&mut self, now: Time) {
        self.reports_s += seconds(now - self.since) * self.each_second;
        self.since = now;
    }
}

/// The part of the coordinator's threads that reports leave.
fn left(costs: &Costs, reports: f64) -> f64 {
    (costs.coordinator_threads - reports).max(LEAST_LEFT * costs.coordinator_threads)
}

impl Simulator<'_> {
    /// True if a slot's machine does not help now.
    #[inline]
    pub fn stands_by(&self, slot: Slot) -> bool {
        self.standby.last.is_some_and(|last| slot.machine > last)
    }

    /// Decides from time to time which machines help: the first ones that are there.
    pub fn invite(&mut self) {
        let now = self.clock.now();
        if now < self.standby.due {
            return;
        }
        self.standby.due = now + PLANNER_PAUSE.as_nanos() as Time;
        let there = self.slots / self.costs.slots as usize;
        let count = self.most_machines().min(there);
        let others = there - count;
        self.standby.last = if others > 0 { self.last_of(count) } else { None };
        self.standby.slots = count * self.costs.slots as usize;
        let rarely = self.costs.lease_s / f64::from(BEATS);
        let reports = count as f64 / REPORT.as_secs_f64().min(rarely) + others as f64 / rarely;
        self.standby.report(now);
        let each_second = reports * self.costs.question_s;
        if each_second != self.standby.each_second {
            self.standby.each_second = each_second;
            let left = left(self.costs, each_second);
            self.threads.set_capacity(now, left, left.min(1.0));
            self.expect_threads();
        }
    }

    /// The last of the first `count` machines that are there.
    fn last_of(&self, count: usize) -> Option<u32> {
        let last = count.checked_sub(1)?;
        if self.slots == self.machines.len() * self.costs.slots as usize {
            return Some(last as u32);
        }
        (0..self.farm.machines).filter(|machine| self.machines[*machine as usize].is_there()).nth(last)
    }

    /// The number of machines that help.
    fn most_machines(&self) -> usize {
        let units = self.counts.units as f64;
        if self.counts.units < BELIEVED {
            return decisions::FIRST_WORKERS;
        }
        let open: usize = self.jobs.iter().map(|run| run.frames.len()).sum();
        let more = self.jobs.iter().any(|run| run.next_frame < run.job.frames || run.more_frames > 0);
        decisions::most_workers(&Load {
            threads: self.costs.coordinator_threads,
            worker_s: self.costs.question_s / REPORT.as_secs_f64(),
            unit_s: self.counts.keep_s / units + self.costs.question_s,
            frame_s: self.counts.lock_s / units,
            frames: if more { OPEN_FRAMES } else { open.max(1) },
            rendering_s: self.counts.rendering_s / units,
            slots: f64::from(self.costs.slots),
        })
    }

    /// Ends the count of reports.
    pub fn end_reports(&mut self) {
        self.standby.report(self.clock.now());
    }
}
