//! How urgent a job is.

/// Rank among jobs that want threads. A job gets a thread only when no job of a higher priority has a task for it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum Priority {
    /// Someone waits for the answer: a pick, a preview. While such a job runs, the tasks of all jobs are small
    /// ([`super::Service::interactive`]).
    Interactive,
    /// Frames and queries.
    #[default]
    Normal,
    /// What may wait until the threads have nothing else to do.
    Background,
}

impl Priority {
    /// All priorities, the highest first.
    pub const ALL: [Self; 3] = [Self::Interactive, Self::Normal, Self::Background];

    /// The name that reports use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Interactive => "interactive",
            Self::Normal => "normal",
            Self::Background => "background",
        }
    }
}
