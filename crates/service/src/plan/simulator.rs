//! The state of the simulated farm, and what happens in it.

use super::clock::{Clock, Time, seconds, time};
use super::coordinator::{Commit, Question, Work};
use super::costs::{Costs, Farm, FramesJob};
use super::machine::{Machine, Slot, Task as MachineTask};
use super::planner::{OpenFrames, Planner, Task};
use super::prediction::{Load, Prediction};
use super::shared::{Shared, Turns};
use super::standby::Standby;
use crate::contract::ANSWERED_TOGETHER;
use crate::coordinator::decisions::{BLOCK_PIXELS, Candidate, Share, Speed, TASK_THREADS};
use raystream::render::{Blocks, Pass};
use std::collections::VecDeque;

/// A farm on which no unit ends for so many seconds does nothing.
const HOPELESS_S: f64 = 3600.0;

/// What happens.
#[derive(Clone, Copy, Debug)]
pub(super) enum Event {
    /// A machine asks for units.
    Joins(Slot),
    /// A machine fails.
    Fails(Slot),
    /// The planner's pause is over.
    Tick(u32),
    /// The planner has looked.
    Looked,
    /// Workers may have a unit.
    Offered(u32),
    /// The planner has made all offers.
    LookEnds,
    /// A slot's request for a unit reaches the coordinator.
    Asks(Slot),
    /// A unit is chosen for a slot.
    Delivered(u32, Slot),
    /// A question reaches the coordinator.
    Arrives(Question),
    /// The answer to whether a slot renders a unit.
    Answered(u32, Slot, Begun),
    /// A machine has fetched the scene of a job.
    Fetched(Slot, u32),
    /// A unit's lease is over, because its sums are kept or no one wants it.
    Done(u32, Slot),
    /// A unit may be leased again.
    Redelivered(u32),
    /// Something on a machine ends.
    Machine(u32),
    /// A transfer to the coordinator ends.
    Incoming,
    /// A transfer from the coordinator ends.
    Outgoing,
    /// Something in a thread of the coordinator ends.
    Threads,
    /// A transaction ends.
    Committed(Commit),
}

/// The places of [`Clock`]: the links and the threads of the coordinator, then the machines.
const INCOMING: u32 = 0;
const OUTGOING: u32 = 1;
const THREADS: u32 = 2;
const MACHINES: u32 = 3;

impl Event {
    fn of_place(place: u32) -> Self {
        match place {
            INCOMING => Self::Incoming,
            OUTGOING => Self::Outgoing,
            THREADS => Self::Threads,
            _ => Self::Machine(place - MACHINES),
        }
    }
}

/// Whether a slot renders a unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Begun {
    Go,
    Wait,
    Skip,
}

/// A unit that has been offered.
#[derive(Clone, Copy, Debug)]
pub(super) struct Flight {
    pub job: u32,
    pub frame: u32,
    pub number: u32,
    pub blocks: u32,
    /// Pixels × samples.
    pub samples: u64,
    pub is_urgent: bool,
    /// The machine whose sums a second rendering is compared with.
    pub compared: Option<Slot>,
    pub deliveries: u64,
    pub holder: Option<Slot>,
    pub losses: u32,
    pub is_done: bool,
    /// The times at which it was leased, and at which its worker was told to render it.
    pub leased: Time,
    pub began: Time,
    /// The time at which its scene was there.
    pub rendering: Time,
}

impl Flight {
    /// True if a machine may have it which would have its scene too late: one of those that have it is not enough.
    pub fn is_for_all(&self) -> bool {
        self.compared.is_some() || self.losses > 0
    }
}

/// Machines and the scene of a job.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Having {
    /// Those that fetch or read it.
    pub fetching: usize,
    /// Those that have it.
    pub has: usize,
}

/// A job that is worked on.
pub(super) struct Run {
    pub job: FramesJob,
    pub seq: i64,
    pub pass: Pass,
    /// Samples of a pixel of a block that are of the picture: blocks at its edge have fewer pixels.
    pub pixels_of_block: f64,
    pub given: u64,
    pub kept: f64,
    /// The machines that have its scene, or will.
    pub having: Having,
    /// Frames after those that are simulated.
    pub more_frames: u32,
    pub speed: Speed,
    pub is_planned: bool,
    /// True if it is being planned.
    pub is_planning: bool,
    pub next_frame: u32,
    pub opening: Vec<u32>,
    pub frames: OpenFrames,
    pub finished: u32,
    pub ended: Option<Time>,
}

impl Run {
    /// Seconds of a slot that the rest of it takes.
    pub fn rest_s(&self) -> f64 {
        let pixels = f64::from(self.job.size.0) * f64::from(self.job.size.1);
        let frames = f64::from(self.job.frames + self.more_frames);
        (pixels * f64::from(self.job.spp) * frames - self.kept).max(0.0) / self.speed.samples_per_second()
    }
}

impl Share for &mut Run {
    fn candidate(&self) -> Candidate {
        Candidate { priority: self.job.priority, given: self.given, seq: self.seq }
    }

    fn give(&mut self, samples: u64) {
        self.given += samples;
    }
}

/// What is counted.
#[derive(Debug, Default)]
pub(super) struct Counts {
    pub units: u64,
    pub redeliveries: u64,
    pub bytes: f64,
    pub ledger_s: f64,
    pub planner_s: f64,
    pub tasks_s: f64,
    pub lock_s: f64,
    pub open_s: f64,
    pub unit_s: f64,
    /// Time of slots that units have taken without their scenes, and of the coordinator's threads for their sums.
    pub rendering_s: f64,
    pub keep_s: f64,
    pub first: Option<Time>,
}

/// The farm.
pub(super) struct Simulator<'a> {
    pub farm: &'a Farm,
    pub costs: &'a Costs,
    pub clock: Clock<Event>,
    pub machines: Vec<Machine>,
    /// Slots of the machines that are there.
    pub slots: usize,
    pub standby: Standby,
    pub jobs: Vec<Run>,
    pub flights: Vec<Flight>,
    pub outstanding: usize,
    pub comparisons: VecDeque<u32>,
    /// The name of the unit for which a number is drawn: memory that is used again.
    pub name: String,
    /// Units that workers may have: urgent ones, others.
    pub lanes: [VecDeque<u32>; 2],
    /// Units among them that a machine may have which would have their scenes too late.
    pub for_all: usize,
    /// Slots that wait for a unit.
    pub waiting: VecDeque<Slot>,
    pub incoming: Shared<Question>,
    pub outgoing: Shared<(Slot, u32)>,
    pub threads: Shared<Work>,
    pub answering: Turns<Question>,
    pub ledger: Turns<Commit>,
    pub tasks: Turns<Task>,
    pub planner: Planner,
    pub counts: Counts,
    pub failed: Option<String>,
    /// The time at which the last unit was kept.
    pub kept_at: Time,
}

impl<'a> Simulator<'a> {
    /// With `more_frames` of each job after those that are simulated.
    pub fn new(farm: &'a Farm, costs: &'a Costs, jobs: &[FramesJob], more_frames: u32) -> Self {
        let bytes = farm.network_bits / 8.0;
        let threads = costs.coordinator_threads;
        let runs = jobs.iter().zip(0..).map(|(job, seq)| Run {
            job: job.clone(),
            seq,
            pass: Pass::new(Blocks::new(job.size.0, job.size.1).in_order(), 0..job.spp),
            pixels_of_block: {
                let pixels = f64::from(job.size.0) * f64::from(job.size.1);
                pixels / Blocks::new(job.size.0, job.size.1).count() as f64
            },
            given: 0,
            kept: 0.0,
            having: Having::default(),
            more_frames,
            speed: Speed::default(),
            is_planned: false,
            is_planning: false,
            next_frame: 0,
            opening: Vec::new(),
            frames: OpenFrames::default(),
            finished: 0,
            ended: None,
        });
        Self {
            farm,
            costs,
            clock: Clock::new(Event::of_place),
            machines: (0..farm.machines).map(|_| Machine::new(jobs.len())).collect(),
            slots: 0,
            standby: Standby::default(),
            jobs: runs.collect(),
            flights: Vec::new(),
            outstanding: 0,
            comparisons: VecDeque::new(),
            name: String::new(),
            lanes: Default::default(),
            for_all: 0,
            waiting: VecDeque::new(),
            incoming: Shared::new(bytes, bytes),
            outgoing: Shared::new(bytes, bytes),
            threads: Shared::new(threads, threads.min(1.0)),
            answering: Turns::new(ANSWERED_TOGETHER),
            ledger: Turns::new(1),
            tasks: Turns::new(TASK_THREADS),
            planner: Planner::default(),
            counts: Counts::default(),
            failed: None,
            kept_at: 0,
        }
    }

    /// Lets the jobs be done.
    pub fn run(self) -> Prediction {
        self.run_noting(&[]).0
    }

    /// Lets the jobs be done, and notes what has been done when so many frames of the first job were.
    pub fn run_noting(mut self, marks: &[u32]) -> (Prediction, Vec<Prediction>) {
        let mut notes = Vec::new();
        let hopeless = time(HOPELESS_S + self.costs.startup_s);
        for machine in 0..self.farm.machines {
            self.start_machine(machine);
        }
        self.wake();
        while self.failed.is_none() && self.jobs.iter().any(|job| job.ended.is_none()) {
            let Some(event) = self.clock.next() else {
                self.failed = Some("nothing is left to happen".into());
                break;
            };
            self.happens(event);
            if marks.get(notes.len()).is_some_and(|mark| self.jobs[0].finished >= *mark) {
                notes.push(self.predicted());
            }
            if self.farm.failure_s.is_some() && self.clock.now() - self.kept_at > hopeless {
                self.failed = Some("no unit has ended for an hour: machines fail too often".into());
            }
        }
        (self.predicted(), notes)
    }

    fn happens(&mut self, event: Event) {
        match event {
            Event::Joins(slot) => self.joins(slot),
            Event::Fails(slot) => self.fails(slot),
            Event::Tick(version) => self.tick(version),
            Event::Looked => self.looked(),
            Event::Offered(unit) => self.offered(unit),
            Event::LookEnds => self.look_ends(),
            Event::Asks(slot) => self.asks(slot),
            Event::Delivered(unit, slot) => {
                if self.is_there(slot) {
                    self.clock.after(0.0, Event::Arrives(Question::Start(unit, slot)));
                }
            }
            Event::Arrives(question) => self.arrives(question),
            Event::Answered(unit, slot, begun) => self.answered(unit, slot, begun),
            Event::Fetched(slot, job) => self.fetched(slot, job),
            Event::Done(unit, slot) => self.done(unit, slot),
            Event::Redelivered(unit) => self.redelivered(unit),
            Event::Machine(machine) => self.machine_ends(machine),
            Event::Incoming => {
                if let Some(question) = self.incoming.end(self.clock.now()) {
                    self.expect_incoming();
                    self.sent(question);
                }
            }
            Event::Outgoing => {
                if let Some((slot, job)) = self.outgoing.end(self.clock.now()) {
                    self.expect_outgoing();
                    self.in_thread(self.scene_parts() * self.costs.question_s, Work::Scene(slot, job));
                }
            }
            Event::Threads => {
                if let Some(work) = self.threads.end(self.clock.now()) {
                    self.expect_threads();
                    self.worked(work);
                }
            }
            Event::Committed(commit) => self.committed(commit),
        }
    }

    /// Bytes of the sums of a unit.
    #[inline]
    pub fn bytes_of(&self, unit: u32) -> f64 {
        let Flight { job, blocks, .. } = self.flights[unit as usize];
        f64::from(blocks) * self.jobs[job as usize].pixels_of_block * self.costs.pixel_bytes
    }

    /// Time of a machine that a unit takes.
    #[inline]
    pub fn work_of(&self, unit: u32) -> f64 {
        let Flight { job, samples, .. } = self.flights[unit as usize];
        let share = self.jobs[job as usize].pixels_of_block / BLOCK_PIXELS;
        samples as f64 * share / self.costs.samples_per_second + self.costs.unit_s
    }

    /// Ends the next transfer to the coordinator when it is due.
    #[inline]
    pub fn expect_incoming(&mut self) {
        self.clock.expect(INCOMING, self.incoming.due());
    }

    pub fn expect_outgoing(&mut self) {
        self.clock.expect(OUTGOING, self.outgoing.due());
    }

    #[inline]
    pub fn expect_threads(&mut self) {
        self.clock.expect(THREADS, self.threads.due());
    }

    /// Lets a thread of the coordinator work for so many seconds.
    #[inline]
    pub fn in_thread(&mut self, seconds: f64, work: Work) {
        self.threads.add(self.clock.now(), seconds, work);
        self.expect_threads();
    }

    /// Lets a machine do something.
    #[inline]
    pub fn on_machine(&mut self, machine: u32, seconds: f64, task: MachineTask) {
        self.machines[machine as usize].processor.add(self.clock.now(), seconds, task);
        self.expect_machine(machine);
    }

    /// Ends what a machine does next when it is due.
    #[inline]
    pub fn expect_machine(&mut self, machine: u32) {
        self.clock.expect(MACHINES + machine, self.machines[machine as usize].processor.due());
    }

    fn predicted(&mut self) -> Prediction {
        self.end_reports();
        let now = self.clock.now();
        let ended = self.jobs.iter().filter_map(|job| job.ended).max();
        let total = seconds(ended.unwrap_or(now)).max(1e-9);
        let machines = f64::from(self.farm.machines);
        let busy: f64 = self.machines.iter_mut().map(|machine| machine.processor.done(now)).sum();
        let bytes = self.farm.network_bits / 8.0;
        let threads = self.threads.done(now) / total + self.standby.reports_s / total;
        let counts = &self.counts;
        let loads = [
            ("machines", busy / total / machines),
            ("link to the coordinator", self.incoming.done(now) / total / bytes),
            ("link from the coordinator", self.outgoing.done(now) / total / bytes),
            ("coordinator's threads", threads / self.costs.coordinator_threads),
            ("ledger", counts.ledger_s / total),
            ("planner", counts.planner_s / total),
            ("pictures", counts.tasks_s / total / TASK_THREADS as f64),
            ("sums of a frame", counts.lock_s / counts.open_s.max(1e-9)),
        ];
        let loads = loads.into_iter().map(|(name, share)| Load { name, share }).collect();
        let names: Vec<&str> = self.jobs.iter().map(|run| &*run.job.name).collect();
        let frames: u32 = self.jobs.iter().map(|run| run.job.frames).sum();
        Prediction {
            job: names.join("+"),
            machines: self.farm.machines,
            power: machines,
            seconds: total,
            first_s: seconds(counts.first.unwrap_or(now)),
            frames_per_second: f64::from(frames) / total,
            units: counts.units,
            unit_s: counts.unit_s / counts.units.max(1) as f64,
            idle_share: 1.0 - busy / total / machines,
            bytes: counts.bytes,
            redeliveries: counts.redeliveries,
            loads,
            failed: self.failed.clone(),
        }
    }
}
