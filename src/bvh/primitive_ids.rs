//! Which primitives the triangles of a tree are, when they are not simply 0, 1, 2 and so on.

/// Ascending primitive ids of a tree's triangles, as runs of consecutive ones.
#[derive(Clone, Debug, Default)]
pub struct PrimitiveIds {
    /// No runs: ids are places.
    runs: Vec<Run>,
}

#[derive(Clone, Copy, Debug)]
struct Run {
    place: u32,
    primitive: u32,
}

impl PrimitiveIds {
    /// The triangles that `ids` names, in ascending order.
    pub fn from_ranges(ranges: impl IntoIterator<Item = std::ops::Range<u32>>) -> Self {
        let (mut runs, mut place, mut next) = (Vec::new(), 0, 0);
        for range in ranges.into_iter().filter(|range| !range.is_empty()) {
            assert!(range.start >= next, "ids ascend");
            if runs.is_empty() || range.start > next {
                runs.push(Run { place, primitive: range.start });
            }
            place += range.end - range.start;
            next = range.end;
        }
        if matches!(runs[..], [Run { primitive: 0, .. }]) {
            runs.clear();
        }
        Self { runs }
    }

    /// Where runs of consecutive ids start.
    pub fn starts(&self) -> impl Iterator<Item = u32> {
        let one = self.runs.is_empty().then_some(0);
        one.into_iter().chain(self.runs.iter().map(|run| run.primitive))
    }

    /// The id of the triangle at a place.
    pub fn primitive(&self, place: u32) -> u32 {
        match self.runs[..] {
            [] => place,
            _ => {
                let run = self.runs[self.runs.partition_point(|run| run.place <= place) - 1];
                run.primitive + (place - run.place)
            }
        }
    }

    /// The place of a primitive of the tree.
    pub fn index(&self, primitive: u32) -> usize {
        match self.runs[..] {
            [] => primitive as usize,
            _ => {
                let run = self.runs[self.runs.partition_point(|run| run.primitive <= primitive) - 1];
                (run.place + (primitive - run.primitive)) as usize
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_and_primitives_are_each_other_s_inverse() {
        for ranges in [vec![0..5, 5..7], vec![3..5, 9..10, 10..14, 20..21], vec![4..4, 7..9]] {
            let numbering = PrimitiveIds::from_ranges(ranges.clone());
            for (place, id) in ranges.into_iter().flatten().enumerate() {
                assert_eq!(numbering.primitive(place as u32), id);
                assert_eq!(numbering.index(id), place);
            }
        }
        assert!(PrimitiveIds::from_ranges([0..5, 5..7]).runs.is_empty());
    }
}
