//! The primitive ids of a tree's triangles, where they are not simply 0, 1, 2 and so on.

use std::ops::Range;

/// Maps the indices of a tree's triangles to their primitive ids and back. Ids ascend with indices; they are
/// stored as runs of consecutive ids.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PrimitiveIds {
    /// Empty if each id is the index.
    runs: Vec<Run>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Run {
    /// Index of the first triangle.
    index: u32,
    /// Its primitive id.
    primitive: u32,
}

impl PrimitiveIds {
    /// The ids in `ranges`, which ascend and do not overlap.
    ///
    /// # Panics
    /// If they do not ascend.
    pub fn from_ranges(ranges: impl IntoIterator<Item = Range<u32>>) -> Self {
        let (mut runs, mut index, mut next) = (Vec::new(), 0, 0);
        for range in ranges.into_iter().filter(|range| !range.is_empty()) {
            assert!(range.start >= next, "ids ascend");
            if runs.is_empty() || range.start > next {
                runs.push(Run { index, primitive: range.start });
            }
            index += range.end - range.start;
            next = range.end;
        }
        if matches!(runs[..], [Run { primitive: 0, .. }]) {
            runs.clear();
        }
        Self { runs }
    }

    /// The first id of each run.
    pub fn run_starts(&self) -> impl Iterator<Item = u32> {
        let only = self.runs.is_empty().then_some(0);
        only.into_iter().chain(self.runs.iter().map(|run| run.primitive))
    }

    /// The primitive id of the triangle with an index.
    pub fn primitive(&self, index: u32) -> u32 {
        match self.runs[..] {
            [] => index,
            _ => {
                let run = self.runs[self.runs.partition_point(|run| run.index <= index) - 1];
                run.primitive + (index - run.index)
            }
        }
    }

    /// The index of the triangle with a primitive id, which must be one of these ids.
    #[inline]
    pub fn index(&self, primitive: u32) -> usize {
        match self.runs[..] {
            [] => primitive as usize,
            _ => {
                let run = self.runs[self.runs.partition_point(|run| run.primitive <= primitive) - 1];
                (run.index + (primitive - run.primitive)) as usize
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_and_indices_are_inverse_to_each_other() {
        for ranges in [vec![0..5, 5..7], vec![3..5, 9..10, 10..14, 20..21], vec![4..4, 7..9]] {
            let ids = PrimitiveIds::from_ranges(ranges.clone());
            for (index, id) in ranges.into_iter().flatten().enumerate() {
                assert_eq!(ids.primitive(index as u32), id);
                assert_eq!(ids.index(id), index);
            }
        }
        assert!(PrimitiveIds::from_ranges([0..5, 5..7]).runs.is_empty());
    }
}
