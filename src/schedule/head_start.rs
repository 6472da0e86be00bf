//! Rays that new jobs may be given before it is their turn: with long turns, small jobs would wait long for little.

/// Counted rays that a new job is given at once. A query of twenty thousand rays takes as many, spawned, traced and
/// answered.
const EACH: u64 = 1 << 16;

/// Counted rays of all head starts that may be left.
const MOST: u64 = 16 * EACH;

/// What is left for head starts. They fill up by the rays that jobs are given in their turns, so new jobs get at most
/// half of all rays, however many come.
#[derive(Debug)]
pub(super) struct HeadStarts {
    left: u64,
}

impl Default for HeadStarts {
    fn default() -> Self {
        Self { left: MOST }
    }
}

impl HeadStarts {
    /// Takes a head start for a new job: at least one ray, so that the job is served at once.
    pub fn take(&mut self) -> u64 {
        let rays = self.left.min(EACH);
        self.left -= rays;
        rays.max(1)
    }

    /// A job has been given `rays`, and `ahead` of them were of its head start.
    pub fn count(&mut self, rays: u64, ahead: u64) {
        self.left = (self.left + rays - ahead).min(MOST);
    }

    /// A job has ended that was not given so many rays of its head start.
    pub fn give_back(&mut self, rays: u64) {
        self.left = (self.left + rays).min(MOST);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn new_jobs_get_at_most_half_of_all_rays() {
        let mut starts = HeadStarts::default();
        while starts.left > 0 {
            starts.take();
        }
        let (mut ahead, mut in_turn) = (0, 0);
        for _ in 0..1000 {
            let given = starts.take();
            starts.count(given, given);
            ahead += given;
            // Beside it an old job gets a task.
            starts.count(1000, 0);
            in_turn += 1000;
        }
        assert!(ahead <= in_turn && ahead > in_turn / 2, "{ahead} of head starts, {in_turn} in turns");
    }

    #[test]
    fn small_jobs_leave_what_they_do_not_need() {
        let mut starts = HeadStarts::default();
        for _ in 0..1000 {
            let given = starts.take();
            assert_eq!(given, EACH);
            starts.count(30, 30);
            starts.give_back(given - 30);
            starts.count(30, 0);
        }
        assert_eq!(starts.left, MOST);
    }
}
