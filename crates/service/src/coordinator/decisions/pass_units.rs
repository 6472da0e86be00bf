//! The units of a pass: those that are cut and have no sums, and what is left to be cut.

use super::cut::{self, Sizes, Speed};
use crate::coordinator::ledger::{UnitRow, UnitState};
use raystream::render::Pass;
use std::collections::{BTreeMap, VecDeque};

/// The units of a pass that may be rendered now.
#[derive(Debug)]
pub struct PassUnits {
    /// The number of the pass.
    pub number: u64,
    pass: Pass,
    /// The last unit that was cut.
    last: Option<UnitRow>,
    /// Units without sums.
    open: BTreeMap<u32, UnitRow>,
    /// Those of them that are to be offered.
    todo: VecDeque<u32>,
}

impl PassUnits {
    /// A pass that is not cut yet.
    pub fn new(number: u64, pass: Pass) -> Self {
        Self { number, pass, last: None, open: BTreeMap::new(), todo: VecDeque::new() }
    }

    /// Takes a unit that is to be offered, and whether it has just been cut. `None` if there is none.
    pub fn take(&mut self, frame: u32, sizes: Sizes, speed: Speed) -> Option<(UnitRow, bool)> {
        if let Some(number) = self.todo.pop_front() {
            return self.open.get(&number).map(|unit| (unit.clone(), false));
        }
        let unit = cut::next(frame, (self.number, &self.pass), self.last.as_ref(), sizes, speed)?;
        self.last = Some(unit.clone());
        self.open.insert(unit.number, unit.clone());
        Some((unit, true))
    }

    /// A unit without sums.
    pub fn find(&self, number: u32) -> Option<&UnitRow> {
        self.open.get(&number)
    }

    /// True if a unit has been cut.
    pub fn is_cut(&self, number: u32) -> bool {
        self.last.as_ref().is_some_and(|last| number <= last.number)
    }

    /// Takes note that a unit has sums.
    pub fn keep(&mut self, number: u32) {
        self.open.remove(&number);
        self.todo.retain(|other| *other != number);
    }

    /// Takes note of a unit that an earlier process has cut.
    pub fn note(&mut self, unit: UnitRow) {
        if unit.state == UnitState::Open {
            self.todo.push_back(unit.number);
            self.open.insert(unit.number, unit.clone());
        }
        if self.last.as_ref().is_none_or(|last| last.number < unit.number) {
            self.last = Some(unit);
        }
    }

    /// True if the pass has the blocks of a unit.
    pub fn has_blocks(&self, unit: &UnitRow) -> bool {
        (unit.block + unit.blocks) as usize <= self.pass.blocks().len()
    }

    /// The blocks of a unit.
    pub fn blocks_of(&self, unit: &UnitRow) -> Vec<u32> {
        self.pass.blocks()[unit.block as usize..][..unit.blocks as usize].to_vec()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use raystream::render::Blocks;

    #[test]
    fn units_that_were_cut_before_are_offered_before_new_ones() {
        let pass = || PassUnits::new(0, Pass::new(Blocks::new(320, 200).in_order(), 0..16));
        let sizes = Sizes { samples: Some(1 << 16), ..Sizes::default() };
        let take = |units: &mut PassUnits| units.take(0, sizes, Speed::default());
        let mut before = pass();
        let (first, second) = (take(&mut before).expect("one"), take(&mut before).expect("another"));
        assert!(first.1 && second.1);
        let mut units = pass();
        units.note(UnitRow { state: UnitState::Kept, ..first.0.clone() });
        units.note(second.0.clone());
        assert_eq!(take(&mut units), Some((second.0.clone(), false)));
        units.keep(second.0.number);
        let mut count = 2;
        while let Some((unit, is_new)) = take(&mut units) {
            assert!(is_new && unit.number == count, "units with sums do not come back");
            count += 1;
        }
        assert!(units.is_cut(count - 1) && !units.is_cut(count) && units.find(0).is_none());
    }
}
