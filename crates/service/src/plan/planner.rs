//! The coordinator's planner, and the threads that plan jobs and open and finish frames.

use super::clock::{Time, seconds};
use super::coordinator::{Commit, Question, Work};
use super::shared::Turns;
use super::simulator::{Event, Flight, Run, Simulator};
use crate::coordinator::decisions::{self, BLOCK_PIXELS, PLANNER_PAUSE, PassUnits, Sizes};
use raystream::schedule::Priority;

/// What the coordinator does for a job besides units.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Task {
    Plan(u32),
    Open(u32, u32),
    Finish(u32, u32),
}

/// A frame that is worked on.
#[derive(Debug)]
pub(super) struct OpenFrame {
    pub number: u32,
    /// True if nothing of it is left to be cut into units.
    is_cut: bool,
    pub units: PassUnits,
    pub samples_left: u64,
    /// Second renderings that have not come back.
    pub compared: u32,
    pub is_finishing: bool,
    /// Files of units and their bytes; those of the file of sums.
    pub files: usize,
    pub bytes: u64,
    pub sums_bytes: u64,
    /// One result after another.
    pub lock: Turns<Question>,
    /// Since when the frame is locked, and since when it is open.
    pub locked: Time,
    opened: Time,
}

/// The frames of a job that are worked on, in the order of their numbers: at most [`decisions::OPEN_FRAMES`].
#[derive(Debug, Default)]
pub(super) struct OpenFrames(Vec<OpenFrame>);

impl OpenFrames {
    pub fn len(&self) -> usize {
        self.0.len()
    }

    #[inline]
    fn place(&self, number: u32) -> Result<usize, usize> {
        self.0.binary_search_by_key(&number, |frame| frame.number)
    }

    #[inline]
    pub fn get_mut(&mut self, number: u32) -> Option<&mut OpenFrame> {
        self.place(number).ok().map(|place| &mut self.0[place])
    }

    fn insert(&mut self, frame: OpenFrame) {
        let (Ok(place) | Err(place)) = self.place(frame.number);
        self.0.insert(place, frame);
    }

    fn remove(&mut self, number: u32) -> Option<OpenFrame> {
        self.place(number).ok().map(|place| self.0.remove(place))
    }
}

/// The planner.
#[derive(Debug, Default)]
pub(super) struct Planner {
    is_looking: bool,
    is_woken: bool,
    /// Counts looks, so that a pause that was cut short does not end.
    looks: u32,
    began: Time,
    is_short: bool,
    /// Units that it is about to offer.
    offers: Vec<u32>,
}

impl Simulator<'_> {
    /// Tells the planner that there may be something to do.
    pub fn wake(&mut self) {
        if self.planner.is_looking { self.planner.is_woken = true } else { self.look() }
    }

    pub fn tick(&mut self, looks: u32) {
        if looks == self.planner.looks && !self.planner.is_looking {
            self.look();
        }
    }

    fn look(&mut self) {
        self.invite();
        self.planner.is_looking = true;
        self.planner.is_woken = false;
        self.planner.looks += 1;
        self.planner.began = self.clock.now();
        self.clock.after(self.costs.look_s, Event::Looked);
    }

    pub fn looked(&mut self) {
        for job in 0..self.jobs.len() as u32 {
            self.give_tasks(job);
        }
        let is_new = self.choose_units();
        if is_new {
            self.commit(Commit::Units);
        } else {
            self.make_offers();
        }
    }

    /// Gives the threads what is to be done for a job besides units.
    fn give_tasks(&mut self, job: u32) {
        let run = &mut self.jobs[job as usize];
        if run.ended.is_some() {
            return;
        }
        if !run.is_planned {
            if !std::mem::replace(&mut run.is_planning, true) {
                self.give(Task::Plan(job));
            }
            return;
        }
        let is_ready =
            |frame: &OpenFrame| frame.samples_left == 0 && frame.compared == 0 && !frame.is_finishing;
        let complete: Vec<u32> =
            run.frames.0.iter().filter(|frame| is_ready(frame)).map(|frame| frame.number).collect();
        let open = run.frames.len();
        for number in complete {
            if let Some(frame) = self.jobs[job as usize].frames.get_mut(number) {
                frame.is_finishing = true;
            }
            self.give(Task::Finish(job, number));
        }
        let all: usize = self.jobs.iter().map(|run| run.frames.len() + run.opening.len()).sum();
        let run = &mut self.jobs[job as usize];
        let is_left = run.next_frame < run.job.frames;
        if is_left && decisions::wants_frame(open, run.opening.len(), all, self.planner.is_short) {
            let number = run.next_frame;
            run.next_frame += 1;
            run.opening.push(number);
            self.give(Task::Open(job, number));
        }
    }

    fn give(&mut self, task: Task) {
        let next = match task {
            Task::Finish(..) => self.tasks.come_first(task),
            _ => self.tasks.come(task),
        };
        if let Some(task) = next {
            self.perform(task);
        }
    }

    fn perform(&mut self, task: Task) {
        let taken = match task {
            Task::Plan(_) => self.costs.plan_s,
            Task::Open(..) => self.costs.open_s,
            Task::Finish(..) => self.costs.finish_s,
        };
        self.counts.tasks_s += taken;
        self.in_thread(taken, Work::Task(task));
    }

    pub fn task_ends(&mut self, task: Task) {
        let now = self.clock.now();
        match task {
            Task::Plan(job) => self.jobs[job as usize].is_planned = true,
            Task::Open(job, number) => {
                let run = &mut self.jobs[job as usize];
                run.opening.retain(|other| *other != number);
                let samples = BLOCK_PIXELS as u64 * run.pass.blocks().len() as u64 * u64::from(run.job.spp);
                let frame = OpenFrame {
                    number,
                    is_cut: false,
                    units: PassUnits::new(0, run.pass.clone()),
                    samples_left: samples,
                    compared: 0,
                    is_finishing: false,
                    files: 0,
                    bytes: 0,
                    sums_bytes: 0,
                    lock: Turns::new(1),
                    locked: now,
                    opened: now,
                };
                run.frames.insert(frame);
            }
            Task::Finish(job, number) => {
                let run = &mut self.jobs[job as usize];
                if let Some(frame) = run.frames.remove(number) {
                    self.counts.open_s += seconds(now - frame.opened);
                }
                run.finished += 1;
                if run.finished == run.job.frames {
                    run.ended = Some(now);
                }
            }
        }
        if let Some(next) = self.tasks.go() {
            self.perform(next);
        }
        self.wake();
    }

    /// Chooses units until enough are outstanding. Whether some of them have just been cut.
    fn choose_units(&mut self) -> bool {
        let wanted = decisions::wanted(self.standby.slots);
        let open = self.jobs.iter().map(|run| run.frames.len()).sum();
        let more = self.jobs.iter().any(|run| run.next_frame < run.job.frames);
        let sizes = Sizes { at_once: decisions::at_once(self.standby.slots, open, more), ..Sizes::default() };
        let mut runs: Vec<&mut Run> = self.jobs.iter_mut().filter(|run| run.frames.len() > 0).collect();
        let mut is_new = false;
        while self.outstanding < wanted {
            let unit = match self.comparisons.pop_front() {
                Some(unit) => unit,
                None => {
                    let Some((flight, is_cut)) = next_unit(&mut runs, sizes) else { break };
                    is_new |= is_cut;
                    self.flights.push(flight);
                    self.flights.len() as u32 - 1
                }
            };
            self.outstanding += 1;
            self.planner.offers.push(unit);
        }
        self.planner.is_short = self.outstanding < wanted;
        is_new
    }

    /// Offers the chosen units, one after another.
    pub fn make_offers(&mut self) {
        let offers = std::mem::take(&mut self.planner.offers);
        for (unit, number) in offers.iter().zip(1..) {
            self.clock.after(f64::from(number) * self.costs.offer_s, Event::Offered(*unit));
        }
        self.clock.after(offers.len() as f64 * self.costs.offer_s, Event::LookEnds);
    }

    /// Workers may have a unit.
    pub fn offered(&mut self, unit: u32) {
        let flight = &self.flights[unit as usize];
        self.for_all += usize::from(flight.is_for_all());
        self.lanes[usize::from(!flight.is_urgent)].push_back(unit);
        self.deliver();
    }

    pub fn look_ends(&mut self) {
        let now = self.clock.now();
        self.counts.planner_s += seconds(now - self.planner.began);
        self.planner.is_looking = false;
        if self.planner.is_woken {
            self.look();
        } else {
            self.clock.after(PLANNER_PAUSE.as_secs_f64(), Event::Tick(self.planner.looks));
        }
    }
}

/// Cuts the next unit, or takes one that has been cut, which the flag tells.
fn next_unit(runs: &mut [&mut Run], sizes: Sizes) -> Option<(Flight, bool)> {
    decisions::next(runs, |run| {
        let (job, speed) = (run.seq as u32, run.speed);
        let is_urgent = run.job.priority == Priority::Interactive;
        run.frames.0.iter_mut().filter(|frame| !frame.is_cut).find_map(|frame| {
            let taken = frame.units.take(frame.number, sizes, speed);
            frame.is_cut = taken.is_none();
            let (row, is_cut) = taken?;
            let samples = row.samples();
            let flight = Flight {
                job,
                frame: frame.number,
                number: row.number,
                blocks: row.blocks,
                samples,
                is_urgent,
                compared: None,
                deliveries: 0,
                holder: None,
                losses: 0,
                is_done: false,
                leased: 0,
                began: 0,
                rendering: 0,
            };
            Some(((flight, is_cut), samples))
        })
    })
}
