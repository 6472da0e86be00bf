//! Statistics of repeated measurements.

use serde::Serialize;

/// Statistics of one quantity that was measured in several rounds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// The median: the mean of the two middle values if their number is even.
    pub median: f64,
    /// The best round's value.
    pub best: f64,
    /// The worst round's value.
    pub worst: f64,
}

impl Spread {
    /// Statistics of at least one rate. Higher is better.
    ///
    /// # Panics
    /// If `values` is empty.
    pub fn of_rates(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        let n = values.len();
        Self { median: 0.5 * (values[(n - 1) / 2] + values[n / 2]), best: values[n - 1], worst: values[0] }
    }

    /// Statistics of at least one duration. Lower is better.
    ///
    /// # Panics
    /// If `values` is empty.
    pub fn of_times(values: Vec<f64>) -> Self {
        let Self { median, best, worst } = Self::of_rates(values);
        Self { median, best: worst, worst: best }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_in_the_middle() {
        let rates = Spread::of_rates(vec![3.0, 1.0, 2.0]);
        assert_eq!((rates.worst, rates.median, rates.best), (1.0, 2.0, 3.0));
        let times = Spread::of_times(vec![4.0, 1.0, 10.0, 3.0]);
        assert_eq!((times.best, times.median, times.worst), (1.0, 3.5, 10.0));
    }
}
