//! The primitive ids at which the instances of a world begin.

use std::ops::Range;

/// The primitive ids of instances in the tree over them: those of each follow those of the one before.
#[derive(Clone, Debug)]
pub(super) struct InstanceStarts {
    /// The first id of each instance, then the number of all ids.
    firsts: Vec<u32>,
    /// The first id and the index of each instance that has ids, ascending.
    owners: Vec<(u32, u32)>,
    /// For each `1 << shift` ids the place in `owners` of the one that has the first of them, then the last place.
    intervals: Vec<u32>,
    shift: u32,
}

impl InstanceStarts {
    /// The starts of instances with these numbers of primitives, less than 2³² in all.
    pub fn new(counts: impl Iterator<Item = u32>) -> Self {
        let (mut firsts, mut owners, mut first) = (Vec::new(), Vec::new(), 0);
        for (instance, count) in (0..).zip(counts) {
            firsts.push(first);
            if count > 0 {
                owners.push((first, instance));
            }
            first += count;
        }
        firsts.push(first);
        // One to two intervals for each instance in the mean, so that hardly a search has a step.
        let shift = (first / owners.len().max(1) as u32).max(1).ilog2();
        let place = |id: u32| owners.partition_point(|&(first, _)| first <= id).saturating_sub(1) as u32;
        let mut intervals: Vec<u32> = (0..=first >> shift).map(|interval| place(interval << shift)).collect();
        intervals.push(place(first));
        Self { firsts, owners, intervals, shift }
    }

    /// The ids of an instance.
    ///
    /// # Panics
    /// If there is no such instance.
    pub fn ids(&self, instance: usize) -> Range<u32> {
        self.firsts[instance]..self.firsts[instance + 1]
    }

    /// The first id of the instance that has an id, and its index.
    ///
    /// # Panics
    /// If no instance has ids.
    #[inline]
    pub fn owner(&self, id: u32) -> (u32, u32) {
        let interval = (id >> self.shift) as usize;
        let [low, high] = [self.intervals[interval], self.intervals[interval + 1]];
        let later = &self.owners[low as usize + 1..=high as usize];
        self.owners[low as usize + later.partition_point(|&(first, _)| first <= id)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_id_has_the_owner_that_counting_finds() {
        for counts in [
            &[][..],
            &[0],
            &[1],
            &[0, 5, 0, 0, 1, 1, 1, 1, 1, 700, 3, 0],
            &[4096; 100],
            &[1; 300],
            &[9, 1 << 20],
        ] {
            let starts = InstanceStarts::new(counts.iter().copied());
            let mut first = 0;
            for (instance, &count) in (0..).zip(counts) {
                assert_eq!(starts.ids(instance as usize), first..first + count);
                assert!((first..first + count).all(|id| starts.owner(id) == (first, instance)));
                first += count;
            }
        }
    }
}
