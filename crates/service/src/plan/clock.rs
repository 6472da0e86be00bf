//! Simulated time, and what is due when.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};

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

/// Queues of events: most happen after one of a few delays, so they are entered in the order in which they are due.
const QUEUES: usize = 5;

/// The first places, whose events change most often.
const OFTEN: usize = 3;

/// The events that are due, in the order of time and then of entry.
///
/// Each place, a number below some thousands, has an event of its own, which may be put off, brought forward or
/// cancelled.
#[derive(Debug)]
pub struct Clock<E> {
    now: Time,
    entered: u64,
    /// Each in order.
    queues: [VecDeque<Due<E>>; QUEUES],
    /// When the first event of each is due, then those of the first places; [`NEVER`] if there is none.
    firsts: [Moment; QUEUES + OFTEN],
    /// When the last event of each queue is due, or was.
    lasts: [Time; QUEUES],
    /// Events that fit into no queue.
    others: BinaryHeap<Reverse<Due<E>>>,
    places: Places,
    of_place: fn(u32) -> E,
}

/// The time at which something is due, and in the lower 64 bits the number of its entry.
type Moment = u128;

const NEVER: Moment = Moment::MAX;

#[inline]
fn time_of(moment: Moment) -> Time {
    (moment >> 64) as Time
}

#[derive(Debug)]
struct Due<E> {
    moment: Moment,
    event: E,
}

impl<E> PartialEq for Due<E> {
    #[inline]
    fn eq(&self, other: &Self) -> bool {
        self.moment == other.moment
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
        self.moment.cmp(&other.moment)
    }
}

impl<E> Clock<E> {
    /// A clock, and the event of each place.
    pub fn new(of_place: fn(u32) -> E) -> Self {
        Self {
            now: 0,
            entered: 0,
            queues: Default::default(),
            firsts: [NEVER; QUEUES + OFTEN],
            lasts: [0; QUEUES],
            others: BinaryHeap::new(),
            places: Places::default(),
            of_place,
        }
    }

    /// The time.
    #[inline]
    pub fn now(&self) -> Time {
        self.now
    }

    #[inline]
    fn moment(&mut self, at: Time) -> Moment {
        self.entered += 1;
        Moment::from(at.max(self.now)) << 64 | Moment::from(self.entered)
    }

    /// Lets something happen at a time, now at the earliest.
    #[inline]
    pub fn at(&mut self, at: Time, event: E) {
        let moment = self.moment(at);
        let due = Due { moment, event };
        let Some(queue) = self.lasts.iter().position(|last| *last <= time_of(moment)) else {
            self.others.push(Reverse(due));
            return;
        };
        if self.queues[queue].is_empty() {
            self.firsts[queue] = moment;
        }
        self.lasts[queue] = time_of(moment);
        self.queues[queue].push_back(due);
    }

    /// Lets something happen after so many seconds.
    #[inline]
    pub fn after(&mut self, seconds: f64, event: E) {
        self.at(self.now + time(seconds), event);
    }

    /// Lets the event of a place happen at a time, now at the earliest, and not when it was to happen before; without
    /// a time never.
    #[inline]
    pub fn expect(&mut self, place: u32, at: Option<Time>) {
        let moment = at.map_or(NEVER, |at| self.moment(at));
        match self.firsts.get_mut(QUEUES + place as usize) {
            Some(first) => *first = moment,
            None if moment == NEVER => self.places.remove(place),
            None => self.places.set(place, moment),
        }
    }

    /// Takes the next event; it is that late then.
    #[inline]
    pub fn next(&mut self) -> Option<E> {
        let (mut queue, mut first) = (0, NEVER);
        for (place, moment) in self.firsts.iter().enumerate() {
            if *moment < first {
                (queue, first) = (place, *moment);
            }
        }
        let other = self.others.peek().map_or(NEVER, |Reverse(due)| due.moment);
        let (moment, place) = self.places.first();
        let next = first.min(other).min(moment);
        if next == NEVER {
            return None;
        }
        self.now = time_of(next);
        if moment < first && moment < other {
            self.places.remove(place);
            return Some((self.of_place)(place));
        }
        if other < first {
            return self.others.pop().map(|Reverse(due)| due.event);
        }
        let Some(events) = self.queues.get_mut(queue) else {
            self.firsts[queue] = NEVER;
            return Some((self.of_place)((queue - QUEUES) as u32));
        };
        let due = events.pop_front()?;
        self.firsts[queue] = events.front().map_or(NEVER, |next| next.moment);
        Some(due.event)
    }
}

/// The moments of places: a binary heap that knows where each place is.
#[derive(Debug, Default)]
struct Places {
    heap: Vec<(Moment, u32)>,
    /// Where each place is in the heap; [`NOWHERE`] if its event never happens.
    indices: Vec<u32>,
}

const NOWHERE: u32 = u32::MAX;

impl Places {
    /// The first moment and its place.
    #[inline]
    fn first(&self) -> (Moment, u32) {
        self.heap.first().copied().unwrap_or((NEVER, NOWHERE))
    }

    #[inline]
    fn set(&mut self, place: u32, moment: Moment) {
        if place as usize >= self.indices.len() {
            self.indices.resize(place as usize + 1, NOWHERE);
        }
        match self.indices[place as usize] {
            NOWHERE => {
                self.heap.push((moment, place));
                self.rise(self.heap.len() - 1);
            }
            index => {
                self.heap[index as usize].0 = moment;
                self.settle(index as usize);
            }
        }
    }

    #[inline]
    fn remove(&mut self, place: u32) {
        let index = self.indices.get(place as usize).copied().unwrap_or(NOWHERE);
        if index != NOWHERE {
            self.indices[place as usize] = NOWHERE;
            self.heap.swap_remove(index as usize);
            if (index as usize) < self.heap.len() {
                self.settle(index as usize);
            }
        }
    }

    /// Brings an entry to its place in the heap.
    #[inline]
    fn settle(&mut self, index: usize) {
        if index > 0 && self.heap[index].0 < self.heap[(index - 1) / 2].0 {
            self.rise(index);
        } else {
            self.sink(index);
        }
    }

    #[inline]
    fn rise(&mut self, mut index: usize) {
        let entry = self.heap[index];
        while index > 0 {
            let above = (index - 1) / 2;
            if self.heap[above].0 <= entry.0 {
                break;
            }
            self.put(index, self.heap[above]);
            index = above;
        }
        self.put(index, entry);
    }

    #[inline]
    fn sink(&mut self, mut index: usize) {
        let entry = self.heap[index];
        loop {
            let mut below = 2 * index + 1;
            if below + 1 < self.heap.len() && self.heap[below + 1].0 < self.heap[below].0 {
                below += 1;
            }
            if below >= self.heap.len() || entry.0 <= self.heap[below].0 {
                break;
            }
            self.put(index, self.heap[below]);
            index = below;
        }
        self.put(index, entry);
    }

    #[inline]
    fn put(&mut self, index: usize, entry: (Moment, u32)) {
        self.heap[index] = entry;
        self.indices[entry.1 as usize] = index as u32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A number that looks random.
    fn random(seed: &mut u64, of: u64) -> u64 {
        *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*seed >> 33) % of
    }

    #[test]
    fn events_come_in_the_order_of_time_and_of_entry_and_places_have_one() {
        for mut seed in 0..200 {
            let mut clock: Clock<u32> = Clock::new(|place| place);
            // All that is entered, in the order of entry; events have numbers after those of places.
            let mut entered: Vec<(Time, u32)> = Vec::new();
            let (places, mut number) = (12, 1000);
            for _ in 0..300 {
                let at = clock.now() + random(&mut seed, 9);
                match random(&mut seed, 5) {
                    0 | 1 => {
                        clock.at(at, number);
                        entered.push((at, number));
                        number += 1;
                    }
                    2 => {
                        let place = random(&mut seed, places) as u32;
                        let is_cancelled = random(&mut seed, 4) == 0;
                        clock.expect(place, (!is_cancelled).then_some(at));
                        entered.retain(|(_, event)| *event != place);
                        entered.extend((!is_cancelled).then_some((at, place)));
                    }
                    _ => {
                        // The first of the earliest ones.
                        let next = entered.iter().min_by_key(|(at, _)| *at).copied();
                        let before = clock.now();
                        let found = clock.next();
                        assert_eq!(
                            (clock.now(), found),
                            next.map_or((before, None), |(at, e)| (at, Some(e)))
                        );
                        entered.retain(|(_, event)| Some(*event) != found);
                    }
                }
            }
        }
    }

    #[test]
    fn what_was_to_happen_before_now_happens_now() {
        let mut clock: Clock<u32> = Clock::new(|place| place);
        clock.at(7, 70);
        assert_eq!((clock.next(), clock.now()), (Some(70), 7));
        clock.at(3, 30);
        clock.expect(1, Some(2));
        assert_eq!((clock.next(), clock.now()), (Some(30), 7));
        assert_eq!((clock.next(), clock.now()), (Some(1), 7));
        assert_eq!((clock.next(), clock.now()), (None, 7), "time stands still");
    }
}
