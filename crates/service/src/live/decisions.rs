//! What a view decides about frames that several machines render, as functions of what it knows: who gets which rows,
//! what becomes of a machine whose tile is late. Nothing here knows of threads, clocks or a bus, so the simulator
//! (`crate::plan`) decides with the same code.

use super::strips::STRIP_ROWS;
use std::ops::Range;
use std::time::Duration;

/// A frame is whole this long after it began, or as soon as what is missing then has been rendered coarsely.
pub const DEADLINE: Duration = Duration::from_millis(80);

/// Rows that did not come are rendered and shown at this fraction of width and height.
pub const COARSE: u32 = 4;

/// The time for which a worker that refuses, or has missed [`MOST_MISSES`] deadlines in a row, is left alone.
pub const REST: Duration = Duration::from_secs(5);

/// Deadlines in a row.
pub const MOST_MISSES: u32 = 3;

/// The most pixels of a tile: its JPEG is to be smaller than a message.
const MOST_PIXELS: u32 = 1 << 19;

/// The speed of a machine that has rendered nothing, as a share of the coordinator's.
const FIRST_SPEED: f64 = 0.5;

/// What a late tile leaves of a machine's speed.
const SLOWED: f64 = 0.5;

/// What the newest tile counts in a speed.
const NEWEST: f64 = 0.4;

/// Pixels a second of a machine, from the question to the answer. 0 before anything is measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Speed(f64);

impl Speed {
    /// Takes note of some rows of this width.
    pub fn add(&mut self, rows: u32, width: u32, seconds: f64) {
        let newest = f64::from(rows) * f64::from(width) / seconds.max(1e-6);
        self.0 = if self.0 == 0.0 { newest } else { self.0 + NEWEST * (newest - self.0) };
    }
}

/// The record of a machine that renders tiles: its speed, and the deadlines that it has missed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Record {
    speed: Speed,
    /// Deadlines that it has missed since its last tile.
    misses: u32,
    /// The newest frame with a late tile.
    late_frame: u64,
}

/// The consequence of a late tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Late {
    /// Nothing: another tile of the frame was late.
    Known,
    /// The machine is asked for less.
    Slowed,
    /// It is left alone for [`REST`].
    Rests,
}

impl Record {
    /// Pixels a second.
    pub fn speed(&self) -> Speed {
        self.speed
    }

    /// Deadlines that it has missed since its last tile.
    pub fn misses(&self) -> u32 {
        self.misses
    }

    /// Takes note of a tile. Whether it counts: one of a frame that it was late for says nothing.
    pub fn came(&mut self, frame: u64, rows: u32, width: u32, seconds: f64) -> bool {
        if frame <= self.late_frame {
            return false;
        }
        self.speed.add(rows, width, seconds);
        self.misses = 0;
        true
    }

    /// Takes note of a late tile. A frame counts once.
    pub fn late(&mut self, frame: u64) -> Late {
        if frame <= self.late_frame {
            return Late::Known;
        }
        self.late_frame = frame;
        self.misses += 1;
        self.speed.0 *= SLOWED;
        if self.misses < MOST_MISSES {
            return Late::Slowed;
        }
        self.misses = 0;
        Late::Rests
    }
}

/// The division of a frame's rows among the coordinator and machines.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Division {
    /// The coordinator's rows, at the top.
    pub own: Range<u32>,
    /// Rows of machines by their places in the list. One may have several tiles.
    pub tiles: Vec<(usize, Range<u32>)>,
}

/// Divides a frame by the speeds of the coordinator and of machines, so that all end at the same time. `None` if the
/// coordinator's speed is not known, or no one else gets anything.
pub fn divide([width, height]: [u32; 2], own: Speed, machines: &[Speed]) -> Option<Division> {
    if own.0 <= 0.0 {
        return None;
    }
    let strips = height.div_ceil(STRIP_ROWS);
    let speeds = machines.iter().map(|speed| if speed.0 == 0.0 { FIRST_SPEED * own.0 } else { speed.0 });
    let speeds: Vec<f64> = std::iter::once(own.0).chain(speeds).collect();
    let counts = portions(strips, &speeds);
    let rows = |first: u32, count: u32| first * STRIP_ROWS..((first + count) * STRIP_ROWS).min(height);
    let most = (MOST_PIXELS / width.max(1) / STRIP_ROWS).max(1);
    let (mut next, mut tiles) = (counts[0], Vec::new());
    for (place, &count) in counts[1..].iter().enumerate() {
        for first in (0..count).step_by(most as usize) {
            tiles.push((place, rows(next + first, most.min(count - first))));
        }
        next += count;
    }
    (!tiles.is_empty()).then(|| Division { own: rows(0, counts[0]), tiles })
}

/// Divides strips by speeds. The first one gets at least one strip, and so does each other for which there is one. Each
/// further strip is for whoever has rendered it first, so that the last one to end is as early as can be.
fn portions(strips: u32, speeds: &[f64]) -> Vec<u32> {
    let mut counts = vec![0; speeds.len()];
    let some = speeds.len().min(strips as usize);
    counts[..some].fill(1);
    for _ in some..strips as usize {
        let end = |place: &usize| f64::from(counts[*place] + 1) / speeds[*place];
        let first = (0..some).min_by(|a, b| end(a).total_cmp(&end(b)));
        first.into_iter().for_each(|place| counts[place] += 1);
    }
    counts
}

/// The size of a coarse frame of a frame of this size, and its rows that cover those that are missing.
pub fn coarse(size: [u32; 2], missing: &Range<u32>) -> ([u32; 2], Range<u32>) {
    let [_, height] = size;
    let last = missing.end;
    debug_assert!(STRIP_ROWS.is_multiple_of(COARSE) && (last.is_multiple_of(COARSE) || last == height));
    (size.map(|side| side.div_ceil(COARSE)), missing.start / COARSE..last.div_ceil(COARSE))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_are_divided_by_speed_and_all_are_given() {
        assert_eq!(portions(30, &[1.0, 1.0, 1.0]), [10, 10, 10]);
        assert_eq!(portions(30, &[1.0, 2.0]), [10, 20]);
        assert_eq!(portions(2, &[1.0, 1.0, 1.0]), [1, 1, 0], "no strip for the third");
        assert_eq!(portions(1, &[1.0, 9.0]), [1, 0]);
        assert_eq!(portions(10, &[1.0, 1e9, 1e-9]), [1, 8, 1], "everyone has one, to be measured by");
        assert_eq!(
            portions(30, &[1.0; 21]).iter().max(),
            Some(&2),
            "no one has what others' rounding leaves"
        );
        for strips in 1..60 {
            let counts = portions(strips, &[3.0, 1.0, 0.5, 7.0]);
            assert_eq!(counts.iter().sum::<u32>(), strips);
            assert!(counts[0] > 0);
        }
        // Within a strip of what speeds say.
        let speeds = [3.0, 1.0, 0.5, 7.0];
        for (count, speed) in portions(230, &speeds).into_iter().zip(speeds) {
            assert!((f64::from(count) - 20.0 * speed).abs() <= 1.0, "{count} strips at speed {speed}");
        }
    }

    #[test]
    fn rows_of_a_frame_are_given_once_in_whole_strips() {
        let speed = |rows: u32| {
            let mut speed = Speed::default();
            speed.add(rows, 100, 0.1);
            speed
        };
        for (size, speeds) in
            [([640, 360], vec![10, 20, 5]), ([4096, 2160], vec![300, 1]), ([64, 33], vec![9])]
        {
            let machines: Vec<Speed> = speeds.iter().map(|rows| speed(*rows)).collect();
            let Division { own, tiles } = divide(size, speed(10), &machines).expect("a division");
            let mut next = own.end;
            assert_eq!(own.start, 0);
            for (_, rows) in &tiles {
                assert!(rows.start == next && next.is_multiple_of(STRIP_ROWS), "{tiles:?}");
                assert!(rows.len() as u32 * size[0] <= MOST_PIXELS, "{tiles:?}");
                next = rows.end;
            }
            assert_eq!(next, size[1]);
        }
        assert_eq!(divide([640, 360], Speed::default(), &[speed(1)]), None);
        assert_eq!(divide([640, 360], speed(1), &[]), None);
        // A machine that has rendered nothing is taken for half as fast.
        let found = divide([640, 480], speed(10), &[Speed::default()]).expect("a division");
        assert_eq!(found.tiles, [(0, 320..480)]);
    }

    #[test]
    fn who_is_late_is_asked_for_less_and_then_left_alone() {
        let mut record = Record::default();
        assert!(record.came(1, 16, 100, 0.01));
        assert_eq!((record.speed(), record.late(2)), (Speed(160_000.0), Late::Slowed));
        assert_eq!((record.speed(), record.late(2)), (Speed(80_000.0), Late::Known), "a frame counts once");
        assert!(!record.came(2, 16, 100, 0.2), "it was late for this one");
        assert_eq!((record.late(3), record.misses(), record.late(4)), (Late::Slowed, 2, Late::Rests));
        assert_eq!(record.misses(), 0);
        assert!(record.came(5, 16, 100, 0.01) && record.speed().0 > 20_000.0);
    }
}
