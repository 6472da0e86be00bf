//! How long something took, many times over: a histogram, from which medians come without a list that grows.

/// Buckets an octave: their bounds are at most an eighth apart.
const STEPS: u32 = 8;
/// Shorter is counted as this, in powers of two of nanoseconds: a microsecond.
const SHORTEST: u32 = 10;
/// Longer is counted as this: a minute.
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
    /// Counts one.
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

    /// Seconds within which the share `share` of all lies, to a sixteenth; none if there was none.
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

/// Where streams that a device traced spent their time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DeviceWaits {
    /// From being full to being submitted.
    pub full_to_dispatched: Latency,
    /// From there to where answers could be read.
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
