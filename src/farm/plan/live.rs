//! Live views: each frame is cut into tiles, which machines render and send back ready to be shown.
//!
//! Tiles are given to machines in turns. Two frames are in flight, so that machines render one while the other travels.

use super::clock::{Clock, Time, seconds};
use super::costs::{Costs, Farm, LiveJob};
use super::prediction::{Load, Prediction};
use super::shared::Shared;

/// Frames in flight.
const IN_FLIGHT: u32 = 2;

#[derive(Clone, Copy, Debug)]
enum Event {
    /// Something in a thread of the coordinator ends: a tile is asked for, or has come.
    Threads(u32),
    /// A tile's request reaches its machine.
    Asked(Tile),
    /// A tile on a machine is rendered.
    Machine(u32, u32),
    /// A tile has come over the link.
    Incoming(u32),
    /// A tile reaches the coordinator.
    Came(Tile),
}

#[derive(Clone, Copy, Debug)]
struct Tile {
    frame: u32,
    machine: u32,
}

#[derive(Clone, Copy, Debug)]
enum Work {
    Ask(Tile),
    Show(Tile),
}

struct View<'a> {
    costs: &'a Costs,
    job: &'a LiveJob,
    clock: Clock<Event>,
    threads: Shared<Work>,
    incoming: Shared<Tile>,
    machines: Vec<Shared<Tile>>,
    tiles: u32,
    /// Tiles of each frame that have not come.
    left: Vec<u32>,
    next_frame: u32,
    shown: u32,
    tile_s: f64,
    tile_bytes: f64,
    last: Time,
}

/// Predicts a live view.
pub(super) fn predict(farm: &Farm, costs: &Costs, job: &LiveJob) -> Prediction {
    let bytes = farm.network_bits / 8.0;
    let tiles = job.size.0.div_ceil(job.tile) * job.size.1.div_ceil(job.tile);
    let pixels = f64::from(job.size.0) * f64::from(job.size.1) / f64::from(tiles);
    let threads = costs.coordinator_threads;
    let mut view = View {
        costs,
        job,
        clock: Clock::default(),
        threads: Shared::new(threads, 1_f64.min(threads)),
        incoming: Shared::new(bytes, bytes),
        machines: (0..farm.machines).map(|_| Shared::new(1.0, 1.0)).collect(),
        tiles,
        left: vec![tiles; job.frames as usize],
        next_frame: 0,
        shown: 0,
        tile_s: pixels * f64::from(job.spp) / costs.samples_per_second + costs.unit_s,
        tile_bytes: pixels * job.pixel_bytes,
        last: 0,
    };
    for _ in 0..IN_FLIGHT {
        view.begin_frame();
    }
    while let Some(event) = view.clock.next() {
        view.happens(event);
    }
    let total = seconds(view.last).max(1e-9);
    let now = view.clock.now();
    let busy: f64 = view.machines.iter_mut().map(|machine| machine.done(now)).sum();
    let loads = [
        ("machines", busy / total / f64::from(farm.machines)),
        ("link to the coordinator", view.incoming.done(now) / total / bytes),
        ("coordinator's threads", view.threads.done(now) / total / threads),
    ];
    let units = u64::from(tiles) * u64::from(job.frames);
    Prediction {
        job: job.name.clone(),
        machines: farm.machines,
        seconds: total,
        first_s: 0.0,
        frames_per_second: f64::from(job.frames) / total,
        units,
        unit_s: view.tile_s,
        idle_share: 1.0 - busy / total / f64::from(farm.machines),
        bytes: view.tile_bytes * units as f64,
        redeliveries: 0,
        loads: loads.into_iter().map(|(name, share)| Load { name, share }).collect(),
        failed: None,
    }
}

impl View<'_> {
    fn begin_frame(&mut self) {
        if self.next_frame == self.job.frames {
            return;
        }
        let frame = self.next_frame;
        self.next_frame += 1;
        let machines = self.machines.len() as u32;
        for tile in 0..self.tiles {
            // Each frame begins with another machine, so that all have the same number of tiles.
            let machine = (frame.wrapping_mul(self.tiles) + tile) % machines;
            self.in_thread(Work::Ask(Tile { frame, machine }));
        }
    }

    fn in_thread(&mut self, work: Work) {
        self.threads.add(self.clock.now(), 0.5 * self.costs.question_s, work);
        self.expect_threads();
    }

    fn expect_threads(&mut self) {
        if let Some((at, version)) = self.threads.due() {
            self.clock.at(at, Event::Threads(version));
        }
    }

    fn expect_machine(&mut self, machine: u32) {
        if let Some((at, version)) = self.machines[machine as usize].due() {
            self.clock.at(at, Event::Machine(machine, version));
        }
    }

    fn expect_incoming(&mut self) {
        if let Some((at, version)) = self.incoming.due() {
            self.clock.at(at, Event::Incoming(version));
        }
    }

    fn happens(&mut self, event: Event) {
        let (now, half) = (self.clock.now(), 0.5 * self.costs.round_trip_s);
        match event {
            Event::Threads(version) => {
                let Some(work) = self.threads.end(now, version) else { return };
                self.expect_threads();
                match work {
                    Work::Ask(tile) => self.clock.after(half, Event::Asked(tile)),
                    Work::Show(tile) => self.show(tile),
                }
            }
            Event::Asked(tile) => {
                self.machines[tile.machine as usize].add(now, self.tile_s, tile);
                self.expect_machine(tile.machine);
            }
            Event::Machine(machine, version) => {
                let Some(tile) = self.machines[machine as usize].end(now, version) else { return };
                self.expect_machine(machine);
                self.incoming.add(now, self.tile_bytes, tile);
                self.expect_incoming();
            }
            Event::Incoming(version) => {
                let Some(tile) = self.incoming.end(now, version) else { return };
                self.expect_incoming();
                self.clock.after(half, Event::Came(tile));
            }
            Event::Came(tile) => self.in_thread(Work::Show(tile)),
        }
    }

    fn show(&mut self, tile: Tile) {
        let left = &mut self.left[tile.frame as usize];
        *left -= 1;
        if *left == 0 {
            self.shown += 1;
            self.last = self.clock.now();
            self.begin_frame();
        }
    }
}
