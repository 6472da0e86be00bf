//! How many units are offered, and how many frames are open for them.

/// Frames whose sums are in memory at the same time.
pub const OPEN_FRAMES: usize = 16;

/// Units that wait for each one that is under way, so that no worker waits for the coordinator.
const WAITING: usize = 1;

/// Units that are offered while there are no workers.
const WITHOUT_WORKERS: usize = 4;

/// Frames of a job that are opened at the same time.
const OPENING: usize = 2;

/// The number of units that are to be outstanding for so many slots.
pub fn wanted(slots: usize) -> usize {
    match slots {
        0 => WITHOUT_WORKERS,
        slots => slots * (1 + WAITING) + 1,
    }
}

/// True if another frame is to be opened of a job that has `open` frames and opens `opening` more: it has none, or
/// those of all jobs (`all`, open or being opened) have too few units. False if too many are open or being opened
/// already.
pub fn wants_frame(open: usize, opening: usize, all: usize, is_short: bool) -> bool {
    (open + opening == 0 || is_short) && opening < OPENING && (open == 0 || all < OPEN_FRAMES)
}

/// Units of each of so many open frames that are rendered at the same time at the end of the last ones, for
/// [`super::Sizes`]. 0 if there are `more` frames to be opened.
pub fn at_once(slots: usize, open: usize, more: bool) -> usize {
    if more { 0 } else { slots.div_ceil(open.max(1)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slots_are_shared_by_the_last_frames() {
        assert_eq!([at_once(8, 1, false), at_once(8, 3, false), at_once(8, 1, true)], [8, 3, 0]);
    }

    #[test]
    fn each_slot_has_a_unit_and_one_that_waits() {
        assert_eq!([0, 1, 8].map(wanted), [WITHOUT_WORKERS, 3, 17]);
    }

    #[test]
    fn frames_are_opened_while_units_are_short() {
        assert!(wants_frame(0, 0, 100, false), "every job has a frame");
        assert!(!wants_frame(1, 0, 1, false));
        assert!(wants_frame(1, 0, 1, true));
        assert!(!wants_frame(1, OPENING, 3, true));
        assert!(!wants_frame(OPEN_FRAMES, 0, OPEN_FRAMES, true));
    }
}
