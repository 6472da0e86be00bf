//! Live views: each moving frame is divided into rows, which the coordinator and machines render at the same time.
//!
//! Who gets which rows, what becomes of a late tile and how large frames are is decided by the code of the view
//! ([`crate::live`]). One frame is under way at a time. Its size follows from the time of those before it, so more
//! machines give sharper frames first, and more frames a second once they are as sharp as can be.

use super::clock::{Clock, Time, seconds};
use super::costs::{Costs, Farm, LiveJob};
use super::prediction::{Load, Prediction};
use super::shared::Shared;
use crate::live::Resolution;
use crate::live::decisions::{self, DEADLINE, Division, Late, REST, Record, Speed};
use std::collections::VecDeque;
use std::ops::Range;
use std::time::Duration;

/// Frames that are not counted: sizes and speeds are found meanwhile.
const FIRST_FRAMES: u64 = 60;

#[derive(Clone, Copy, Debug)]
enum Event {
    /// Something in a thread of the coordinator ends.
    Threads,
    /// A tile's request reaches its machine.
    Asked(Tile),
    /// A tile on a machine is rendered.
    Machine(u32),
    /// A tile has come over the link.
    Incoming,
    /// A tile reaches the coordinator.
    Came(Tile),
    /// A machine's word reaches the coordinator that it gives a tile up.
    GivenUp(u32),
    /// The time of a frame is over.
    Deadline(u64),
}

/// The places of [`Clock`]: the threads of the coordinator, the link to it, then the machines.
const THREADS: u32 = 0;
const INCOMING: u32 = 1;
const MACHINES: u32 = 2;

impl Event {
    fn of_place(place: u32) -> Self {
        match place {
            THREADS => Self::Threads,
            INCOMING => Self::Incoming,
            _ => Self::Machine(place - MACHINES),
        }
    }
}

/// Rows of a frame on a machine.
#[derive(Clone, Copy, Debug)]
struct Tile {
    frame: u64,
    machine: u32,
    width: u32,
    rows: u32,
    asked: Time,
}

impl Tile {
    fn pixels(&self) -> f64 {
        f64::from(self.width) * f64::from(self.rows)
    }
}

/// What the thread does that looks after the view, one after another.
#[derive(Clone, Copy, Debug)]
enum Duty {
    Ask(Tile),
    Begin,
    Take(Tile),
}

#[derive(Clone, Copy, Debug)]
enum Work {
    Duty(Duty),
    /// A thread's part of the coordinator's own rows, or of those that did not come.
    Rows,
}

/// The frame under way.
#[derive(Debug)]
struct Frame {
    number: u64,
    began: Time,
    size: [u32; 2],
    own: Range<u32>,
    /// Tiles that have not come, with their rows.
    missing: Vec<(u32, Range<u32>)>,
    /// Threads that still render rows of the coordinator.
    busy: u32,
    is_own_done: bool,
    is_late: bool,
    is_filling: bool,
}

/// What a view knows of a machine.
#[derive(Clone, Debug)]
struct Member {
    record: Record,
    /// Questions without an answer.
    open: u32,
    /// When it is asked again after it was left alone.
    rests_until: Time,
}

struct View<'a> {
    costs: &'a Costs,
    job: &'a LiveJob,
    clock: Clock<Event>,
    threads: Shared<Work>,
    duties: VecDeque<Duty>,
    is_on_duty: bool,
    incoming: Shared<Tile>,
    machines: Vec<Shared<Tile>>,
    members: Vec<Member>,
    own_speed: Speed,
    resolution: Resolution,
    frame: Option<Frame>,
    shown: u64,
    /// Since the frames that count began: when, pixels, bytes, tiles, seconds of machines' work on tiles.
    since: Time,
    pixels: f64,
    bytes: f64,
    tiles: u64,
    tile_s: f64,
    late: u64,
}

/// Predicts a live view.
pub(super) fn predict(farm: &Farm, costs: &Costs, job: &LiveJob) -> Prediction {
    let mut view = View::new(farm, costs, job);
    view.begin_frame();
    while view.shown < FIRST_FRAMES
        && let Some(event) = view.clock.next()
    {
        view.happens(event);
    }
    let before = view.done();
    view.count_from_here();
    while view.shown < FIRST_FRAMES + u64::from(job.frames)
        && let Some(event) = view.clock.next()
    {
        view.happens(event);
    }
    let after = view.done();
    let total = seconds(view.clock.now() - view.since).max(1e-9);
    let machines = f64::from(farm.machines);
    let bytes = farm.network_bits / 8.0;
    let did = |place: usize, capacity: f64| (after[place] - before[place]) / total / capacity;
    let loads = [
        ("machines", did(0, machines)),
        ("link to the coordinator", did(1, bytes)),
        ("coordinator's threads", did(2, costs.coordinator_threads)),
    ];
    let whole = f64::from(job.size.0) * f64::from(job.size.1);
    let whole_frames = view.pixels / whole;
    Prediction {
        job: job.name.clone(),
        machines: farm.machines,
        power: machines + costs.coordinator_samples_per_second / costs.samples_per_second,
        seconds: f64::from(job.frames) * total / whole_frames,
        first_s: 0.0,
        frames_per_second: f64::from(job.frames) / total,
        units: view.tiles,
        unit_s: view.tile_s / view.tiles.max(1) as f64,
        idle_share: 1.0 - did(0, machines),
        bytes: view.bytes,
        redeliveries: view.late,
        loads: loads.into_iter().map(|(name, share)| Load { name, share }).collect(),
        failed: None,
    }
}

impl<'a> View<'a> {
    fn new(farm: &Farm, costs: &'a Costs, job: &'a LiveJob) -> Self {
        let (threads, bytes) = (costs.coordinator_threads, farm.network_bits / 8.0);
        let member = Member { record: Record::default(), open: 0, rests_until: 0 };
        Self {
            costs,
            job,
            clock: Clock::new(Event::of_place),
            threads: Shared::new(threads, 1_f64.min(threads)),
            duties: VecDeque::new(),
            is_on_duty: false,
            incoming: Shared::new(bytes, bytes),
            machines: (0..farm.machines).map(|_| Shared::new(1.0, 1.0)).collect(),
            members: vec![member; farm.machines as usize],
            own_speed: Speed::default(),
            resolution: Resolution::default(),
            frame: None,
            shown: 0,
            since: 0,
            pixels: 0.0,
            bytes: 0.0,
            tiles: 0,
            tile_s: 0.0,
            late: 0,
        }
    }

    /// What machines, link and threads have done.
    fn done(&mut self) -> [f64; 3] {
        let now = self.clock.now();
        let machines = self.machines.iter_mut().map(|machine| machine.done(now)).sum();
        [machines, self.incoming.done(now), self.threads.done(now)]
    }

    fn count_from_here(&mut self) {
        self.since = self.clock.now();
        (self.pixels, self.bytes, self.tile_s) = (0.0, 0.0, 0.0);
        (self.tiles, self.late) = (0, 0);
    }

    fn begin_frame(&mut self) {
        let (now, number) = (self.clock.now(), self.shown + 1);
        let size = self.resolution.size([self.job.size.0, self.job.size.1]);
        let is_free = |member: &Member| member.open == 0 && member.rests_until <= now;
        let free: Vec<u32> =
            (0..).zip(&self.members).filter(|(_, member)| is_free(member)).map(|(place, _)| place).collect();
        let speeds: Vec<Speed> =
            free.iter().map(|&place| self.members[place as usize].record.speed()).collect();
        let division = decisions::divide(size, self.own_speed, &speeds);
        let Division { own, tiles } = division.unwrap_or(Division { own: 0..size[1], tiles: Vec::new() });
        let missing: Vec<(u32, Range<u32>)> =
            tiles.into_iter().map(|(place, rows)| (free[place], rows)).collect();
        for (machine, rows) in &missing {
            self.members[*machine as usize].open += 1;
            let (width, rows) = (size[0], rows.len() as u32);
            let tile = Tile { frame: number, machine: *machine, width, rows, asked: now };
            self.duties.push_back(Duty::Ask(tile));
        }
        self.duties.push_back(Duty::Begin);
        let (busy, is_own_done, is_late, is_filling) = (0, false, false, false);
        self.frame =
            Some(Frame { number, began: now, size, own, missing, busy, is_own_done, is_late, is_filling });
        self.clock.after(DEADLINE.as_secs_f64(), Event::Deadline(number));
        self.next_duty();
    }

    /// Lets the view's thread do what is next.
    fn next_duty(&mut self) {
        if !self.is_on_duty
            && let Some(duty) = self.duties.pop_front()
        {
            self.is_on_duty = true;
            let taken = match duty {
                Duty::Ask(_) | Duty::Take(_) => 0.5 * self.costs.question_s,
                Duty::Begin => 0.0,
            };
            self.threads.add(self.clock.now(), taken, Work::Duty(duty));
            self.expect_threads();
        }
    }

    fn expect_threads(&mut self) {
        self.clock.expect(THREADS, self.threads.due());
    }

    fn expect_machine(&mut self, machine: u32) {
        self.clock.expect(MACHINES + machine, self.machines[machine as usize].due());
    }

    fn expect_incoming(&mut self) {
        self.clock.expect(INCOMING, self.incoming.due());
    }

    fn happens(&mut self, event: Event) {
        let (now, half) = (self.clock.now(), 0.5 * self.costs.round_trip_s);
        match event {
            Event::Threads => {
                let Some(work) = self.threads.end(now) else { return };
                self.expect_threads();
                match work {
                    Work::Duty(duty) => self.did(duty, half),
                    Work::Rows => self.rows_end(),
                }
            }
            Event::Asked(tile) => {
                if now >= tile.asked + DEADLINE.as_nanos() as Time {
                    return self.clock.after(half, Event::GivenUp(tile.machine));
                }
                let samples = tile.pixels() * f64::from(self.job.spp);
                let work = samples / self.costs.samples_per_second + self.costs.unit_s;
                self.machines[tile.machine as usize].add(now, work, tile);
                self.tile_s += work;
                self.expect_machine(tile.machine);
            }
            Event::Machine(machine) => {
                let Some(tile) = self.machines[machine as usize].end(now) else { return };
                self.expect_machine(machine);
                let bytes = tile.pixels() * self.job.pixel_bytes;
                self.bytes += bytes;
                self.incoming.add(now, bytes, tile);
                self.expect_incoming();
            }
            Event::Incoming => {
                let Some(tile) = self.incoming.end(now) else { return };
                self.expect_incoming();
                self.clock.after(half, Event::Came(tile));
            }
            Event::Came(tile) => {
                self.duties.push_back(Duty::Take(tile));
                self.next_duty();
            }
            Event::GivenUp(machine) => {
                let member = &mut self.members[machine as usize];
                member.open = member.open.saturating_sub(1);
            }
            Event::Deadline(number) => {
                let Some(frame) = self.frame.as_mut().filter(|frame| frame.number == number) else { return };
                frame.is_late = true;
                let late: Vec<u32> = frame.missing.iter().map(|(machine, _)| *machine).collect();
                late.into_iter().for_each(|machine| self.give_up(number, machine));
                self.advance();
            }
        }
    }

    /// The view's thread has done something.
    fn did(&mut self, duty: Duty, half: f64) {
        self.is_on_duty = false;
        match duty {
            Duty::Ask(tile) => {
                let asked = self.clock.now();
                self.clock.after(half, Event::Asked(Tile { asked, ..tile }));
            }
            Duty::Begin => {
                let of = |frame: &Frame| frame.own.len() as f64 * f64::from(frame.size[0]);
                self.render(self.frame.as_ref().map_or(0.0, of));
            }
            Duty::Take(tile) => self.take(tile),
        }
        self.next_duty();
    }

    /// Lets all threads of the coordinator render so many pixels.
    fn render(&mut self, pixels: f64) {
        let seconds = pixels * f64::from(self.job.spp) / self.costs.coordinator_samples_per_second;
        let (threads, now) = (self.costs.coordinator_threads, self.clock.now());
        let busy = threads.ceil() as u32;
        let Some(frame) = &mut self.frame else { return };
        frame.busy = busy;
        for _ in 0..busy {
            self.threads.add(now, seconds * threads / f64::from(busy), Work::Rows);
        }
        self.expect_threads();
    }

    /// A thread has rendered its part.
    fn rows_end(&mut self) {
        let now = self.clock.now();
        let Some(frame) = &mut self.frame else { return };
        frame.busy -= 1;
        if frame.busy > 0 {
            return;
        }
        if frame.is_filling {
            frame.missing.clear();
        } else {
            frame.is_own_done = true;
            self.own_speed.add(frame.own.len() as u32, frame.size[0], seconds(now - frame.began));
        }
        self.advance();
    }

    fn take(&mut self, tile: Tile) {
        let now = self.clock.now();
        let member = &mut self.members[tile.machine as usize];
        member.open = member.open.saturating_sub(1);
        let Some(frame) = self.frame.as_mut().filter(|frame| frame.number == tile.frame) else { return };
        member.record.came(tile.frame, tile.rows, frame.size[0], seconds(now - tile.asked));
        if let Some(place) = frame.missing.iter().position(|(machine, _)| *machine == tile.machine) {
            frame.missing.swap_remove(place);
            self.tiles += 1;
        }
        self.advance();
    }

    /// Shows the frame if it is whole, or renders what has not come in time.
    fn advance(&mut self) {
        let Some(frame) = &mut self.frame else { return };
        if !frame.is_own_done || frame.busy > 0 {
            return;
        }
        if frame.missing.is_empty() {
            return self.show();
        }
        if !frame.is_late || frame.is_filling {
            return;
        }
        frame.is_filling = true;
        let first = frame.missing.iter().map(|(_, rows)| rows.start).min().unwrap_or(0);
        let last = frame.missing.iter().map(|(_, rows)| rows.end).max().unwrap_or(0);
        let ([width, _], rows) = decisions::coarse(frame.size, &(first..last));
        self.render(f64::from(width) * rows.len() as f64);
    }

    /// A machine is late; it says so and renders its tiles no more.
    fn give_up(&mut self, frame: u64, machine: u32) {
        let now = self.clock.now();
        let member = &mut self.members[machine as usize];
        match member.record.late(frame) {
            Late::Known => return,
            Late::Slowed => {}
            Late::Rests => member.rests_until = now + REST.as_nanos() as Time,
        }
        self.late += 1;
        let tiles = self.machines[machine as usize].clear(now);
        self.expect_machine(machine);
        for _ in 0..tiles {
            self.clock.after(0.5 * self.costs.round_trip_s, Event::GivenUp(machine));
        }
    }

    fn show(&mut self) {
        let Some(frame) = self.frame.take() else { return };
        let time = Duration::from_nanos(self.clock.now() - frame.began);
        self.resolution = self.resolution.after(time);
        self.shown += 1;
        self.pixels += f64::from(frame.size[0]) * f64::from(frame.size[1]);
        self.begin_frame();
    }
}
