//! Who renders a unit, and when it counts as lost.

use crate::farm::UnitId;
use std::time::Duration;
use xxhash_rust::xxh3::xxh3_64;

/// Leases after which a unit that no one has is offered again: few if the bus is empty or workers wait, more if not,
/// since other units may be before it.
const LEASES_OF_FREE_BUS: u32 = 2;
const LEASES_OF_FULL_BUS: u32 = 20;

/// Who has a unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Holding {
    /// Whether it is the worker that asks.
    pub is_asker: bool,
    /// How long the holder was not heard of.
    pub silent: Duration,
}

/// What is known when a worker asks whether to render a unit that it has leased.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Asked {
    /// Who had it before.
    pub holding: Option<Holding>,
    /// How often it has been leased, this time included.
    pub deliveries: u64,
    /// Whether the worker's own sums of the unit are to be compared with another's.
    pub is_own: bool,
    /// Whether there is another worker.
    pub has_other: bool,
}

/// Whether a worker renders a unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Begin {
    /// It does. Whether an earlier holder has gone.
    Go { is_lost: bool },
    /// Not now, or not this worker.
    Wait,
    /// No one does: there is no one to compare with.
    Alone,
}

/// Whether a worker renders a unit. A holder that is silent for `silence` counts as gone.
pub fn begin(asked: &Asked, silence: Duration) -> Begin {
    let Asked { holding, deliveries, is_own, has_other } = *asked;
    if is_own {
        return if has_other { Begin::Wait } else { Begin::Alone };
    }
    match holding {
        Some(holding) if !holding.is_asker && holding.silent < silence => Begin::Wait,
        Some(holding) => Begin::Go { is_lost: !holding.is_asker || deliveries > 1 },
        None => Begin::Go { is_lost: false },
    }
}

/// Whether a second worker is to render a unit: a share of all, chosen by their names.
pub fn is_compared(id: &UnitId, share: f64) -> bool {
    share > 0.0 && (xxh3_64(id.to_string().as_bytes()) as f64) < share * u64::MAX as f64
}

/// How long units may be on offer before they count as lost. `is_new`: the bus has lost all it held. `units`: how many
/// it holds. `held` of the offered units are held by someone, and workers have so many `slots`.
pub fn patience(is_new: bool, units: u64, held: usize, slots: usize, lease: Duration) -> Duration {
    // A unit that waits although slots are free is not on the bus, whatever the bus counts.
    let is_free = held < slots;
    match (is_new, units) {
        (true, _) => Duration::ZERO,
        (false, units) if units == 0 || is_free => lease * LEASES_OF_FREE_BUS,
        _ => lease * LEASES_OF_FULL_BUS,
    }
}

/// Whether a unit is lost: its holder is silent for too long, or no one has it and it was offered too long ago.
pub fn is_lost(
    holder_silent: Option<Duration>,
    offered: Duration,
    lease: Duration,
    patience: Duration,
) -> bool {
    match holder_silent {
        Some(silent) => silent > lease + patience,
        None => offered > patience,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEASE: Duration = Duration::from_secs(15);

    fn asked(holding: Option<(bool, u64)>, deliveries: u64) -> Asked {
        let holding = holding.map(|(is_asker, s)| Holding { is_asker, silent: Duration::from_secs(s) });
        Asked { holding, deliveries, is_own: false, has_other: true }
    }

    #[test]
    fn one_worker_at_a_time_renders_a_unit() {
        let begin = |asked| begin(&asked, LEASE / 2);
        assert_eq!(begin(asked(None, 1)), Begin::Go { is_lost: false });
        assert_eq!(begin(asked(Some((false, 2)), 2)), Begin::Wait);
        assert_eq!(begin(asked(Some((false, 10)), 2)), Begin::Go { is_lost: true });
        assert_eq!(begin(asked(Some((true, 2)), 1)), Begin::Go { is_lost: false });
        assert_eq!(begin(asked(Some((true, 2)), 2)), Begin::Go { is_lost: true });
    }

    #[test]
    fn no_worker_is_compared_with_itself() {
        let own = Asked { is_own: true, ..asked(None, 1) };
        assert_eq!(begin(&own, LEASE / 2), Begin::Wait);
        assert_eq!(begin(&Asked { has_other: false, ..own }, LEASE / 2), Begin::Alone);
        let id = |number| UnitId { job: "a".into(), frame: 0, pass: 0, number, copy: 0 };
        let compared = |share| (0..10_000).filter(|number| is_compared(&id(*number), share)).count();
        assert_eq!((compared(0.0), compared(1.0)), (0, 10_000));
        assert!((400..600).contains(&compared(0.05)), "{}", compared(0.05));
    }

    #[test]
    fn units_are_lost_sooner_on_a_free_bus() {
        assert_eq!(patience(true, 5, 0, 0, LEASE), Duration::ZERO);
        assert_eq!(patience(false, 0, 4, 4, LEASE), 2 * LEASE);
        assert_eq!(patience(false, 5, 3, 4, LEASE), 2 * LEASE);
        let full = patience(false, 5, 4, 4, LEASE);
        assert_eq!(full, 20 * LEASE);
        assert!(!is_lost(None, full, LEASE, full) && is_lost(None, full + LEASE, LEASE, full));
        assert!(!is_lost(Some(full), full + LEASE, LEASE, full), "its holder was heard of");
        assert!(is_lost(Some(full + 2 * LEASE), Duration::ZERO, LEASE, full));
    }
}
