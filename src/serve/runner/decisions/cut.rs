//! How passes are cut into units. The picture does not depend on it.

use crate::render::{BLOCK, Pass};
use crate::serve::ledger::{UnitRow, UnitState};
use xxhash_rust::xxh3::xxh3_64;

/// Seconds that a unit is to take: long enough to be worth its messages, short enough that little is lost with a
/// worker and the last unit of a frame does not keep others waiting.
const UNIT_SECONDS: f64 = 1.0;

/// A unit takes at most this many times the samples of what was measured last.
const GROWTH: f64 = 4.0;

/// Samples a second that are assumed before any unit of a job has ended.
const FIRST_SPEED: f64 = (1 << 18) as f64;

/// Blocks of a unit: fewer would share few rays, more would make its message long.
const FEWEST_BLOCKS: u32 = 16;
const MOST_BLOCKS: u32 = 2048;

/// Pixels of a block.
pub const BLOCK_PIXELS: f64 = (BLOCK * BLOCK) as f64;

/// How large units are.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sizes {
    /// Pixels × samples of a unit, instead of a duration.
    pub samples: Option<u64>,
    /// Cut at random with this seed, for tests.
    pub random: Option<u64>,
}

/// What is known about the speed of a job's units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Speed {
    /// Pixels × samples a second of one unit while others are under way.
    measured: Option<f64>,
}

impl Speed {
    /// Takes note of a unit.
    pub fn add(&mut self, samples: u64, seconds: f64) {
        let now = samples as f64 / seconds.max(1e-4);
        let mean = |before: f64| 0.5 * before + 0.5 * now.min(before * GROWTH);
        self.measured = Some(self.measured.map_or(now.min(FIRST_SPEED * GROWTH), mean));
    }

    /// Pixels × samples a second, as far as is known.
    pub fn samples_per_second(&self) -> f64 {
        self.measured.unwrap_or(FIRST_SPEED)
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
    let wanted = sizes.samples.map_or(speed.samples_per_second() * UNIT_SECONDS, |samples| samples as f64);
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
        attempts: 0,
        worker: None,
        digest: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::Blocks;

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
            let mut cuts = vec![Sizes::default(), Sizes { samples: Some(1), random: None }];
            cuts.extend((0..20).map(|seed| Sizes { samples: None, random: Some(seed) }));
            for sizes in cuts {
                let units = cut(&pass, sizes, Speed::default());
                let taken: u64 =
                    units.iter().map(|unit| u64::from(unit.blocks) * u64::from(unit.end - unit.first)).sum();
                assert_eq!(taken, all * many, "{sizes:?}");
                let mut places: Vec<(u32, u32)> = units.iter().map(|unit| (unit.block, unit.first)).collect();
                places.sort_unstable();
                places.dedup();
                assert_eq!(places.len(), units.len(), "no two begin at the same place");
                assert!(units.iter().all(|unit| unit.end <= samples.end && unit.first < unit.end));
            }
        }
    }

    #[test]
    fn units_take_about_a_second() {
        let pass = Pass::new(Blocks::new(1920, 1080).in_order(), 0..4096);
        for speed in [2e4, 1e6, 3e7] {
            let speed = Speed { measured: Some(speed) };
            let units = cut(&pass, Sizes::default(), speed);
            for unit in &units[..units.len().min(100)] {
                let samples = f64::from(unit.blocks) * BLOCK_PIXELS * f64::from(unit.end - unit.first);
                let seconds = samples / speed.samples_per_second();
                assert!((0.3..2.0).contains(&seconds), "{seconds} s at {speed:?}");
            }
        }
    }

    #[test]
    fn speed_follows_what_is_measured_but_does_not_jump() {
        let mut speed = Speed::default();
        speed.add(1 << 30, 1e-9);
        assert_eq!(speed.samples_per_second(), GROWTH * FIRST_SPEED);
        for _ in 0..20 {
            speed.add(1000, 1.0);
        }
        assert!((1000.0..1010.0).contains(&speed.samples_per_second()), "{speed:?}");
    }
}
