//! Machines: they lease units, fetch scenes, render, send.

use super::clock::{Time, seconds, time};
use super::coordinator::Question;
use super::shared::Shared;
use super::simulator::{Begun, Event, Flight, Having, Simulator};
use crate::contract::{BEATS, PART_BYTES};
use crate::coordinator::decisions::{self, Fetch};
use std::collections::VecDeque;
use xxhash_rust::xxh3::xxh3_64;

/// How long a unit that its worker is not to render rests.
const REST_S: f64 = 1.0;

/// How long a slot waits before it asks again that may have none of the units that wait.
const PATIENCE_S: f64 = 0.5;

/// A slot of a machine; after a failure the machine has another life.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Slot {
    pub machine: u32,
    pub life: u32,
}

/// What a machine does.
#[derive(Clone, Copy, Debug)]
pub(super) enum Task {
    /// It reads the scene of a job.
    Read(u32),
    /// It renders a unit.
    Render(u32),
}

/// How far a machine is with a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Scene {
    Absent,
    /// It has a unit of the scene, and is about to fetch it.
    Wanted,
    Coming,
    OnDisk,
    Ready,
}

/// A machine.
#[derive(Debug)]
pub(super) struct Machine {
    life: u32,
    is_there: bool,
    /// When its last life ended.
    gone: Time,
    pub processor: Shared<Task>,
    scenes: Vec<Scene>,
    /// Units that wait for a scene.
    blocked: Vec<u32>,
    /// Units that it has leased.
    units: Vec<u32>,
}

impl Machine {
    pub fn new(jobs: usize) -> Self {
        Self {
            life: 0,
            is_there: false,
            gone: 0,
            processor: Shared::new(1.0, 1.0),
            scenes: vec![Scene::Absent; jobs],
            blocked: Vec::new(),
            units: Vec::new(),
        }
    }

    /// True if it has joined and has not failed.
    #[inline]
    pub fn is_there(&self) -> bool {
        self.is_there
    }
}

impl Simulator<'_> {
    #[inline]
    fn slot(&self, machine: u32) -> Slot {
        Slot { machine, life: self.machines[machine as usize].life }
    }

    /// True if a machine still has the life of a slot.
    #[inline]
    pub fn is_there(&self, slot: Slot) -> bool {
        let machine = &self.machines[slot.machine as usize];
        machine.is_there && machine.life == slot.life
    }

    /// The time since the life of a slot ended; 0 if it goes on.
    pub fn silent(&self, slot: Slot) -> Time {
        if self.is_there(slot) { 0 } else { self.clock.now() - self.machines[slot.machine as usize].gone }
    }

    pub fn start_machine(&mut self, machine: u32) {
        let slot = self.slot(machine);
        self.clock.after(self.costs.startup_s, Event::Joins(slot));
    }

    pub fn joins(&mut self, slot: Slot) {
        self.machines[slot.machine as usize].is_there = true;
        self.slots += self.costs.slots as usize;
        for _ in 0..self.costs.slots {
            self.ask(slot);
        }
        if let Some(mean) = self.farm.failure_s {
            // Lives end at random, and no life knows how long it has lasted.
            let name = [slot.machine.to_le_bytes(), slot.life.to_le_bytes()].concat();
            let random = (xxh3_64(&name) >> 11) as f64 / (1_u64 << 53) as f64;
            self.clock.after(-mean * (1.0 - random).ln(), Event::Fails(slot));
        }
    }

    /// A slot asks for a unit.
    #[inline]
    fn ask(&mut self, slot: Slot) {
        self.clock.after(0.5 * self.costs.round_trip_s, Event::Asks(slot));
    }

    /// A slot's request for a unit has come.
    pub fn asks(&mut self, slot: Slot) {
        if !self.is_there(slot) {
            return;
        }
        if self.stands_by(slot) {
            self.clock.after(self.costs.lease_s, Event::Asks(slot));
            return;
        }
        self.waiting.push_back(slot);
        self.deliver();
    }

    /// Gives units that wait to slots that wait.
    pub fn deliver(&mut self) {
        loop {
            while self.waiting.front().is_some_and(|slot| !self.is_there(*slot)) {
                self.waiting.pop_front();
            }
            let Some(&slot) = self.waiting.front() else { return };
            if self.lanes.iter().all(VecDeque::is_empty) {
                return;
            }
            self.waiting.pop_front();
            if self.stands_by(slot) {
                self.clock.after(self.costs.lease_s, Event::Asks(slot));
                continue;
            }
            let Some(unit) = self.next_for(slot) else {
                self.clock.after(PATIENCE_S, Event::Asks(slot));
                continue;
            };
            let flight = &mut self.flights[unit as usize];
            flight.deliveries += 1;
            flight.leased = self.clock.now();
            let job = flight.job as usize;
            let machine = &mut self.machines[slot.machine as usize];
            machine.units.push(unit);
            if machine.scenes[job] == Scene::Absent {
                machine.scenes[job] = Scene::Wanted;
                self.jobs[job].having.fetching += 1;
            }
            self.clock.after(0.0, Event::Delivered(unit, slot));
        }
    }

    /// Takes the next unit that waits and that a slot may have: one whose scene its machine has or would have in time.
    fn next_for(&mut self, slot: Slot) -> Option<u32> {
        let jobs = 0..self.jobs.len() as u32;
        let late: Vec<u32> = jobs.filter(|job| self.is_late(slot.machine, *job)).collect();
        if late.len() == self.jobs.len() && self.for_all == 0 {
            return None;
        }
        let flights = &self.flights;
        let may = |unit: &u32| {
            let flight = &flights[*unit as usize];
            flight.is_for_all() || !late.contains(&flight.job)
        };
        let unit = self.lanes.iter_mut().find_map(|lane| {
            let place = lane.iter().position(may)?;
            lane.remove(place)
        })?;
        self.for_all -= usize::from(self.flights[unit as usize].is_for_all());
        Some(unit)
    }

    /// True if a machine lacks the scene of a job, and would have it too late.
    #[inline]
    fn is_late(&self, machine: u32, job: u32) -> bool {
        let scene = self.machines[machine as usize].scenes[job as usize];
        if scene != Scene::Absent {
            return false;
        }
        let Having { fetching, has } = self.jobs[job as usize].having;
        let fetch = Fetch {
            scene_s: Some(self.costs.scene_bytes * 8.0 / self.farm.network_bits),
            fetching,
            rest_s: self.jobs[job as usize].rest_s(),
            slots: has * self.costs.slots as usize + fetching,
        };
        !decisions::is_to_fetch(&fetch)
    }

    pub fn answered(&mut self, unit: u32, slot: Slot, begun: Begun) {
        if !self.is_there(slot) {
            return;
        }
        let now = self.clock.now();
        match begun {
            Begun::Go => {
                self.flights[unit as usize].began = now;
                self.prepare(unit, slot);
            }
            Begun::Wait => {
                self.machines[slot.machine as usize].units.retain(|own| *own != unit);
                self.clock.after(REST_S, Event::Redelivered(unit));
                self.ask(slot);
            }
            Begun::Skip => self.clock.after(self.costs.round_trip_s, Event::Done(unit, slot)),
        }
    }

    /// Renders a unit, as soon as its scene is there.
    fn prepare(&mut self, unit: u32, slot: Slot) {
        let job = self.flights[unit as usize].job;
        let machine = &mut self.machines[slot.machine as usize];
        let scene = machine.scenes[job as usize];
        if scene == Scene::Ready {
            return self.render(unit, slot);
        }
        machine.blocked.push(unit);
        machine.scenes[job as usize] = Scene::Coming;
        self.jobs[job as usize].having.fetching += usize::from(scene == Scene::OnDisk);
        match scene {
            Scene::Absent | Scene::Wanted => {
                self.counts.bytes += self.costs.scene_bytes;
                self.outgoing.add(self.clock.now(), self.costs.scene_bytes, (slot, job));
                self.expect_outgoing();
            }
            Scene::OnDisk => self.on_machine(slot.machine, self.costs.read_s, Task::Read(job)),
            Scene::Coming | Scene::Ready => {}
        }
    }

    /// Messages that a scene comes in.
    pub fn scene_parts(&self) -> f64 {
        (self.costs.scene_bytes / PART_BYTES as f64).ceil()
    }

    pub fn fetched(&mut self, slot: Slot, job: u32) {
        if self.is_there(slot) {
            self.on_machine(slot.machine, self.costs.read_s, Task::Read(job));
        }
    }

    fn render(&mut self, unit: u32, slot: Slot) {
        let now = self.clock.now();
        self.counts.first.get_or_insert(now);
        self.flights[unit as usize].rendering = now;
        let work = self.work_of(unit);
        self.on_machine(slot.machine, work, Task::Render(unit));
    }

    /// Something on a machine ends.
    pub fn machine_ends(&mut self, machine: u32) {
        let now = self.clock.now();
        let slot = self.slot(machine);
        let own = &mut self.machines[machine as usize];
        let Some(task) = own.processor.end(now) else { return };
        self.expect_machine(machine);
        match task {
            Task::Read(job) => {
                let own = &mut self.machines[machine as usize];
                own.scenes[job as usize] = Scene::Ready;
                let having = &mut self.jobs[job as usize].having;
                (having.fetching, having.has) = (having.fetching - 1, having.has + 1);
                let (ready, blocked) = std::mem::take(&mut own.blocked)
                    .into_iter()
                    .partition(|unit: &u32| self.flights[*unit as usize].job == job);
                own.blocked = blocked;
                let ready: Vec<u32> = ready;
                ready.into_iter().for_each(|unit| self.render(unit, slot));
            }
            Task::Render(unit) => {
                let bytes = self.bytes_of(unit);
                self.counts.bytes += bytes;
                let Flight { began, rendering, .. } = self.flights[unit as usize];
                self.counts.rendering_s += seconds(now - rendering);
                let taken = now - began;
                self.incoming.add(now, bytes, Question::Result(unit, slot, taken));
                self.expect_incoming();
            }
        }
    }

    /// The sums of a unit have come, but for the pauses between their parts.
    #[inline]
    pub fn sent(&mut self, question: Question) {
        let trips = self.parts_of(question.unit()) - 0.5;
        self.clock.after(trips * self.costs.round_trip_s, Event::Arrives(question));
    }

    /// Messages that the sums of a unit come in.
    #[inline]
    pub fn parts_of(&self, unit: u32) -> f64 {
        (self.bytes_of(unit) / PART_BYTES as f64).ceil().max(1.0)
    }

    pub fn done(&mut self, unit: u32, slot: Slot) {
        if !self.is_there(slot) {
            return;
        }
        self.machines[slot.machine as usize].units.retain(|own| *own != unit);
        self.ask(slot);
        self.deliver();
    }

    pub fn redelivered(&mut self, unit: u32) {
        let flight = &self.flights[unit as usize];
        self.for_all += usize::from(flight.is_for_all());
        self.lanes[usize::from(!flight.is_urgent)].push_front(unit);
        self.deliver();
    }

    /// A machine fails: its units come back when their leases are over, and the machine after a while.
    pub fn fails(&mut self, slot: Slot) {
        if !self.is_there(slot) {
            return;
        }
        let now = self.clock.now();
        let machine = &mut self.machines[slot.machine as usize];
        machine.is_there = false;
        machine.gone = now;
        machine.life += 1;
        machine.processor.clear(now);
        machine.blocked.clear();
        for (scene, run) in machine.scenes.iter_mut().zip(&mut self.jobs) {
            *scene = match scene {
                Scene::Absent => Scene::Absent,
                Scene::Wanted | Scene::Coming => {
                    run.having.fetching -= 1;
                    Scene::Absent
                }
                Scene::OnDisk => Scene::OnDisk,
                Scene::Ready => {
                    run.having.has -= 1;
                    Scene::OnDisk
                }
            };
        }
        self.expect_machine(slot.machine);
        self.slots -= self.costs.slots as usize;
        let beat = time(self.costs.lease_s / f64::from(BEATS)).max(1);
        for unit in std::mem::take(&mut self.machines[slot.machine as usize].units) {
            let leased = self.flights[unit as usize].leased;
            let beaten = leased + (now - leased) / beat * beat;
            self.clock.at(beaten + time(self.costs.lease_s), Event::Redelivered(unit));
        }
        self.start_machine(slot.machine);
    }
}
