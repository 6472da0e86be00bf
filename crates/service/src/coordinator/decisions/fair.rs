//! Which job gets the next unit.

use raystream::schedule::Priority;

/// A job that has work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Its priority.
    pub priority: Priority,
    /// Samples that it has been given since it entered.
    pub given: u64,
    /// Its place in the order of arrival.
    pub seq: i64,
}

/// A job with its share of the units.
pub trait Share {
    /// What decides whether it is next.
    fn candidate(&self) -> Candidate;

    /// Counts samples that it is given.
    fn give(&mut self, samples: u64);
}

/// Takes the next unit: `take` returns a job's next one with its samples, or none if the job has none now.
pub fn next<J: Share, T>(jobs: &mut [J], mut take: impl FnMut(&mut J) -> Option<(T, u64)>) -> Option<T> {
    // The usual case, and there is nothing to order.
    if let [job] = jobs {
        let (taken, samples) = take(job)?;
        job.give(samples);
        return Some(taken);
    }
    let candidates: Vec<Candidate> = jobs.iter().map(Share::candidate).collect();
    order(&candidates).into_iter().find_map(|index| {
        let (taken, samples) = take(&mut jobs[index])?;
        jobs[index].give(samples);
        Some(taken)
    })
}

/// The order in which jobs are asked for a unit: by priority, then those that have been given least, then by arrival.
fn order(candidates: &[Candidate]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..candidates.len()).collect();
    order.sort_by_key(|&index| {
        let Candidate { priority, given, seq } = candidates[index];
        (priority, given, seq)
    });
    order
}

/// Samples that a job counts as given when it enters: as many as the job that has least, so that it does not overtake
/// jobs that waited.
pub fn entry(others: impl IntoIterator<Item = u64>) -> u64 {
    others.into_iter().min().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jobs_of_a_priority_get_equal_shares() {
        let mut jobs: Vec<Candidate> =
            (0..3).map(|seq| Candidate { priority: Priority::Normal, given: 0, seq }).collect();
        // Units of three sizes; the shares differ by no more than a unit.
        for _ in 0..300 {
            let next = order(&jobs)[0];
            jobs[next].given += [5, 7, 11][next];
        }
        let given: Vec<u64> = jobs.iter().map(|job| job.given).collect();
        let (least, most) = (given.iter().min().expect("three"), given.iter().max().expect("three"));
        assert!(most - least <= 11, "{given:?}");
        let late = Candidate { priority: Priority::Normal, given: entry(given.iter().copied()), seq: 3 };
        assert_eq!(late.given, *least);
        jobs.push(Candidate { priority: Priority::Interactive, given: 1 << 40, seq: 4 });
        jobs.push(Candidate { priority: Priority::Background, given: 0, seq: 5 });
        let order = order(&jobs);
        assert_eq!((order[0], order[4]), (3, 4));
    }
}
