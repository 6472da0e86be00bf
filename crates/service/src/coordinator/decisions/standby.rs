//! How many workers help, and which of those that ask stand by instead.
//!
//! More workers bring more units, and each of them asks, reports and fetches scenes. From some number on the
//! coordinator has less time for sums than the workers bring, so that a job takes longer with more of them.

/// Workers that do no harm, whatever units cost.
pub const LEAST_WORKERS: usize = 8;

/// Workers that are invited before it is known what units cost.
pub const FIRST_WORKERS: usize = 64;

/// Scenes that are fetched at the same time before it is known how long one takes.
pub const FIRST_FETCHES: usize = 16;

/// The cost of units and workers, in seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Load {
    /// Threads of the coordinator.
    pub threads: f64,
    /// Time of such a thread in each second that a worker takes besides its units: its reports.
    pub worker_s: f64,
    /// Time of such a thread that a unit takes: the question for it, and its sums.
    pub unit_s: f64,
    /// Time for which a unit has what the units of its frame have one after another: the sums in memory.
    pub frame_s: f64,
    /// Frames whose sums are added up at the same time.
    pub frames: usize,
    /// Time of a worker's slot that a unit takes.
    pub rendering_s: f64,
    /// Units that a worker has at the same time.
    pub slots: f64,
}

/// The number of workers with which a second brings the most units: as many as the coordinator can take sums of beside
/// their reports. At least 8.
pub fn most_workers(load: &Load) -> usize {
    let Load { threads, worker_s, unit_s, frame_s, frames, rendering_s, slots } = *load;
    // Units that a worker brings in a second.
    let brought = slots / rendering_s.max(1e-6);
    let by_threads = threads / (brought * unit_s + worker_s);
    let by_frames = frames as f64 / (brought * frame_s);
    let most = by_threads.min(by_frames);
    // A cost of nothing bounds nothing.
    if most.is_finite() { (most.ceil() as usize).max(LEAST_WORKERS) } else { usize::MAX }
}

/// A job for a worker that does not have its scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fetch {
    /// Time of the coordinator's link that the scene takes, if it is known.
    pub scene_s: Option<f64>,
    /// Workers that are fetching a scene.
    pub fetching: usize,
    /// Time of a slot that the rest of the job takes.
    pub rest_s: f64,
    /// Slots of the workers that have the scene or are fetching it.
    pub slots: usize,
}

/// True if a worker is to fetch a scene: it has it before the others have done the job without it.
pub fn is_to_fetch(fetch: &Fetch) -> bool {
    let Fetch { scene_s, fetching, rest_s, slots } = *fetch;
    match scene_s {
        _ if slots == 0 => true,
        None => fetching < FIRST_FETCHES,
        Some(scene_s) => (fetching + 1) as f64 * scene_s < rest_s / slots as f64,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load() -> Load {
        Load {
            threads: 2.0,
            worker_s: 0.25e-3,
            unit_s: 1e-3,
            frame_s: 1e-3,
            frames: 16,
            rendering_s: 1.0,
            slots: 2.0,
        }
    }

    /// Units a second that so many workers bring and the coordinator takes.
    fn units(load: &Load, workers: f64) -> f64 {
        let brought = workers * load.slots / load.rendering_s;
        let threads = (load.threads - workers * load.worker_s).max(0.0) / load.unit_s;
        brought.min(threads).min(load.frames as f64 / load.frame_s)
    }

    #[test]
    fn no_other_number_of_workers_brings_more_units() {
        let loads = [
            load(),
            Load { frames: 1, ..load() },
            Load { worker_s: 5e-3, ..load() },
            Load { rendering_s: 60.0, ..load() },
        ];
        for load in loads {
            let most = most_workers(&load);
            let best = (1..30_000).map(|workers| units(&load, f64::from(workers))).fold(0.0, f64::max);
            let found = units(&load, most as f64);
            assert!(
                found > 0.99 * best,
                "{most} workers bring {found} units a second, {best} could be: {load:?}"
            );
            // Fewer bring fewer: none is invited for nothing.
            assert!(units(&load, 0.9 * (most as f64 - 1.0)) < found, "{most}: {load:?}");
        }
        assert_eq!([0.1, 100.0].map(|unit_s| most_workers(&Load { unit_s, ..load() })), [10, LEAST_WORKERS]);
        let free = Load { worker_s: 0.0, unit_s: 0.0, frame_s: 0.0, ..load() };
        assert_eq!(most_workers(&free), usize::MAX);
    }

    #[test]
    fn a_scene_is_fetched_while_that_is_quicker_than_the_rest_of_the_job() {
        let fetch = Fetch { scene_s: Some(0.4), fetching: 0, rest_s: 1000.0, slots: 0 };
        assert!(is_to_fetch(&fetch), "someone has to");
        assert!(is_to_fetch(&Fetch { fetching: 9, slots: 100, ..fetch }));
        assert!(!is_to_fetch(&Fetch { fetching: 30, slots: 100, ..fetch }));
        assert!(!is_to_fetch(&Fetch { rest_s: 10.0, slots: 100, ..fetch }));
        assert!(is_to_fetch(&Fetch { scene_s: None, fetching: FIRST_FETCHES - 1, slots: 1, ..fetch }));
        assert!(!is_to_fetch(&Fetch { scene_s: None, fetching: FIRST_FETCHES, slots: 1, ..fetch }));
    }
}
