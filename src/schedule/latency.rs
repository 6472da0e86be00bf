//! A histogram of times, which gives medians without a list that grows.

/// Buckets in an octave: neighbouring bounds differ by at most an eighth.
const STEPS: u32 = 8;
/// The lower bound, as a power of two of nanoseconds: about 1 µs. Shorter times are counted in the first bucket.
const SHORTEST: u32 = 10;
/// The upper bound, as a power of two of nanoseconds: about 69 s. Longer times are counted in the last bucket.
const LONGEST: u32 = 36;
const BUCKETS: usize = ((LONGEST - SHORTEST) * STEPS) as usize;

/// A histogram of times, on a logarithmic scale.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Latency {
    counts: [u32; BUCKETS],
}

impl Default for Latency {
    fn default() -> Self {
        Self { counts: [0; BUCKETS] }
    }
}

impl Latency {
    /// Counts a time.
    pub fn record(&mut self, ns: u64) {
        let octave = ns.max(1).ilog2();
        let index = match octave {
            0..SHORTEST => 0,
            LONGEST.. => BUCKETS - 1,
            _ => {
                let step = (ns >> (octave - STEPS.ilog2())) as u32 % STEPS;
                ((octave - SHORTEST) * STEPS + step) as usize
            }
        };
        self.counts[index] += 1;
    }

    /// The quantile in seconds: the share `share` (0 to 1) of all times is at most this, to a relative error of 1/16.
    /// `None` if no time was recorded.
    pub fn quantile_s(&self, share: f64) -> Option<f64> {
        let total: u64 = self.counts.iter().map(|&count| u64::from(count)).sum();
        let rank = (share * total as f64).ceil().max(1.0) as u64;
        let mut seen = 0;
        let index = self.counts.iter().position(|&count| {
            seen += u64::from(count);
            seen >= rank && total > 0
        })? as u32;
        let (octave, step) = (SHORTEST + index / STEPS, index % STEPS);
        // The middle of the bucket.
        Some((1.0 + (f64::from(step) + 0.5) / f64::from(STEPS)) * f64::from(octave).exp2() * 1e-9)
    }
}

impl std::ops::AddAssign for Latency {
    fn add_assign(&mut self, other: Self) {
        self.counts.iter_mut().zip(other.counts).for_each(|(sum, count)| *sum += count);
    }
}

/// Waiting times of streams that a device traced.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DeviceWaits {
    /// From when a stream became full until it was submitted.
    pub full_to_dispatched: Latency,
    /// From its submission until its answers could be read.
    pub dispatched_to_readable: Latency,
}

impl std::ops::AddAssign for DeviceWaits {
    fn add_assign(&mut self, other: Self) {
        self.full_to_dispatched += other.full_to_dispatched;
        self.dispatched_to_readable += other.dispatched_to_readable;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_right_to_a_sixteenth() {
        let mut latency = Latency::default();
        assert_eq!(latency.quantile_s(0.5), None);
        let times: Vec<u64> = (1..=1000).map(|i| 10_000 * i).collect();
        times.iter().rev().for_each(|&ns| latency.record(ns));
        for (share, exact) in [(0.0, 1e-5), (0.5, 5e-3), (0.95, 9.5e-3), (1.0, 1e-2)] {
            let found = latency.quantile_s(share).unwrap();
            assert!((found / exact - 1.0).abs() < 0.07, "{share}: {found} instead of {exact}");
        }
        let mut twice = latency;
        twice += latency;
        assert_eq!(twice.quantile_s(0.3), latency.quantile_s(0.3));
    }

    #[test]
    fn no_time_is_too_short_or_too_long() {
        let mut latency = Latency::default();
        [0, 1, 900].iter().for_each(|&ns| latency.record(ns));
        assert!(latency.quantile_s(1.0).unwrap() < 1.2e-6);
        latency.record(u64::MAX);
        assert!(latency.quantile_s(1.0).unwrap() > 60.0);
    }
}
