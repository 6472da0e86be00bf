//! The clock: what happens next on a machine whose threads share its cores, and when.

use super::machine::{Device, Machine};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Nanoseconds, ordered.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Ns(f64);

impl Eq for Ns {}

impl Ord for Ns {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

impl PartialOrd for Ns {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

/// A step of a task.
#[derive(Clone, Copy, Debug)]
pub enum Step {
    /// Computes for so many nanoseconds of a core.
    Compute(f64),
    /// Waits for so many nanoseconds.
    Sleep(f64),
}

/// Virtual time. Threads that compute share the cores evenly, as if each had a slice of any length.
pub struct Clock {
    now: f64,
    cores: f64,
    device: Option<Device>,
    /// Core nanoseconds that each thread that computes has had: it grows more slowly while there are more than cores.
    work: f64,
    computing: BinaryHeap<Reverse<(Ns, usize)>>,
    waiting: BinaryHeap<Reverse<(Ns, usize)>>,
    /// When each stage of the device is free.
    free: [f64; 3],
    /// Time in which the device's kernels ran.
    pub device_busy_ns: f64,
}

impl Clock {
    pub fn new(machine: &Machine) -> Self {
        Self {
            now: 0.0,
            cores: machine.cores as f64,
            device: machine.device,
            work: 0.0,
            computing: BinaryHeap::new(),
            waiting: BinaryHeap::new(),
            free: [0.0; 3],
            device_busy_ns: 0.0,
        }
    }

    pub fn now(&self) -> f64 {
        self.now
    }

    pub fn now_ns(&self) -> u64 {
        self.now as u64
    }

    /// A thread begins a step.
    pub fn begin(&mut self, thread: usize, step: Step) {
        match step {
            Step::Compute(ns) => self.computing.push(Reverse((Ns(self.work + ns), thread))),
            Step::Sleep(ns) => self.waiting.push(Reverse((Ns(self.now + ns), thread))),
        }
    }

    /// Has the device trace so many rays and shadow rays from now on; returns when they can be read.
    pub fn submit(&mut self, rays: [u64; 2]) -> f64 {
        let device = self.device.expect("only a machine with a device has bundles");
        let mut at = self.now;
        let stages = device.stages(rays);
        for (free, ns) in self.free.iter_mut().zip(stages) {
            at = at.max(*free) + ns;
            *free = at;
        }
        self.device_busy_ns += stages[1];
        at + device.latency_ns
    }

    /// The thread that ends its step next; time goes on until then. `None` if no thread has one.
    pub fn next(&mut self) -> Option<usize> {
        // Nanoseconds for one of each thread that computes.
        let pace = (self.computing.len() as f64 / self.cores).max(1.0);
        let computed = self.computing.peek().map(|Reverse((at, _))| self.now + (at.0 - self.work) * pace);
        let waited = self.waiting.peek().map(|Reverse((at, _))| at.0);
        let computes = match (computed, waited) {
            (None, None) => return None,
            (computed, waited) => computed.unwrap_or(f64::INFINITY) <= waited.unwrap_or(f64::INFINITY),
        };
        let Reverse((at, thread)) = if computes { self.computing.pop()? } else { self.waiting.pop()? };
        if computes {
            self.now += (at.0 - self.work) * pace;
            self.work = at.0;
        } else {
            self.work += (at.0 - self.now) / pace;
            self.now = at.0;
        }
        Some(thread)
    }
}
