//! What repeated measurements say.

use serde::Serialize;

/// Measurements of one thing over several rounds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// In the middle; the mean of the two middle ones if their number is even.
    pub median: f64,
    /// The best round's.
    pub best: f64,
    /// The worst round's.
    pub worst: f64,
}

impl Spread {
    /// Of at least one rate: more is better.
    ///
    /// # Panics
    /// If there is none.
    pub fn of_rates(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        let n = values.len();
        Self { median: 0.5 * (values[(n - 1) / 2] + values[n / 2]), best: values[n - 1], worst: values[0] }
    }

    /// Of at least one duration: less is better.
    ///
    /// # Panics
    /// If there is none.
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
