//! Who may have a unit, when it counts as lost, and which units are rendered twice.

use std::time::Duration;

/// Leases after which a worker that has returned nothing meanwhile gets no more units.
pub const MOST_FRUITLESS: u32 = 3;

/// Leases for which it gets none.
pub const REST_LEASES: u32 = 40;

/// Units of a new key that are all compared, if any are.
pub const FIRST_COMPARED: u64 = 8;

/// Workers that have the same unit at the same time, at most.
const MOST_HOLDERS: usize = 2;

/// How long a unit is held before a worker that has nothing else to do gets it, too: a part of a lease, and at least
/// longer than units take.
const SPARE_SHARE: u32 = 5;
const SPARE_LEAST: Duration = Duration::from_secs(2);

/// A worker that has a unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Holding {
    /// True if it is the worker that asks.
    pub is_asker: bool,
    /// The time for which the holder was not heard of.
    pub silent: Duration,
    /// The time for which it has had the unit.
    pub held: Duration,
}

/// Facts about a unit for which a worker asks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Asked<'a> {
    /// The workers that have it.
    pub holdings: &'a [Holding],
    /// True if the worker's own sums of it are to be compared with another's.
    pub is_own: bool,
    /// True if the worker could not render it before, and others may.
    pub has_failed: bool,
}

/// The decision whether a worker gets a unit, the better ones first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Taking {
    /// No one has it.
    Free,
    /// Whoever has it was not heard of for too long.
    Lost,
    /// Someone has it for long, and there is nothing else to do.
    Spare,
    /// Not this worker, or not now.
    No,
}

/// Losses of a unit, from the number that each worker has had. A worker counts at most as often as the one with the
/// next fewer losses: one that takes a unit again and again and falls silent shows nothing about the unit.
pub fn losses(each: impl Iterator<Item = u32>) -> u32 {
    let mut each: Vec<u32> = each.collect();
    each.sort_unstable();
    if let [.., next, most] = &mut each[..] {
        *most = (*most).min(*next);
    }
    each.into_iter().sum()
}

/// Decides whether a worker gets a unit. A holder that is silent for `silence` counts as gone.
pub fn taking(asked: &Asked<'_>, silence: Duration, lease: Duration) -> Taking {
    let is_gone = |holding: &Holding| holding.silent >= silence;
    let spare = (lease / SPARE_SHARE).max(SPARE_LEAST);
    match asked.holdings {
        _ if asked.is_own || asked.has_failed => Taking::No,
        [] => Taking::Free,
        holdings if holdings.iter().all(is_gone) => Taking::Lost,
        holdings if holdings.len() >= MOST_HOLDERS || holdings.iter().any(|holding| holding.is_asker) => {
            Taking::No
        }
        holdings if holdings.iter().all(|holding| holding.held >= spare) => Taking::Spare,
        _ => Taking::No,
    }
}

/// True if a second worker is to render a unit, for which `drawn` was drawn from 0 to 1. A key that has brought fewer
/// than so many units is new.
pub fn is_compared(drawn: f64, share: f64, brought: u64) -> bool {
    share > 0.0 && (drawn <= share || brought < FIRST_COMPARED)
}

/// True if a worker gets no more units: it has had some for too long (`owes`) and has returned nothing meanwhile, or it
/// has lost or given back too many in a row.
pub fn is_fruitless(owes: Option<Duration>, in_a_row: u32, lease: Duration) -> bool {
    owes.is_some_and(|owes| owes > MOST_FRUITLESS * lease) || in_a_row >= MOST_FRUITLESS
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEASE: Duration = Duration::from_secs(15);

    fn take(holdings: &[(bool, u64, u64)]) -> Taking {
        let seconds = Duration::from_secs;
        let holdings: Vec<Holding> = holdings
            .iter()
            .map(|&(is_asker, silent, held)| Holding {
                is_asker,
                silent: seconds(silent),
                held: seconds(held),
            })
            .collect();
        taking(&Asked { holdings: &holdings, ..Asked::default() }, LEASE, LEASE)
    }

    #[test]
    fn one_worker_alone_does_not_make_a_unit_look_deadly() {
        let of = |each: &[u32]| losses(each.iter().copied());
        assert_eq!((of(&[]), of(&[5]), of(&[3, 2])), (0, 5, 4), "alone, it is all that is known");
        assert_eq!(of(&[1, 40, 1, 1]), 4, "a thief beside three honest ones");
        assert_eq!(of(&[2, 3, 2]), 6);
    }

    #[test]
    fn one_worker_at_a_time_renders_a_unit_and_idle_ones_help_late() {
        assert_eq!(take(&[]), Taking::Free);
        assert_eq!(take(&[(false, 1, 2)]), Taking::No);
        assert_eq!(take(&[(false, 1, 3)]), Taking::Spare);
        assert_eq!(take(&[(true, 1, 30)]), Taking::No);
        assert_eq!(take(&[(false, 1, 30), (false, 1, 30)]), Taking::No);
        assert_eq!(take(&[(false, 15, 16)]), Taking::Lost);
        assert_eq!(take(&[(true, 15, 16)]), Taking::Lost);
        assert_eq!(take(&[(false, 15, 16), (false, 1, 1)]), Taking::No);
        assert!(Taking::Free < Taking::Lost && Taking::Lost < Taking::Spare && Taking::Spare < Taking::No);
    }

    #[test]
    fn no_worker_is_compared_with_itself_or_tries_again_what_it_could_not() {
        let own = Asked { is_own: true, ..Asked::default() };
        let failed = Asked { has_failed: true, ..Asked::default() };
        assert_eq!([own, failed].map(|asked| taking(&asked, LEASE, LEASE)), [Taking::No; 2]);
    }

    #[test]
    fn the_first_units_of_a_key_are_compared_and_a_share_of_the_others() {
        assert!(is_compared(0.9, 0.01, FIRST_COMPARED - 1) && !is_compared(0.9, 0.01, FIRST_COMPARED));
        assert!(is_compared(0.01, 0.01, 100) && is_compared(1.0, 1.0, 100));
        assert!(!is_compared(0.0, 0.0, 0), "none if none are asked for");
    }

    #[test]
    fn who_returns_nothing_gets_nothing() {
        assert!(!is_fruitless(None, MOST_FRUITLESS - 1, LEASE) && is_fruitless(None, MOST_FRUITLESS, LEASE));
        assert!(!is_fruitless(Some(3 * LEASE), 0, LEASE));
        assert!(is_fruitless(Some(3 * LEASE + Duration::from_secs(1)), 0, LEASE));
    }
}
