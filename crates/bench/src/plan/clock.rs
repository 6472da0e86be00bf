//! Simulated time, and what is due when.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Nanoseconds since the start.
pub type Time = u64;

/// A duration in seconds as simulated time, never shorter.
#[inline]
pub fn time(seconds: f64) -> Time {
    let (nanoseconds, whole) = (seconds * 1e9, (seconds * 1e9) as Time);
    // `ceil` is a call.
    whole + Time::from(nanoseconds > whole as f64)
}

/// Simulated time in seconds.
#[inline]
pub fn seconds(time: Time) -> f64 {
    time as f64 * 1e-9
}

/// The events that are due, in the order of time and then of entry.
#[derive(Debug)]
pub struct Clock<E> {
    now: Time,
    entered: u64,
    due: BinaryHeap<Reverse<Due<E>>>,
}

#[derive(Debug)]
struct Due<E> {
    at: Time,
    seq: u64,
    event: E,
}

impl<E> Due<E> {
    #[inline]
    fn key(&self) -> (Time, u64) {
        (self.at, self.seq)
    }
}

impl<E> PartialEq for Due<E> {
    #[inline]
    fn eq(&self, other: &Self) -> bool {
        self.key() == other.key()
    }
}

impl<E> Eq for Due<E> {}

impl<E> PartialOrd for Due<E> {
    #[inline]
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl<E> Ord for Due<E> {
    #[inline]
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.key().cmp(&other.key())
    }
}

impl<E> Default for Clock<E> {
    fn default() -> Self {
        Self { now: 0, entered: 0, due: BinaryHeap::new() }
    }
}

impl<E> Clock<E> {
    /// The time.
    #[inline]
    pub fn now(&self) -> Time {
        self.now
    }

    /// Lets something happen at a time, now at the earliest.
    #[inline]
    pub fn at(&mut self, at: Time, event: E) {
        self.entered += 1;
        self.due.push(Reverse(Due { at: at.max(self.now), seq: self.entered, event }));
    }

    /// Lets something happen after so many seconds.
    #[inline]
    pub fn after(&mut self, seconds: f64, event: E) {
        self.at(self.now + time(seconds), event);
    }

    /// Takes the next event; it is that late then.
    #[inline]
    pub fn next(&mut self) -> Option<E> {
        let Reverse(due) = self.due.pop()?;
        self.now = due.at;
        Some(due.event)
    }
}
