//! Sampling of a discrete distribution in constant time.

use crate::lanes::{Int, Lanes, Num};
use bytemuck::{Pod, Zeroable};

/// An alias table (Walker 1974, constructed as in Vose 1991).
#[derive(Clone, Debug, Default)]
pub struct AliasTable {
    entries: Vec<Entry>,
    total: f64,
}

#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Entry {
    /// Probability of keeping this entry when it is drawn.
    keep: f32,
    /// Index that is chosen otherwise.
    other: u32,
    /// Total probability of this index.
    probability: f32,
}

impl AliasTable {
    /// A table of `weights`: at most 2³², each finite and ≥ 0. It is empty if all are 0.
    pub fn new(weights: &[f64]) -> Self {
        let total: f64 = weights.iter().sum();
        if total <= 0.0 {
            return Self::default();
        }
        let n = weights.len();
        let mut scaled: Vec<f64> = weights.iter().map(|w| w / total * n as f64).collect();
        let mut entries: Vec<Entry> = weights
            .iter()
            .enumerate()
            .map(|(i, w)| Entry { keep: 1.0, other: i as u32, probability: (w / total) as f32 })
            .collect();
        let (mut small, mut large): (Vec<usize>, Vec<usize>) = (0..n).partition(|&i| scaled[i] < 1.0);
        while let (Some(&poor), Some(&rich)) = (small.last(), large.last()) {
            small.pop();
            entries[poor].keep = scaled[poor] as f32;
            entries[poor].other = rich as u32;
            scaled[rich] -= 1.0 - scaled[poor];
            if scaled[rich] < 1.0 {
                large.pop();
                small.push(rich);
            }
        }
        // Rounding may leave entries whose weight should be exactly 1. An entry without weight must never be
        // chosen.
        for i in small {
            if weights[i] == 0.0 {
                entries[i].keep = 0.0;
                entries[i].other = weights.iter().position(|&w| w > 0.0).unwrap_or(0) as u32;
            }
        }
        Self { entries, total }
    }

    /// True if there is nothing to choose.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Sum of the weights.
    pub fn total(&self) -> f64 {
        self.total
    }

    /// Chooses indices by `u` in [0, 1); `None` if the table is empty. Returns the indices, their
    /// probabilities, and the remainders of `u`: uniform numbers in [0, 1) for the caller's next choice.
    #[inline(always)]
    pub fn choose<L: Lanes>(&self, u: Num<L>) -> Option<(Int<L>, Num<L>, Num<L>)> {
        let last = self.entries.len().checked_sub(1)?;
        let table: &[u32] = bytemuck::cast_slice(&self.entries);
        let place = u * self.entries.len() as f32;
        let index = place.to_int().at_most(last as u32);
        let [keep, other, _] = index.rows(table);
        let (keep, share) = (keep.to_num_bits(), place - index.to_num());
        let stays = share.lt(keep);
        let rest = Num::select(stays, share, share - keep) / Num::select(stays, keep, 1.0 - keep);
        let chosen = Int::select(stays, index, other);
        let [_, _, probability] = chosen.rows(table);
        Some((chosen, probability.to_num_bits(), rest.clamp(0.0, 1.0 - f32::EPSILON)))
    }

    /// The probabilities of indices.
    #[inline(always)]
    pub fn probability<L: Lanes>(&self, index: Int<L>) -> Num<L> {
        let [_, _, probability] = index.rows(bytemuck::cast_slice(&self.entries));
        probability.to_num_bits()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_index_is_chosen_in_proportion_to_its_weight() {
        let weights = [0.0, 3.0, 1.0, 0.0, 0.5, 100.0, 1e-3, 7.0];
        let table = AliasTable::new(&weights);
        let total: f64 = weights.iter().sum();
        let n = 1 << 20;
        let (mut counts, mut rests) = (vec![0u32; weights.len()], vec![0.0; weights.len()]);
        for i in 0..n {
            let u = Num::from((i as f32 + 0.5) / n as f32);
            let (index, probability, rest) = table.choose(u).expect("not empty");
            assert_eq!(probability.get(), table.probability(index).get());
            assert!((0.0..1.0).contains(&rest.get()));
            counts[index.get() as usize] += 1;
            rests[index.get() as usize] += f64::from(rest.get());
        }
        for (i, &w) in weights.iter().enumerate() {
            let expected = w / total;
            assert!((f64::from(counts[i]) / f64::from(n) - expected).abs() < 1e-5, "{i}");
            assert!((f64::from(table.probability(Int::from(i as u32)).get()) - expected).abs() < 1e-6);
            let mean = rests[i] / f64::from(counts[i].max(1));
            assert!(counts[i] < 100 || (mean - 0.5).abs() < 0.01, "what is left is even: {mean}");
        }
        assert_eq!((counts[0], counts[3]), (0, 0), "no weight, no probability");
    }

    #[test]
    fn an_empty_table_chooses_nothing() {
        assert!(AliasTable::new(&[]).choose(Num::from(0.3)).is_none());
        assert!(AliasTable::new(&[0.0, 0.0]).choose(Num::from(0.3)).is_none());
    }
}
