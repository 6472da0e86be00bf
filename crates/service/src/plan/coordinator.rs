//! What the coordinator does when it is asked.

use super::clock::{Time, seconds, time};
use super::machine::Slot;
use super::planner::Task;
use super::simulator::{Begun, Event, Simulator};
use crate::coordinator::decisions::{self, Asked, Holding, MOST_ATTEMPTS, MOST_FILES, Taking};
use std::fmt::Write as _;
use std::time::Duration;
use xxhash_rust::xxh3::xxh3_64;

/// What a worker asks.
#[derive(Clone, Copy, Debug)]
pub(super) enum Question {
    /// Whether to render a unit.
    Start(u32, Slot),
    /// To keep its sums, which took so long.
    Result(u32, Slot, Time),
}

impl Question {
    pub fn unit(self) -> u32 {
        match self {
            Self::Start(unit, _) | Self::Result(unit, ..) => unit,
        }
    }
}

/// What a thread of the coordinator does.
#[derive(Clone, Copy, Debug)]
pub(super) enum Work {
    /// It answers a question that changes nothing on the disk.
    Answer(Question),
    /// It checks sums, writes them and adds them up.
    Keep(Question),
    /// It writes all sums of the frame into one file.
    Fold(Question),
    /// It sends a scene.
    Scene(Slot, u32),
    /// It does what is no unit.
    Task(Task),
}

/// What a transaction is for.
#[derive(Clone, Copy, Debug)]
pub(super) enum Commit {
    /// Units have been cut.
    Units,
    /// The sums of a unit are kept.
    Keep(Question),
    /// The sums of a frame are in one file.
    Fold(Question),
}

impl Simulator<'_> {
    pub fn arrives(&mut self, question: Question) {
        if let Some(question) = self.answering.come(question) {
            self.attend(question);
        }
    }

    #[inline]
    fn attend(&mut self, question: Question) {
        let unit = self.flights[question.unit() as usize];
        let parts = self.parts_of(question.unit());
        let frame = self.jobs[unit.job as usize].frames.get_mut(unit.frame);
        match (question, frame) {
            (Question::Result(..), Some(frame)) if unit.compared.is_none() => {
                if let Some(question) = frame.lock.come(question) {
                    self.keep(question);
                }
            }
            (Question::Result(..), _) => {
                self.in_thread(parts * self.costs.question_s, Work::Answer(question))
            }
            (Question::Start(..), _) => self.in_thread(self.costs.question_s, Work::Answer(question)),
        }
    }

    /// Keeps the sums of a unit, whose frame no other thread changes now.
    #[inline]
    fn keep(&mut self, question: Question) {
        let (unit, now) = (question.unit(), self.clock.now());
        let flight = self.flights[unit as usize];
        if let Some(frame) = self.jobs[flight.job as usize].frames.get_mut(flight.frame) {
            frame.locked = now;
        }
        let parts = self.parts_of(unit) * self.costs.question_s;
        let taken = parts + self.costs.keep_s + self.bytes_of(unit) * self.costs.keep_byte_s;
        self.counts.keep_s += taken;
        self.in_thread(taken, Work::Keep(question));
    }

    pub fn worked(&mut self, work: Work) {
        match work {
            Work::Answer(Question::Start(unit, slot)) => {
                let begun = self.begin(unit, slot);
                self.answer_next();
                self.clock.after(0.5 * self.costs.round_trip_s, Event::Answered(unit, slot, begun));
            }
            Work::Answer(Question::Result(unit, slot, _)) => {
                self.compare(unit);
                self.answer_next();
                self.clock.after(1.5 * self.costs.round_trip_s, Event::Done(unit, slot));
                self.wake();
            }
            Work::Keep(question) if self.flights[question.unit() as usize].is_done => self.release(question),
            Work::Keep(question) => self.commit(Commit::Keep(question)),
            Work::Fold(question) => self.commit(Commit::Fold(question)),
            Work::Scene(slot, job) => {
                let trips = self.scene_parts() * self.costs.round_trip_s;
                self.clock.after(trips, Event::Fetched(slot, job));
            }
            Work::Task(task) => self.task_ends(task),
        }
    }

    /// Whether a slot renders a unit that it has leased.
    fn begin(&mut self, unit: u32, slot: Slot) -> Begun {
        let flight = self.flights[unit as usize];
        if flight.deliveries > 1 {
            self.counts.redeliveries += 1;
        }
        if flight.is_done {
            return Begun::Skip;
        }
        let holding = flight.holder.map(|holder| Holding {
            is_asker: holder == slot,
            silent: Duration::from_nanos(self.silent(holder)),
            held: Duration::from_nanos(self.clock.now() - flight.began),
        });
        let is_own = flight.compared == Some(slot);
        let asked = Asked { holdings: holding.as_slice(), is_own, has_failed: false };
        let lease = Duration::from_nanos(time(self.costs.lease_s));
        match decisions::taking(&asked, lease / 2, lease) {
            Taking::No if is_own && self.slots <= self.costs.slots as usize => {
                self.compare(unit);
                self.wake();
                Begun::Skip
            }
            Taking::No | Taking::Spare => Begun::Wait,
            taking => {
                let is_lost = taking == Taking::Lost;
                let flight = &mut self.flights[unit as usize];
                flight.holder = Some(slot);
                flight.losses += u32::from(is_lost && flight.compared.is_none());
                if flight.losses >= MOST_ATTEMPTS {
                    let told = format!("a unit has failed {MOST_ATTEMPTS} times: machines fail too often");
                    self.failed = Some(told);
                }
                Begun::Go
            }
        }
    }

    /// A second rendering has ended, or is not wanted any more.
    fn compare(&mut self, unit: u32) {
        let flight = &mut self.flights[unit as usize];
        if flight.is_done || flight.compared.is_none() {
            return;
        }
        flight.is_done = true;
        self.outstanding -= 1;
        let (job, frame) = (flight.job, flight.frame);
        if let Some(frame) = self.jobs[job as usize].frames.get_mut(frame) {
            frame.compared -= 1;
        }
    }

    #[inline]
    pub fn commit(&mut self, commit: Commit) {
        if let Some(commit) = self.ledger.come(commit) {
            self.clock.after(self.costs.commit_s, Event::Committed(commit));
        }
    }

    pub fn committed(&mut self, commit: Commit) {
        self.counts.ledger_s += self.costs.commit_s;
        if let Some(next) = self.ledger.go() {
            self.clock.after(self.costs.commit_s, Event::Committed(next));
        }
        match commit {
            Commit::Units => self.make_offers(),
            Commit::Keep(question) => self.kept(question),
            Commit::Fold(question) => self.release(question),
        }
    }

    /// The sums of a unit are on the disk and in the ledger.
    fn kept(&mut self, question: Question) {
        let Question::Result(unit, slot, taken) = question else { return };
        let bytes = self.bytes_of(unit) as u64;
        let flight = &mut self.flights[unit as usize];
        flight.is_done = true;
        let flight = *flight;
        self.outstanding -= 1;
        self.kept_at = self.clock.now();
        self.counts.units += 1;
        self.counts.unit_s += seconds(taken);
        let run = &mut self.jobs[flight.job as usize];
        run.speed.add(flight.samples, seconds(taken));
        run.kept += flight.samples as f64;
        let all = (run.pixels_of_block * run.pass.blocks().len() as f64 * self.costs.pixel_bytes) as u64;
        let Some(frame) = run.frames.get_mut(flight.frame) else { return };
        frame.units.keep(flight.number);
        frame.samples_left -= flight.samples;
        frame.files += 1;
        frame.bytes += bytes;
        let is_complete = frame.samples_left == 0;
        let is_folded = !is_complete
            && decisions::is_to_be_folded(frame.files, MOST_FILES, frame.bytes, frame.sums_bytes);
        if is_folded {
            (frame.files, frame.bytes, frame.sums_bytes) = (0, 0, all);
        }
        self.compare_later(unit, slot);
        if is_folded {
            self.in_thread(all as f64 * self.costs.keep_byte_s, Work::Fold(question));
        } else {
            self.release(question);
        }
    }

    /// Lets a second worker render a unit, if it is one of those.
    fn compare_later(&mut self, unit: u32, slot: Slot) {
        let flight = self.flights[unit as usize];
        let run = &mut self.jobs[flight.job as usize];
        if self.farm.compared <= 0.0 || self.slots <= self.costs.slots as usize {
            return;
        }
        self.name.clear();
        // A string takes all that is written to it.
        let _ = write!(self.name, "{}.{}.{}", run.seq, flight.frame, flight.number);
        let drawn = xxh3_64(self.name.as_bytes()) as f64 / u64::MAX as f64;
        if let Some(frame) = run.frames.get_mut(flight.frame)
            && decisions::is_compared(drawn, self.farm.compared, decisions::FIRST_COMPARED)
        {
            frame.compared += 1;
            let (compared, holder) = (Some(slot), None);
            let second = super::simulator::Flight {
                compared,
                holder,
                deliveries: 0,
                losses: 0,
                is_done: false,
                ..flight
            };
            self.comparisons.push_back(self.flights.len() as u32);
            self.flights.push(second);
        }
    }

    /// The frame of a result is free for the next one, and the worker is answered.
    #[inline]
    fn release(&mut self, question: Question) {
        let Question::Result(unit, slot, _) = question else { return };
        let (flight, now) = (self.flights[unit as usize], self.clock.now());
        let mut next = None;
        if let Some(frame) = self.jobs[flight.job as usize].frames.get_mut(flight.frame) {
            self.counts.lock_s += seconds(now - frame.locked);
            next = frame.lock.go();
        }
        if let Some(next) = next {
            self.keep(next);
        }
        self.answer_next();
        // The answer, then the end of the lease.
        self.clock.after(1.5 * self.costs.round_trip_s, Event::Done(unit, slot));
        self.wake();
    }

    #[inline]
    fn answer_next(&mut self) {
        if let Some(next) = self.answering.go() {
            self.attend(next);
        }
    }
}
