//! How passes are cut into units. The picture does not depend on it.

use crate::coordinator::ledger::{UnitRow, UnitState};
use raystream::render::{BLOCK, Pass};
use xxhash_rust::xxh3::xxh3_64;

/// Seconds that a unit is to take: long enough to be worth its messages, short enough that little is lost with a
/// worker and the last unit of a frame does not keep others waiting.
const UNIT_SECONDS: f64 = 1.0;

/// The same in the service's own process, where nothing is lost with a worker alone.
const LOCAL_SECONDS: f64 = 2.0;

/// Seconds that the last units of a frame are to take at least: what a unit costs besides its samples is a small part.
const LAST_SECONDS: f64 = 0.5;

/// A unit has at most this many times the samples of the largest that was measured.
const GROWTH: f64 = 4.0;

/// Samples a second that are assumed before any unit of a job has ended.
const FIRST_SPEED: f64 = (1 << 18) as f64;

/// Seconds of units after which what was measured counts half.
const HALF_LIFE: f64 = 8.0;

/// Blocks of a unit: fewer would share few rays, more would make its message long.
const FEWEST_BLOCKS: u32 = 16;
const MOST_BLOCKS: u32 = 2048;

/// Pixels of a block.
pub const BLOCK_PIXELS: f64 = (BLOCK * BLOCK) as f64;

/// The size of units.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sizes {
    /// Pixels × samples of a unit, instead of a duration.
    pub samples: Option<u64>,
    /// Cut at random with this seed, for tests.
    pub random: Option<u64>,
    /// Units of the frame that are rendered at the same time at its end: the last ones are smaller, so that none keeps
    /// the others' workers waiting. 0 if other frames follow.
    pub at_once: usize,
    /// True if they are rendered in this process.
    pub is_local: bool,
}

/// The speed of a job's units, as far as it is known: that of those that ended last, each by the time it took, so that
/// a few short ones say little.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Speed {
    samples: f64,
    seconds: f64,
    /// Samples of the largest unit.
    largest: f64,
}

impl Speed {
    /// Takes note of a unit.
    pub fn add(&mut self, samples: u64, seconds: f64) {
        let (samples, seconds) = (samples as f64, seconds.max(1e-4));
        let kept = (-seconds / HALF_LIFE).exp2();
        self.samples = self.samples * kept + samples;
        self.seconds = self.seconds * kept + seconds;
        self.largest = self.largest.max(samples);
    }

    /// Pixels × samples a second of one unit while others are under way, as far as is known.
    pub fn samples_per_second(&self) -> f64 {
        if self.seconds > 0.0 { self.samples / self.seconds } else { FIRST_SPEED }
    }

    /// Pixels × samples of the next unit of a pass that has so many left.
    fn samples_of_unit(&self, left: f64, Sizes { at_once, is_local, .. }: Sizes) -> f64 {
        let speed = self.samples_per_second();
        let share = if at_once > 0 { left / at_once as f64 } else { f64::INFINITY };
        let wanted = (if is_local { LOCAL_SECONDS } else { UNIT_SECONDS } * speed)
            .min(share.max(LAST_SECONDS * speed));
        if self.largest > 0.0 { wanted.min(GROWTH * self.largest) } else { wanted }
    }
}

/// The unit of a pass after the last one; `None` if it was the last. First come all samples of some blocks, then those
/// of the next.
pub fn next(
    frame: u32,
    (number, pass): (u64, &Pass),
    last: Option<&UnitRow>,
    sizes: Sizes,
    speed: Speed,
) -> Option<UnitRow> {
    let (all, samples) = (pass.blocks().len() as u32, pass.samples());
    let cut = |row: &UnitRow| {
        u64::from(row.block) * samples.len() as u64
            + u64::from(row.blocks) * u64::from(row.end - samples.start)
    };
    let left = (u64::from(all) * samples.len() as u64).saturating_sub(last.map_or(0, cut));
    if left == 0 {
        return None;
    }
    let left = left as f64 * BLOCK_PIXELS;
    let wanted = sizes.samples.map_or(speed.samples_of_unit(left, sizes), |samples| samples as f64);
    let block_samples = (wanted / BLOCK_PIXELS).max(1.0);
    let count = last.map_or(0, |last| last.number + 1);
    let random = |of: u32, salt: u64| {
        let all = [sizes.random.unwrap_or(0), u64::from(count), u64::from(frame), number, salt];
        1 + (xxh3_64(&all.map(u64::to_le_bytes).concat()) % u64::from(of)) as u32
    };
    let (block, blocks, first) = match last {
        Some(last) if last.end < samples.end => (last.block, last.blocks, last.end),
        _ => {
            let block = last.map_or(0, |last| last.block + last.blocks);
            let left = all.checked_sub(block).filter(|left| *left > 0)?;
            let fit = (block_samples / samples.len() as f64) as u32;
            let blocks = match sizes.random {
                Some(_) => random(left, 1),
                None => fit.clamp(FEWEST_BLOCKS, MOST_BLOCKS).min(left),
            };
            (block, blocks, samples.start)
        }
    };
    let left = samples.end.checked_sub(first).filter(|left| *left > 0)?;
    let fit = (block_samples / f64::from(blocks)) as u32;
    let taken = match sizes.random {
        Some(_) => random(left, 2),
        None => fit.clamp(1, left),
    };
    // No tiny rest.
    let taken = if sizes.random.is_none() && left - taken < taken / 2 { left } else { taken };
    Some(UnitRow {
        frame,
        pass: number,
        number: count,
        block,
        blocks,
        first,
        end: first + taken,
        state: UnitState::Open,
        worker: None,
        digest: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use raystream::render::Blocks;

    fn cut(pass: &Pass, sizes: Sizes, speed: Speed) -> Vec<UnitRow> {
        let mut units: Vec<UnitRow> = Vec::new();
        while let Some(unit) = next(3, (5, pass), units.last(), sizes, speed) {
            units.push(unit);
        }
        units
    }

    #[test]
    fn units_have_each_sample_of_each_block_once() {
        for (size, samples) in [((1, 1), 0..1), ((960, 540), 0..64), ((640, 360), 8..16), ((64, 48), 0..5000)]
        {
            let pass = Pass::new(Blocks::new(size.0, size.1).in_order(), samples.clone());
            let (all, many) = (pass.blocks().len() as u64, samples.len() as u64);
            let mut cuts = vec![Sizes::default(), Sizes { samples: Some(1), ..Sizes::default() }];
            cuts.extend((0..20).map(|seed| Sizes { random: Some(seed), ..Sizes::default() }));
            cuts.extend([1, 7, 1000].map(|at_once| Sizes { at_once, ..Sizes::default() }));
            for sizes in cuts {
                let units = cut(&pass, sizes, Speed::default());
                let taken: u64 = units.iter().map(UnitRow::samples).sum();
                assert_eq!(taken, all * many * BLOCK_PIXELS as u64, "{sizes:?}");
                let mut places: Vec<(u32, u32)> = units.iter().map(|unit| (unit.block, unit.first)).collect();
                places.sort_unstable();
                places.dedup();
                assert_eq!(places.len(), units.len(), "no two begin at the same place");
                assert!(units.iter().all(|unit| unit.end <= samples.end && unit.first < unit.end));
            }
        }
    }

    /// As if a unit of this many seconds had ended.
    fn measured(samples_per_second: f64, seconds: f64) -> Speed {
        let mut speed = Speed::default();
        speed.add((samples_per_second * seconds) as u64, seconds);
        speed
    }

    /// The seconds that a unit takes.
    fn seconds(unit: &UnitRow, speed: Speed) -> f64 {
        unit.samples() as f64 / speed.samples_per_second()
    }

    #[test]
    fn units_take_about_a_second() {
        let pass = Pass::new(Blocks::new(1920, 1080).in_order(), 0..4096);
        for speed in [2e4, 1e6, 3e7] {
            let speed = measured(speed, 1.0);
            let units = cut(&pass, Sizes::default(), speed);
            for unit in &units[..units.len().min(100)] {
                let seconds = seconds(unit, speed);
                assert!((0.3..2.0).contains(&seconds), "{seconds} s at {speed:?}");
            }
        }
    }

    #[test]
    fn the_last_units_of_a_frame_are_small_and_few() {
        let pass = Pass::new(Blocks::new(640, 360).in_order(), 0..512);
        let speed = measured(1e6, 1.0);
        let large = cut(&pass, Sizes::default(), speed);
        let units = cut(&pass, Sizes { at_once: 10, ..Sizes::default() }, speed);
        let [first, .., last] = &*units else { panic!("more than one") };
        assert!((0.5..2.0).contains(&seconds(first, speed)), "{first:?}");
        assert!((0.1..0.8).contains(&seconds(last, speed)), "{last:?}");
        // Workers that take them in turns end together, though one of them has just begun a large unit.
        let mut free = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 1.0];
        for unit in &units {
            let next = (0..10).min_by(|a, b| f64::total_cmp(&free[*a], &free[*b])).expect("ten");
            free[next] += seconds(unit, speed);
        }
        let (ends, latest) = (free.map(|end| end as f32), free.into_iter().fold(0.0, f64::max));
        let idle: f64 = free.into_iter().map(|end| latest - end).sum();
        assert!(idle / 10.0 < 0.3, "{ends:?}");
        assert!(units.len() < large.len() + 60, "{} instead of {}", units.len(), large.len());
    }

    #[test]
    fn units_grow_by_steps_and_short_ones_say_little() {
        let pass = Pass::new(Blocks::new(1920, 1080).in_order(), 0..4096);
        let size = |speed| {
            let unit = next(0, (0, &pass), None, Sizes::default(), speed).expect("a unit");
            unit.samples() as f64
        };
        let mut speed = Speed::default();
        speed.add(1 << 18, 1e-9);
        assert!(size(speed) <= GROWTH * f64::from(1 << 18), "not more than was measured says");
        // Ten short units, and one that took as long as units should.
        (0..10).for_each(|_| speed.add(1 << 18, 0.04));
        speed.add(1 << 19, 1.0);
        assert!(speed.samples_per_second() < 2.5e6, "{speed:?}");
        for _ in 0..100 {
            speed.add(1000, 1.0);
        }
        assert!((1000.0..1100.0).contains(&speed.samples_per_second()), "{speed:?}");
    }
}
